//! The same bits at every instruction set level and with any number of threads.

use crate::pictures::{Pictures, basis_of, dome, fit_of, model_of, random};
use relight_core::{CpuLevel, Layout};
use relight_fit::{FitError, LightWeights, Ridge, coefficient_distributions, fit_map, for_each_span};
use std::sync::Mutex;

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn maps_have_the_same_bits_at_every_level_and_with_any_threads() {
    let lights = dome(50);
    let basis = basis_of("srbf", 13, &lights);
    for (layout, channels) in [(Layout::Grey, 1), (Layout::Rgb, 3), (Layout::Lrgb, 3)] {
        let pictures = Pictures::of((50, (91, 101), channels), |light, pixel, channel| {
            0.5 + 0.5 * random(light * 3 + channel, pixel)
        });
        let fit = fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Auto, &pictures);
        let map = |level, threads| {
            let model = model_of(&basis, layout);
            let map = pool(threads).install(|| fit_map(&pictures, &fit, model, level)).unwrap();
            map.planes.iter().flatten().map(|value| value.to_bits()).collect::<Vec<u32>>()
        };
        let distributions = |level, threads| {
            let check = || Ok::<(), FitError>(());
            let found = || coefficient_distributions(&pictures, (&fit, layout), level, check);
            pool(threads).install(found).unwrap()
        };
        let (expected, of_one) = (map(CpuLevel::BASELINE, 1), distributions(CpuLevel::BASELINE, 1));
        for level in CpuLevel::available() {
            for threads in [1, 2, 5] {
                let name = level.name();
                assert!(map(level, threads) == expected, "{layout:?} at {name} with {threads} threads");
                assert!(distributions(level, threads) == of_one, "{layout:?} at {name}, {threads} threads");
            }
        }
        if layout != Layout::Lrgb {
            // The textbook product: terms in order, in f32, nothing fused.
            let solution = fit.solution_f32();
            let samples = 91 * 101 * channels;
            for (j, row) in solution.chunks_exact(50).enumerate() {
                for s in (0..samples).step_by(7) {
                    let sum = row.iter().zip(&pictures.rows).fold(0.0f32, |sum, (w, p)| sum + w * p[s]);
                    let at = (j * channels + s % channels) * 91 * 101 + s / channels;
                    assert_eq!(expected[at], sum.to_bits(), "{layout:?} function {j} sample {s}");
                }
            }
        }
    }
}

#[test]
fn coefficients_have_the_same_bits_in_spans_of_any_size() {
    let lights = dome(21);
    let basis = basis_of("ptm", 6, &lights);
    let (width, height) = (93, 95);
    for (layout, channels) in [(Layout::Grey, 1), (Layout::Rgb, 3), (Layout::Lrgb, 3)] {
        let pictures = Pictures::of((21, (width, height), channels), |light, pixel, channel| {
            0.5 + 0.5 * random(light * 3 + channel, pixel)
        });
        let fit = fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Auto, &pictures);
        let map = fit_map(&pictures, &fit, model_of(&basis, layout), CpuLevel::BASELINE).unwrap();
        let functions = layout.planes_per_map();
        for span_pixels in [1, 37, 4 * width, 32 * width, usize::MAX] {
            let seen = Mutex::new(0);
            for_each_span(&pictures, (&fit, layout), CpuLevel::detect(), span_pixels, |span| {
                assert!(span.first.is_multiple_of(span_pixels) && span.pixels <= span_pixels);
                *seen.lock().unwrap() += span.pixels;
                for (plane, values) in map.planes.iter().enumerate() {
                    for (x, expected) in values[span.first..][..span.pixels].iter().enumerate() {
                        let found = match plane.checked_sub(6 * functions) {
                            Some(channel) => span.base_color[3 * x + channel],
                            None => {
                                let row = &span.maps[plane / functions * span.pixels * functions..];
                                row[x * functions + plane % functions]
                            }
                        };
                        assert_eq!(found.to_bits(), expected.to_bits(), "{layout:?} {span_pixels} {plane}");
                    }
                }
                Ok::<(), FitError>(())
            })
            .unwrap();
            assert_eq!(seen.into_inner().unwrap(), width * height, "{layout:?} {span_pixels}");
        }
    }
}

#[test]
fn solutions_and_judgements_have_the_same_bits_with_any_threads() {
    let lights = dome(40);
    let basis = basis_of("sh", 16, &lights);
    let pictures = Pictures::of((40, (131, 97), 3), |light, pixel, channel| {
        0.5 + 0.5 * random(light * 3 + channel, pixel)
    });
    let fits = [1, 2, 5].map(|threads| {
        pool(threads).install(|| fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Auto, &pictures))
    });
    for fit in &fits[1..] {
        assert_eq!(bits(&fit.solution), bits(&fits[0].solution));
        assert_eq!(bits(&fit.leave_one_out.left_out), bits(&fits[0].leave_one_out.left_out));
        assert_eq!(fit.figures, fits[0].figures);
        assert_eq!(fit.ridge, fits[0].ridge);
    }
}
