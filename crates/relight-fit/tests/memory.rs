//! What finding learned planes takes, held to what the program counts on.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

use relight_core::Direction;
use relight_core::sphere::{Cap, fibonacci_in};
use relight_fit::{ChannelSample, LearnedDesign, LearnedFit, learned_bytes};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Remembers how much was in use at most.
struct Watched;
static IN_USE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);
#[global_allocator]
static ALLOCATOR: Watched = Watched;

// SAFETY: all work is the system allocator's.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let in_use = IN_USE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(in_use, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

// One test: another one beside it would be counted, too.
#[test]
fn learned_planes_take_no_more_than_is_counted_on_and_not_much_less() {
    // Moments are most of it for many lights, values for few.
    for (lights, channels, pixels) in [(150, 3, 40), (210, 1, 40), (12, 3, 8192)] {
        let planes = 4;
        let directions: Vec<Direction> = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.2 }, lights);
        let value = |light: usize, at: usize| ((light * 7919 + at * 104_729) % 1009) as f32 / 1009.0;
        let stack = |light: usize| (0..pixels * channels).map(|at| value(light, at)).collect();
        let before = IN_USE.load(Ordering::Relaxed);
        PEAK.store(before, Ordering::Relaxed);
        let values: Vec<Vec<f32>> = (0..lights).map(stack).collect();
        let sample = ChannelSample::from_values(&values, channels);
        drop(values);
        let design = LearnedDesign { planes, opponent: false, target_psnr: None };
        let fit = LearnedFit::new(&directions, design, &sample).unwrap();
        let peak = (PEAK.load(Ordering::Relaxed) - before) as f64;
        let counted = learned_bytes(lights, channels, pixels, planes) as f64;
        let case =
            format!("{lights} lights, {channels} channels, {pixels} pixels, {} planes", fit.basis.planes());
        // What vectors weigh themselves is not counted.
        assert!(peak <= 1.01 * counted && peak > 0.4 * counted, "{case}: {peak} of {counted} bytes");
    }
}
