//! The GPU draws what the reference relighter does.

use crate::assets::{asset, formats, gpu, lights, model};
use relight_core::relighter::relight;
use relight_core::{CpuLevel, Layout, RelightingMaps};
use relight_gpu::{
    Backend, DecodingBound, Difference, Gpu, GpuMaps, TextureMode, decoding_differences, decoding_tolerance,
    maps_of_level,
};
use relight_texture::{ArrayPlan, BlockFormat, PackedMaps, Precision, TexelFormat, full_levels};

/// Rounding of sums in f32, of full range.
const ROUNDING: f64 = 1e-5;

/// RGBA codes, which the GPU samples exactly.
const CODES: TexelFormat = TexelFormat::Plain { precision: Precision::U8, channels: 4 };

/// Fails where `drawn` leaves the bound at one of `count` lights.
#[track_caller]
fn assert_agrees(
    drawn: &mut GpuMaps,
    level: usize,
    (maps, bound): (&RelightingMaps, &DecodingBound),
    count: usize,
    what: &str,
) {
    for light in lights(count) {
        let reference = relight(maps, light, CpuLevel::BASELINE);
        let difference = Difference::between(&drawn.draw(light, level).unwrap(), &reference);
        let allowed = ROUNDING * difference.full_range + bound.at(light);
        assert!(difference.max <= allowed, "{what}: {difference:?} beyond {allowed}");
    }
}

/// Draws `maps` in both modes under `count` lights.
#[track_caller]
fn assert_both_modes_agree(
    gpu: &Gpu,
    maps: &PackedMaps,
    level: usize,
    maps_per_pass: Option<usize>,
    count: usize,
) {
    let reference = maps_of_level(maps, level);
    let native = DecodingBound::new(&reference, &maps.packing);
    let floats = ArrayPlan { format: CODES, ..maps.packing.arrays[0].clone() };
    let exact = DecodingBound::new(
        &reference,
        &relight_texture::Packing { arrays: vec![floats], ..maps.packing.clone() },
    );
    for (mode, bound) in [(TextureMode::Native, &native), (TextureMode::Decoded, &exact)] {
        let (format, family) = (maps.packing.arrays[0].format, maps.model.basis.family().name);
        let what = format!("{family} {:?} {} {mode:?} level {level}", maps.model.layout, format.name());
        let mut drawn = GpuMaps::upload(gpu, maps, mode, maps_per_pass).unwrap();
        assert_agrees(&mut drawn, level, (&reference, bound), count, &what);
    }
}

#[test]
fn every_format_and_three_bases_at_twenty_lights_in_both_modes() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    for (family, count, layout) in
        [("ptm", 6, Layout::Rgb), ("hsh", 9, Layout::Lrgb), ("srbf", 13, Layout::Grey)]
    {
        for format in formats() {
            let maps = asset(model(family, count, layout), format, (37, 23), 1);
            assert_both_modes_agree(&gpu, &maps, 0, None, 20);
        }
    }
}

#[test]
fn the_other_bases_and_layouts() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    for (family, count, layout) in [
        ("sh", 16, Layout::Rgb),
        ("ptm", 15, Layout::Lrgb),
        ("hsh", 16, Layout::Grey),
        ("srbf", 25, Layout::Rgb),
        ("srbf", 7, Layout::Lrgb),
        ("sh", 9, Layout::Grey),
        ("color", 10, Layout::Shared),
        ("grey", 5, Layout::Shared),
    ] {
        for format in
            [CODES, TexelFormat::Block(BlockFormat::Bc3), TexelFormat::Block(BlockFormat::Bc5Signed)]
        {
            let maps = asset(model(family, count, layout), format, (19, 9), 1);
            assert_both_modes_agree(&gpu, &maps, 0, None, 3);
        }
    }
}

#[test]
fn every_mip_level_of_odd_sizes() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    for size in [(37, 23), (1, 1), (3, 5), (130, 1), (1, 31)] {
        for format in [CODES, TexelFormat::Block(BlockFormat::Bc1), TexelFormat::Block(BlockFormat::Bc7)] {
            let levels = full_levels(size.0, size.1);
            let maps = asset(model("ptm", 6, Layout::Rgb), format, size, levels);
            for level in 0..levels {
                assert_both_modes_agree(&gpu, &maps, level, None, 2);
            }
        }
    }
}

#[test]
fn passes_sum_to_the_same_picture() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    let one_channel = TexelFormat::Plain { precision: Precision::F16, channels: 1 };
    for (layout, format) in [(Layout::Rgb, CODES), (Layout::Lrgb, one_channel), (Layout::Grey, one_channel)] {
        let maps = asset(model("hsh", 9, layout), format, (21, 13), 1);
        let reference = maps_of_level(&maps, 0);
        let bound = DecodingBound::new(&reference, &maps.packing);
        for maps_per_pass in [1, 4, 100] {
            let mut drawn = GpuMaps::upload(&gpu, &maps, TextureMode::Native, Some(maps_per_pass)).unwrap();
            assert_agrees(&mut drawn, 0, (&reference, &bound), 3, &format!("{maps_per_pass} maps a pass"));
        }
    }
}

#[test]
fn several_arrays_of_different_formats() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    let mut maps = asset(model("ptm", 6, Layout::Rgb), CODES, (37, 23), 2);
    let other = asset(maps.model.clone(), TexelFormat::Block(BlockFormat::Bc7), (37, 23), 2);
    // Four layers as codes, the other two as blocks, one of each kind out of order.
    let split = |from: &PackedMaps, layers: &[usize]| {
        let plan = &from.packing.arrays[0];
        let of_level = |level: &Vec<u8>| {
            let bytes = level.len() / plan.layers.len();
            layers.iter().flat_map(|layer| level[layer * bytes..][..bytes].to_vec()).collect::<Vec<_>>()
        };
        let picked = layers.iter().map(|layer| plan.layers[*layer].clone()).collect();
        (ArrayPlan { format: plan.format, layers: picked }, from.texels[0].iter().map(of_level).collect())
    };
    let parts = [split(&maps, &[5, 0, 3, 2]), split(&other, &[4, 1])];
    (maps.packing.arrays, maps.texels) = parts.into_iter().unzip();
    for level in [0, 1] {
        let reference = maps_of_level(&maps, level);
        let bound = DecodingBound::new(&reference, &maps.packing);
        for maps_per_pass in [None, Some(4)] {
            let mut drawn = GpuMaps::upload(&gpu, &maps, TextureMode::Native, maps_per_pass).unwrap();
            assert_agrees(&mut drawn, level, (&reference, &bound), 4, "codes and BC7");
        }
    }
}

#[test]
fn pictures_that_come_back_in_bands() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    // Each row takes 64 KiB on its way back: 1024 rows are a band.
    let format = TexelFormat::Plain { precision: Precision::U8, channels: 1 };
    let maps = asset(model("ptm", 6, Layout::Grey), format, (4096, 1030), 1);
    let reference = maps_of_level(&maps, 0);
    let bound = DecodingBound::new(&reference, &maps.packing);
    let mut drawn = GpuMaps::upload(&gpu, &maps, TextureMode::Native, Some(5)).unwrap();
    assert_agrees(&mut drawn, 0, (&reference, &bound), 1, "4096 x 1030");
}

#[test]
fn what_the_adapter_decodes_is_within_the_stated_tolerance() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    assert_decodes(&gpu);
}

/// Fails where the adapter's decoding of a layer leaves the format's tolerance.
#[track_caller]
fn assert_decodes(gpu: &Gpu) {
    for format in formats() {
        let maps = asset(model("ptm", 6, Layout::Rgb), format, (37, 23), 3);
        if !gpu.samples(format) {
            eprintln!("not sampled: {}", format.name());
            continue;
        }
        for level in 0..3 {
            let differences = decoding_differences(gpu, &maps, level).unwrap();
            assert_eq!(differences.len(), maps.packing.layers());
            for difference in differences {
                // Codes become floats by another product than ours.
                let allowed = decoding_tolerance(format) + 1e-6;
                assert!(difference.max <= allowed, "level {level}: {difference:?}");
                assert!(difference.mean <= difference.max);
            }
        }
    }
}

#[test]
fn opengl_draws_the_same() {
    let Some(gpu) = gpu_of_opengl() else { return };
    assert_decodes(&gpu);
    for format in formats() {
        let maps = asset(model("ptm", 6, Layout::Rgb), format, (37, 23), 2);
        for level in [0, 1] {
            assert_both_modes_agree(&gpu, &maps, level, None, 3);
        }
    }
    let maps = asset(model("hsh", 9, Layout::Lrgb), CODES, (37, 23), 1);
    assert_both_modes_agree(&gpu, &maps, 0, Some(2), 3);
    // Arrays of one layer.
    let maps = asset(model("hsh", 4, Layout::Grey), CODES, (37, 23), 1);
    assert_both_modes_agree(&gpu, &maps, 0, None, 3);
    // Squares of six layers and of twelve, which are no cubes.
    for (count, layout) in [(6, Layout::Rgb), (10, Layout::Lrgb), (15, Layout::Lrgb)] {
        for format in [CODES, TexelFormat::Block(BlockFormat::Bc4)] {
            let maps = asset(model("ptm", count, layout), format, (32, 32), 2);
            assert_both_modes_agree(&gpu, &maps, 0, None, 3);
            assert_both_modes_agree(&gpu, &maps, 1, None, 3);
        }
    }
}

/// An adapter behind OpenGL, which no one requires.
fn gpu_of_opengl() -> Option<Gpu> {
    match Gpu::open(Backend::Gl) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}
