//! Panoramas, meshes, the rasteriser and what is drawn with it.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod lightmaps;
mod meshes;
mod panoramas;
mod rasterizing;
mod tangent_space;

use relight_core::relighter::Picture;

/// Numbers from 0 to 1 in no order, the same in every run (xorshift64*).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A picture without two equal samples.
fn noise_picture(width: usize, height: usize, channels: usize) -> Picture {
    let mut noise = Noise(7 + width as u64);
    let samples = (0..width * height * channels).map(|_| noise.next() as f32).collect();
    Picture { width, height, channels, samples }
}

/// What `work` gives with one thread, held against what it gives with three.
fn same_with_any_threads<T: Send + PartialEq + std::fmt::Debug>(work: impl Fn() -> T + Sync + Send) -> T {
    let with = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(&work);
    let one = with(1);
    assert_eq!(one, with(3));
    one
}
