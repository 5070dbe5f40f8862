//! What many points reflect, in f32, against exact irradiance.

use crate::{COLOR, Random, disc, dot, light, sphere};
use relight_core::CpuLevel;
use relight_core::vectors::{frame_around, unit};
use relight_rig::{CutDiscs, Light, Source, SurfaceRows, add_reflectance};
use std::f64::consts::PI;

/// Points and normals, row by row.
struct Points([Vec<f32>; 6]);

impl Points {
    fn new(count: usize, random: &mut Random, offset: f64) -> Self {
        let mut rows = [const { Vec::new() }; 6];
        for _ in 0..count {
            let (point, normal) = (random.vector().map(|c| 0.8 * c + offset), random.direction());
            for (row, value) in rows.iter_mut().zip(point.into_iter().chain(normal)) {
                row.push(value as f32);
            }
        }
        Self(rows)
    }

    fn rows(&self, from: usize, to: usize) -> SurfaceRows<'_> {
        let [x, y, z, nx, ny, nz] = [0, 1, 2, 3, 4, 5].map(|i| &self.0[i][from..to]);
        SurfaceRows { x, y, z, nx, ny, nz }
    }

    fn reflectance(&self, light: &Light, cut: CutDiscs, level: CpuLevel, strips: usize) -> [Vec<f32>; 3] {
        let count = self.0[0].len();
        // Something to add to.
        let mut out = [vec![0.25f32; count], vec![0.5; count], vec![1.0; count]];
        for from in (0..count).step_by(strips) {
            let to = count.min(from + strips);
            let [r, g, b] = &mut out;
            add_reflectance(
                light,
                cut,
                level,
                &self.rows(from, to),
                [&mut r[from..to], &mut g[from..to], &mut b[from..to]],
            );
        }
        out
    }

    fn exact(&self, light: &Light, i: usize) -> [f64; 3] {
        let [x, y, z, nx, ny, nz] = [0, 1, 2, 3, 4, 5].map(|k| f64::from(self.0[k][i]));
        let irradiance = light.irradiance([x, y, z], [nx, ny, nz]);
        [0, 1, 2].map(|c| [0.25, 0.5, 1.0][c] + irradiance[c] / PI)
    }
}

/// The largest error over the largest value.
fn error(light: &Light, points: &Points) -> f64 {
    let found = points.reflectance(light, CutDiscs::Exact, CpuLevel::detect(), 1000);
    let (mut worst, mut most) = (0.0f64, 0.0f64);
    for (channel, found) in found.iter().enumerate() {
        for (i, &found) in found.iter().enumerate() {
            let exact = points.exact(light, i)[channel];
            worst = worst.max((f64::from(found) - exact).abs());
            most = most.max(exact);
        }
    }
    worst / most
}

#[test]
fn every_kind_is_exact_irradiance() {
    let mut random = Random(31);
    let points = Points::new(500, &mut random, 0.0);
    for _ in 0..200 {
        let light = random.light();
        let error = error(&light, &points);
        assert!(error < 1e-6, "{light:?}: {error}");
    }
}

/// Touched, entered, cut by the horizon all over, and right in front of a disc.
#[test]
fn near_lights() {
    let mut random = Random(32);
    let points = Points::new(2000, &mut random, 0.0);
    let normal = random.direction();
    let lights = [
        (sphere([0.3, 0.2, 0.1], 0.5), 4e-4),
        (sphere([0.0, 0.0, 3.0], 2.5), 4e-6),
        (sphere([0.0, 0.0, 30.0], 29.9), 1e-3),
        (disc([0.1, 0.2, -0.1], normal, 0.5), 4e-6),
        (disc([0.0, 0.0, 0.9], [0.0, 0.0, -1.0], 40.0), 4e-6),
        (light(Source::Point { position: [0.0; 3], nearest: 0.3 }), 1e-6),
    ];
    for (light, bound) in lights {
        let error = error(&light, &points);
        println!("{:?}: {error:.1e}", light.source);
        assert!(error < bound, "{light:?}: {error}");
    }
}

#[test]
fn far_origins_and_radii_of_any_size() {
    let mut random = Random(33);
    let points = Points::new(300, &mut random, 0.0);
    let tiny = Light { color: COLOR.map(|c| c * 1e60), ..sphere([1.5, -2.0, 1.0], 1e-30) };
    let flat = Light { color: COLOR.map(|c| c * 1e60), ..disc([1.5, -2.0, 1.0], [0.0, 0.6, -0.8], 1e-30) };
    let huge = sphere([0.0, 0.0, -2e30], 1e30);
    for light in [tiny, flat, huge] {
        let error = error(&light, &points);
        assert!(error < 1e-6, "{light:?}: {error}");
    }
    // f32 has steps of 1/16 at a million; the light's place has them not.
    let points = Points::new(300, &mut random, 1e6);
    let near = 1e6 + 1.03;
    for light in [sphere([near, 1e6, 1e6], 0.1), disc([near, 1e6, 1e6], [-1.0, 0.0, 0.0], 0.1)] {
        let error = error(&light, &points);
        assert!(error < 1e-6, "{light:?}: {error}");
    }
}

#[test]
fn any_level_and_any_split_give_the_same_bits() {
    let mut random = Random(34);
    let points = Points::new(333, &mut random, 0.0);
    for _ in 0..60 {
        let light = random.light();
        for cut in [CutDiscs::Exact, CutDiscs::Fast] {
            let expected = points.reflectance(&light, cut, CpuLevel::BASELINE, 333);
            for level in CpuLevel::available() {
                for strips in [333, 29] {
                    let found = points.reflectance(&light, cut, level, strips);
                    assert_eq!(found, expected, "{light:?} {cut:?} {}", level.name());
                }
            }
        }
    }
}

/// Discs that every horizon cuts somewhere: within 2e-4 of what they give at most from there, from 2 radii to far away, seen
/// edge-on and from in front, with a sliver above the horizon or below it. Nearer ones are exact.
#[test]
fn discs_that_the_horizon_cuts_side_by_side() {
    let mut random = Random(36);
    let bounds =
        [(1.0f64, 2.0, 1e-6), (2.0, 3.0, 2e-4), (3.0, 4.0, 2e-4), (4.0, 6.0, 2e-4), (6.0, 8.0, 2e-4)];
    for (from, to, bound) in bounds.into_iter().chain([(8.0, 30.0, 2e-4), (30.0, 1e4, 2e-4)]) {
        let (mut worst, mut count) = (0.0f64, 0);
        for case in 0..400 {
            let towards = random.direction();
            let distance = from * libm::pow(to / from, random.number().abs());
            let centre = towards.map(|c| c * distance);
            // Every fourth is seen nearly from the side.
            let tilt = if case % 4 == 0 { 1e-3 } else { 1.0 };
            let [x, y] = frame_around(towards);
            let (turn, rise) = (6.3 * random.number().abs(), tilt * random.number().abs());
            let aside = [0, 1, 2].map(|i| libm::cos(turn) * x[i] + libm::sin(turn) * y[i]);
            let axis = unit([0, 1, 2].map(|i| aside[i] - rise * towards[i])).unwrap();
            let light = Light { color: COLOR.map(|c| c * distance * distance), ..disc(centre, axis, 1.0) };
            let mut points = Points::new(64, &mut random, 0.0);
            for i in 0..64 {
                let [x, y] = frame_around(axis);
                let turn = 6.3 * random.number().abs();
                // The horizon goes through a place on the disc.
                let far =
                    [0.0, 0.5, 0.999, 1.0][i % 4] * if i % 3 == 0 { random.number().abs() } else { 1.0 };
                let place =
                    [0, 1, 2].map(|k| centre[k] + far * (libm::cos(turn) * x[k] + libm::sin(turn) * y[k]));
                let [a, b] = frame_around(unit(place).unwrap());
                let turn = 6.3 * random.number().abs();
                let normal = [0, 1, 2].map(|k| libm::cos(turn) * a[k] + libm::sin(turn) * b[k]);
                let values = [0.0; 3].into_iter().chain(normal);
                points.0.iter_mut().zip(values).for_each(|(row, value)| row[i] = value as f32);
            }
            // Turned towards a point that faces it.
            let facing = disc(centre, towards.map(|c| -c), 1.0).irradiance([0.0; 3], towards)[1] / PI;
            let facing = facing * distance * distance;
            let found = points.reflectance(&light, CutDiscs::Fast, CpuLevel::detect(), 64);
            for (i, found) in found[1].iter().enumerate() {
                let normal = [3, 4, 5].map(|k| f64::from(points.0[k][i]));
                let (middle, aside) = (dot(normal, centre), dot(normal, axis));
                count += usize::from(middle.abs() < (1.0 - aside * aside).sqrt());
                let error = (f64::from(*found) - points.exact(&light, i)[1]).abs();
                worst = worst.max(error / facing);
            }
        }
        println!("{from} to {to} radii: {worst:.1e} of {count}");
        assert!(worst < bound, "{from} to {to}: {worst}");
        assert!(count > 15_000, "{count} are cut");
    }
}

/// Lights below every horizon add nothing, to the bit.
#[test]
fn all_lights_behind() {
    let mut random = Random(35);
    let mut points = Points::new(200, &mut random, 0.0);
    for (row, value) in points.0[3..].iter_mut().zip([0.0, 0.0, -1.0]) {
        row.fill(value);
    }
    let lights = [
        sphere([0.5, 0.0, 4.0], 1.0),
        disc([0.5, 0.0, 4.0], [0.6, 0.0, -0.8], 1.0),
        light(Source::Point { position: [0.0, 0.0, 3.0], nearest: 0.1 }),
        light(Source::Directional { direction: [0.0, 0.6, 0.8] }),
    ];
    for light in lights {
        let found = points.reflectance(&light, CutDiscs::Fast, CpuLevel::detect(), 200);
        for (row, value) in found.iter().zip([0.25, 0.5, 1.0]) {
            assert!(row.iter().all(|&v| v == value), "{light:?}");
        }
    }
}
