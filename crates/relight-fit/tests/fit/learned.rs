//! Learned planes: pictures of known planes, what is hard about them, and the same bits everywhere.

use crate::pictures::{Pictures, basis_of, direction, dome, fit_of, random, relit, rms_error};
use relight_core::{Basis, CoefficientMap, CpuLevel, Direction, Layout, Model, Space};
use relight_fit::{
    ChannelSample, FitError, LearnedDesign, LearnedFit, LeastSquares, LightWeights, Ridge, SPAN,
    coefficient_distributions, fit_map, for_each_span, misfits,
};
use std::sync::Mutex;

fn design(planes: usize) -> LearnedDesign {
    LearnedDesign { planes, opponent: false, target_psnr: None }
}

fn learned(lights: &[Direction], design: LearnedDesign, pictures: &Pictures) -> LearnedFit {
    LearnedFit::new(lights, design, &ChannelSample::of(pictures).unwrap()).unwrap()
}

/// The planes of every pixel, in spans of `span_pixels`.
fn planes_of(pictures: &Pictures, fit: &LearnedFit, level: CpuLevel, span_pixels: usize) -> CoefficientMap {
    let (width, height) = pictures.size;
    let model = Model {
        basis: Basis::Learned(fit.basis.clone()),
        layout: Layout::Shared,
        space: Space::Linear,
        lights: Vec::new(),
        figures: None,
        provenance: None,
    };
    let planes = Mutex::new(vec![vec![0.0; width * height]; model.plane_count()]);
    for_each_span(pictures, fit, level, span_pixels, |span| {
        let mut planes = planes.lock().unwrap();
        for (plane, row) in planes.iter_mut().zip(span.maps.chunks_exact(span.pixels)) {
            plane[span.first..][..span.pixels].copy_from_slice(row);
        }
        Ok::<(), FitError>(())
    })
    .unwrap();
    CoefficientMap { width, height, planes: planes.into_inner().unwrap(), model }
}

/// Pictures of a mean and two planes, whose weights are linear in the light's direction and differ by channel.
fn two_planes(lights: &[Direction], size: (usize, usize), channels: usize) -> Pictures {
    let weight = |light: usize, plane: usize, channel: usize| {
        let [x, y, z] = lights[light].components();
        let of = |i: usize| random(10 * plane + i, channel);
        of(0) + of(1) * x + of(2) * y + of(3) * z
    };
    Pictures::of((lights.len(), size, channels), |light, pixel, channel| {
        let plane = |p: usize| weight(light, p, channel) * random(50 + p, pixel);
        weight(light, 9, channel) + plane(1) + 0.3 * plane(2)
    })
}

#[test]
fn pictures_of_two_planes_come_back_under_their_lights_and_between_them() {
    let lights = dome(40);
    let between: Vec<Direction> = dome(23).into_iter().map(|d| direction(-d.y(), d.x(), d.z())).collect();
    for channels in [1, 3] {
        let size = (33, 21);
        let fit = learned(&lights, design(2), &two_planes(&lights, size, channels));
        assert_eq!(fit.basis.planes(), 2);
        assert!((fit.energy.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{:?}", fit.energy);
        assert!(fit.energy[0] > fit.energy[1] && fit.figures.leave_one_out_rmse < 1e-3);
        let map = planes_of(&two_planes(&lights, size, channels), &fit, CpuLevel::detect(), SPAN);
        for lights in [&lights, &between] {
            // What is left is the table's own: bilinear, in halves.
            let error = rms_error(&map, lights, &two_planes(lights, size, channels));
            assert!(error < 2e-3, "{channels} channels: {error}");
        }
    }
}

#[test]
fn one_plane_less_costs_what_its_energy_says_and_leaving_out_says_so() {
    let lights = dome(40);
    let pictures = two_planes(&lights, (64, 64), 3);
    let [one, two] = [1, 2].map(|planes| learned(&lights, design(planes), &pictures));
    let map = planes_of(&pictures, &one, CpuLevel::detect(), SPAN);
    let error = rms_error(&map, &lights, &pictures);
    assert!(error > 10.0 * two.figures.fit_rmse);
    assert!((error / one.figures.fit_rmse - 1.0).abs() < 0.02, "{error} {:?}", one.figures);
    assert!((error / one.figures.leave_one_out_rmse - 1.0).abs() < 0.1, "{error} {:?}", one.figures);
    // The fewest planes that reach a figure are taken; what none reach is an error with the best.
    let psnr = one.leave_one_out.left_out_psnr();
    let asking = |planes, target| {
        let design = LearnedDesign { planes, opponent: false, target_psnr: Some(target) };
        LearnedFit::new(&lights, design, &ChannelSample::of(&pictures).unwrap())
    };
    assert_eq!(asking(5, psnr - 0.01).unwrap().basis.planes(), 1);
    assert_eq!(asking(5, psnr + 0.01).unwrap().basis.planes(), 2);
    assert!(matches!(asking(1, psnr + 0.01), Err(FitError::OutOfReach { .. })));
}

#[test]
fn planes_have_the_same_bits_at_every_level_in_any_span_and_with_any_threads() {
    let lights = dome(31);
    for channels in [1, 3] {
        let pictures = Pictures::of((31, (91, 47), channels), |light, pixel, channel| {
            0.5 + 0.5 * random(light * 3 + channel, pixel)
        });
        let found = |threads: usize, level, span| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let fit = learned(&lights, design(7), &pictures);
                let map = planes_of(&pictures, &fit, level, span);
                let check = || Ok::<(), FitError>(());
                let ranges = coefficient_distributions(&pictures, &fit, level, check).unwrap();
                let bits: Vec<u32> = map.planes.iter().flatten().map(|value| value.to_bits()).collect();
                let table: Vec<u32> = fit.basis.table().iter().map(|value| value.to_bits()).collect();
                (bits, table, ranges)
            })
        };
        let expected = found(1, CpuLevel::BASELINE, SPAN);
        for level in CpuLevel::available() {
            assert!(found(3, level, 37) == expected, "{}", level.name());
        }
        // The textbook product: terms in order, in f32, nothing fused.
        let fit = learned(&lights, design(7), &pictures);
        for (plane, row) in fit.projection.chunks_exact(31 * channels).enumerate() {
            for pixel in (0..91 * 47).step_by(11) {
                let value = |at: usize| pictures.rows[at / channels][pixel * channels + at % channels];
                let terms = row.iter().enumerate();
                let sum = terms.fold(0.0f32, |sum, (at, p)| sum + *p as f32 * value(at));
                assert_eq!(expected.0[plane * 91 * 47 + pixel], sum.to_bits(), "plane {plane} pixel {pixel}");
            }
        }
    }
}

/// The fit's own picture and the planes', at a pixel.
fn compared(fit: &LeastSquares, planes: &LearnedFit, lights: &[Direction], pictures: &Pictures) -> f64 {
    let layout = if pictures.channels == 3 { Layout::Rgb } else { Layout::Grey };
    let model = Model {
        basis: fit.basis.clone(),
        layout,
        space: Space::Linear,
        lights: Vec::new(),
        figures: None,
        provenance: None,
    };
    let full = fit_map(pictures, fit, model, CpuLevel::detect()).unwrap();
    let shared = planes_of(pictures, planes, CpuLevel::detect(), SPAN);
    let mut worst = 0.0f64;
    for light in lights {
        for pixel in 0..pictures.size.0 * pictures.size.1 {
            for channel in 0..pictures.channels {
                let difference =
                    relit(&full, *light, pixel, channel) - relit(&shared, *light, pixel, channel);
                worst = worst.max(difference.abs());
            }
        }
    }
    worst
}

#[test]
fn all_planes_of_a_fit_are_the_fit_and_few_planes_are_most_of_it() {
    let lights = dome(40);
    let between = dome(17);
    for (name, count) in [("ptm", 6), ("sh", 9), ("hsh", 9), ("srbf", 12)] {
        let pictures = two_planes(&lights, (19, 17), 3);
        let fit =
            fit_of(&basis_of(name, count, &lights), &lights, LightWeights::Voronoi, Ridge::Auto, &pictures);
        let sample = ChannelSample::of(&pictures).unwrap();
        let factored = |planes| LearnedFit::factored(&fit, &lights, design(planes), &sample).unwrap();
        // Two planes and a mean made the pictures: more carry next to nothing.
        for planes in [2, 128] {
            let shared = factored(planes);
            assert!(shared.basis.planes() <= 3 * count);
            let worst = compared(&fit, &shared, &between, &pictures);
            assert!(worst < 0.03, "{name} in {planes} planes: {worst}");
        }
        assert!(compared(&fit, &factored(1), &between, &pictures) > 0.05, "{name} in one plane");
    }
}

#[test]
fn opponent_planes_are_luminance_or_chrominance() {
    let lights = dome(30);
    let pictures = two_planes(&lights, (40, 40), 3);
    let design = LearnedDesign { planes: 4, opponent: true, target_psnr: None };
    let fit = learned(&lights, design, &pictures);
    let mut kinds = [0; 2];
    for row in fit.projection.chunks_exact(30 * 3) {
        let (mut luminance, mut chrominance) = (0.0f64, 0.0f64);
        for rgb in row.chunks_exact(3) {
            let mean = rgb.iter().sum::<f64>() / 3.0;
            luminance += 3.0 * mean * mean;
            chrominance += rgb.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>();
        }
        let part = luminance / (luminance + chrominance);
        assert!(!(1e-9..1.0 - 1e-9).contains(&part), "{part}");
        kinds[usize::from(part < 0.5)] += 1;
    }
    assert!(kinds[0] > 0 && kinds[1] > 0, "{kinds:?}");
}

#[test]
fn fewer_lights_than_planes_leave_as_many_planes_as_there_are() {
    for count in [1, 2, 3, 5] {
        let lights = dome(count);
        let pictures = Pictures::of((count, (30, 30), 3), |light, pixel, channel| {
            0.5 + 0.5 * random(light * 3 + channel, pixel)
        });
        let fit = learned(&lights, design(40), &pictures);
        assert_eq!(fit.basis.planes(), 3 * count);
        let map = planes_of(&pictures, &fit, CpuLevel::detect(), SPAN);
        // Random pictures are smoothed: their planes are exact, their directions are not.
        let (error, expected) = (rms_error(&map, &lights, &pictures), fit.figures.fit_rmse);
        assert!((error - expected).abs() < 0.1 * expected + 0.03, "{count} lights: {error} {expected}");
    }
}

#[test]
fn constant_black_and_repeated_pictures_have_finite_planes() {
    let ring: Vec<Direction> =
        (0..10).map(|i| Direction::from_azimuth_elevation(f64::from(i) * 0.6, 0.5).unwrap()).collect();
    let twice = [dome(7), dome(7)].concat();
    for lights in [dome(20), ring, twice, vec![Direction::OUT; 6]] {
        for level in [0.0, 0.25] {
            let pictures = Pictures::of((lights.len(), (9, 9), 3), |_, _, _| level);
            let fit = learned(&lights, design(5), &pictures);
            let map = planes_of(&pictures, &fit, CpuLevel::detect(), SPAN);
            assert!(map.planes.iter().flatten().all(|value| value.is_finite()));
            assert!(rms_error(&map, &lights, &pictures) < 1e-3, "{} lights, {level}", lights.len());
            assert!(fit.leave_one_out.left_out.iter().all(|rmse| *rmse < 1e-3));
        }
    }
}

#[test]
fn one_corrupted_light_among_fifty_is_flagged_and_stands_out_left_out() {
    let lights = dome(50);
    let mut pictures = two_planes(&lights, (64, 64), 3);
    for (pixel, value) in pictures.rows[31].iter_mut().enumerate() {
        *value = 0.5 + 0.5 * random(7, pixel) as f32;
    }
    let sample = ChannelSample::of(&pictures).unwrap();
    let set = relight_core::LightSet::from_directions(lights.clone());
    let found = misfits(&set, &sample.of_pictures).unwrap();
    let worst = found.iter().max_by(|a, b| a.rmse.total_cmp(&b.rmse)).unwrap();
    assert_eq!(worst.light, 31);
    let fit = learned(&lights, design(2), &pictures);
    let mut errors = fit.leave_one_out.left_out;
    let of_it = errors[31];
    errors.sort_by(f64::total_cmp);
    assert!(of_it == errors[49] && of_it > 3.0 * errors[25], "{of_it} {errors:?}");
}
