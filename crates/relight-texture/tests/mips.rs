//! Mip levels against the area that a texel covers, and against relit pictures.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

use relight_core::basis::FAMILIES;
use relight_core::maps::{RelightingMap, Texels};
use relight_core::relighter::relight;
use relight_core::sphere::Cap;
use relight_core::sphere::{fibonacci, fibonacci_in};
use relight_core::{CpuLevel, Design, Direction, Layout, LightSet, Model, RelightingMaps, Space};
use relight_texture::mips::{MipFilter, halve};
use relight_texture::{full_levels, level_size};

const SIZES: [(usize, usize); 14] = [
    (1, 1),
    (2, 1),
    (1, 2),
    (3, 1),
    (1, 3),
    (5, 3),
    (3, 5),
    (7, 8),
    (8, 7),
    (16, 16),
    (37, 29),
    (1, 4097),
    (4097, 1),
    (63, 65),
];

/// A value in -1..1 of its own for every texel.
fn lopsided(seed: usize, count: usize) -> Vec<f32> {
    let value = |i: usize| {
        let bits = ((seed * 1_000_003 + i + 1) as u32).wrapping_mul(0x9e37_79b9);
        (bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b) as f32 / 2_147_483_648.0 - 1.0
    };
    (0..count).map(value).collect()
}

/// How much of texel j of `next` lies over texel i of `size`, as parts of texel j.
fn coverage(size: usize, next: usize, j: usize) -> Vec<(usize, f64)> {
    let width = size as f64 / next as f64;
    let (start, end) = (j as f64 * width, (j + 1) as f64 * width);
    let overlap = |i: usize| (end.min((i + 1) as f64) - start.max(i as f64)).max(0.0) / width;
    let first = start as usize;
    (first..size.min(first + 4)).map(|i| (i, overlap(i))).collect()
}

#[test]
fn every_texel_is_the_mean_of_the_area_that_it_covers() {
    for (width, height) in SIZES {
        let plane = lopsided(width, width * height);
        let next = halve(&plane, width, height);
        let (w, h) = (level_size(width, 1), level_size(height, 1));
        assert_eq!(next.len(), w * h);
        for (i, value) in next.iter().enumerate() {
            let mut expected = 0.0;
            for (y, in_y) in coverage(height, h, i / w) {
                for (x, in_x) in coverage(width, w, i % w) {
                    expected += in_x * in_y * f64::from(plane[y * width + x]);
                }
            }
            assert!(
                (f64::from(*value) - expected).abs() < 3e-7,
                "{width} x {height}, {i}: {value} {expected}"
            );
        }
    }
}

#[test]
fn chains_of_odd_sizes_keep_the_mean_and_constants_down_to_one_texel() {
    for (width, height) in SIZES {
        let mut plane = lopsided(height, width * height);
        let mean = |plane: &[f32]| plane.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.len() as f64;
        let (expected, mut constant) = (mean(&plane), vec![0.3f32; width * height]);
        for level in 0..full_levels(width, height) - 1 {
            let (w, h) = (level_size(width, level), level_size(height, level));
            plane = halve(&plane, w, h);
            constant = halve(&constant, w, h);
            assert!((mean(&plane) - expected).abs() < 1e-6, "{width} x {height} level {level}");
            assert!(constant.iter().all(|v| (v - 0.3).abs() < 3e-7), "{width} x {height} level {level}");
        }
        assert_eq!((plane.len(), constant.len()), (1, 1));
    }
}

#[test]
fn strips_in_any_order_give_the_bits_of_the_whole_level() {
    for (width, height) in SIZES {
        for channels in [1, 3] {
            let filter = MipFilter::new(width, height, channels);
            let source = lopsided(7, width * height * channels);
            let stride = level_size(width, 1) * channels;
            let mut whole = vec![0.0; stride * level_size(height, 1)];
            filter.add_rows(0, &source, &mut whole);
            for strip in [4, 8, 12] {
                let mut strips: Vec<usize> = (0..height).step_by(strip).collect();
                for turn in 0..3 {
                    let mut next = vec![0.0; whole.len()];
                    for &first in &strips {
                        let rows = first..height.min(first + strip);
                        let below = filter.rows_from(rows.clone());
                        let samples = &source[rows.start * width * channels..rows.end * width * channels];
                        let part = &mut next[below.start * stride..below.end * stride];
                        filter.add_rows(first, samples, part);
                    }
                    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                    assert!(bits(&next) == bits(&whole), "{width} x {height}, strips of {strip}, {turn}");
                    match turn {
                        0 => strips.reverse(),
                        _ => strips.sort_by_key(|first| (first / strip * 7 % 5, *first)),
                    }
                }
            }
        }
    }
}

#[test]
fn interleaved_channels_are_filtered_each_for_itself() {
    for (width, height) in SIZES {
        let planes: Vec<Vec<f32>> = (0..3).map(|c| lopsided(c + 11, width * height)).collect();
        let interleaved: Vec<f32> = (0..width * height * 3).map(|i| planes[i % 3][i / 3]).collect();
        let mut next = vec![0.0; level_size(width, 1) * level_size(height, 1) * 3];
        MipFilter::new(width, height, 3).add_rows(0, &interleaved, &mut next);
        for (channel, plane) in planes.iter().enumerate() {
            let expected = halve(plane, width, height);
            let found: Vec<f32> = next[channel..].iter().step_by(3).copied().collect();
            assert_eq!(found, expected, "{width} x {height} channel {channel}");
        }
    }
}

#[test]
fn mips_of_the_coefficients_relit_are_mips_of_the_relit_picture() {
    let (width, height) = (37, 22);
    let hemisphere = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.5 }, 60);
    let set = LightSet::from_directions(hemisphere.clone());
    let mut seen = 0;
    for family in FAMILIES.iter().filter(|family| !family.learned) {
        for count in family.counts_up_to(25) {
            let basis = family.build(&Design::new(count, &set)).unwrap();
            for layout in [Layout::Grey, Layout::Rgb] {
                let space = Space::Linear;
                let model = Model {
                    basis: basis.clone(),
                    layout,
                    space,
                    lights: Vec::new(),
                    figures: None,
                    provenance: None,
                };
                let planes: Vec<Vec<f32>> =
                    (0..model.plane_count()).map(|p| lopsided(p + 1, width * height)).collect();
                let maps = |planes: &[Vec<f32>], level: usize| {
                    let map = |plane: &Vec<f32>| RelightingMap {
                        scale: 1.0,
                        bias: 0.0,
                        texels: Texels::F32(plane.clone()),
                    };
                    let (width, height) = (level_size(width, level), level_size(height, level));
                    let planes = planes.iter().map(map).collect();
                    RelightingMaps { width, height, model: model.clone(), planes }
                };
                let halved: Vec<_> = planes.iter().map(|plane| halve(plane, width, height)).collect();
                let (fine, coarse) = (maps(&planes, 0), maps(&halved, 1));
                for light in hemisphere.iter().step_by(23).chain(&fibonacci(3)) {
                    let fine = relight(&fine, *light, CpuLevel::detect());
                    let coarse = relight(&coarse, *light, CpuLevel::detect());
                    let mut expected = vec![0.0; coarse.samples.len()];
                    MipFilter::new(width, height, fine.channels).add_rows(0, &fine.samples, &mut expected);
                    let largest = expected.iter().fold(1.0f32, |a, b| a.max(b.abs()));
                    for (i, (found, expected)) in coarse.samples.iter().zip(&expected).enumerate() {
                        let error = (found - expected).abs();
                        assert!(error < 3e-6 * largest, "{} {count} {i}: {error:e}", family.name);
                    }
                    seen += 1;
                }
            }
        }
    }
    assert!(seen > 400, "{seen}");
}
