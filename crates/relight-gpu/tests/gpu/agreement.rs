//! The GPU draws what the reference relighter does.

use crate::assets::{asset, formats, gpu, lights, model};
use relight_core::relighter::relight;
use relight_core::{CpuLevel, Layout};
use relight_gpu::{
    Backend, DecodingBound, Difference, Gpu, GpuMaps, TextureMode, decoding_differences, decoding_tolerance,
    maps_of_level,
};
use relight_texture::{BlockFormat, PackedMaps, Precision, TexelFormat};

/// Rounding of sums in f32, of full range.
const ROUNDING: f64 = 1e-5;

/// Draws `maps` under 20 lights and fails beyond the mode's bound. Returns the largest difference.
#[track_caller]
fn assert_agrees(
    gpu: &Gpu,
    maps: &PackedMaps,
    mode: TextureMode,
    level: usize,
    maps_per_pass: Option<usize>,
) -> f64 {
    let mut drawn = GpuMaps::upload(gpu, maps, mode, maps_per_pass).unwrap();
    let decoded = maps_of_level(maps, level);
    let bound = DecodingBound::new(&decoded, &maps.packing);
    let mut largest = 0.0f64;
    for light in lights(20) {
        let reference = relight(&decoded, light, CpuLevel::BASELINE);
        let difference = Difference::between(&drawn.draw(light, level).unwrap(), &reference);
        let decoding = if mode == TextureMode::Native { bound.at(light) } else { 0.0 };
        let allowed = ROUNDING * difference.full_range + decoding;
        let what = || {
            format!(
                "{:?} {mode:?} level {level} of {} {:?}",
                maps.packing.arrays[0].format,
                maps.model.basis.family().name,
                maps.model.layout
            )
        };
        assert!(difference.max <= allowed, "{}: {difference:?} beyond {allowed}", what());
        largest = largest.max(difference.max);
    }
    largest
}

#[test]
fn every_format_and_basis_in_both_modes() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    for (family, count, layout) in [
        ("ptm", 6, Layout::Rgb),
        ("hsh", 9, Layout::Lrgb),
        ("srbf", 25, Layout::Grey),
        ("sh", 16, Layout::Rgb),
    ] {
        for format in formats() {
            let maps = asset(model(family, count, layout), format, (37, 23), 1);
            let native = assert_agrees(&gpu, &maps, TextureMode::Native, 0, None);
            let decoded = assert_agrees(&gpu, &maps, TextureMode::Decoded, 0, None);
            eprintln!("{family} {layout:?} {} native {native:.2e} decoded {decoded:.2e}", format.name());
        }
    }
}
