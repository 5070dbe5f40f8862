//! The same bits at every instruction set level and with any number of threads.

use crate::pictures::{Pictures, basis_of, dome, fit_of, model_of, random};
use relight_core::{CpuLevel, Layout};
use relight_fit::{LightWeights, Ridge, coefficient_ranges, fit_map};

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
        let ranges = |level, threads| {
            let check = || Ok::<(), relight_fit::FitError>(());
            pool(threads).install(|| coefficient_ranges(&pictures, &fit, layout, level, check)).unwrap()
        };
        let (expected, expected_ranges) = (map(CpuLevel::BASELINE, 1), ranges(CpuLevel::BASELINE, 1));
        for level in CpuLevel::available() {
            for threads in [1, 2, 5] {
                let name = level.name();
                assert!(map(level, threads) == expected, "{layout:?} at {name} with {threads} threads");
                assert_eq!(
                    ranges(level, threads),
                    expected_ranges,
                    "{layout:?} at {name}, {threads} threads"
                );
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
