//! Pictures made from known coefficients give them back, for every basis in the table.

use crate::pictures::{basis_of, dome, fit_of, lopsided, model_of, pictures_of, weights_of};
use nalgebra::DMatrix;
use relight_core::basis::FAMILIES;
use relight_core::{Basis, CoefficientCounter, CoefficientMap, CpuLevel, Direction, FitFigures, Layout};
use relight_core::{Model, sphere};
use relight_fit::{
    Decomposition, FitError, LeastSquares, LeaveOneOut, LightWeights, Ridge, SPAN, coefficient_distributions,
    coefficient_sample, fit_map, for_each_span,
};
use std::collections::HashSet;

const LAYOUTS: [Layout; 3] = [Layout::Grey, Layout::Rgb, Layout::Lrgb];

/// Every basis of up to 36 functions, on a dome and on the sphere.
fn every_basis(lights: usize) -> Vec<(Basis, Vec<Direction>)> {
    let sets = [dome(lights), sphere::fibonacci(lights)];
    let of = |directions: &Vec<Direction>| {
        let counts = FAMILIES
            .iter()
            .filter(|family| !family.learned)
            .flat_map(|family| family.counts_up_to(36).into_iter().map(|c| (family.name, c)));
        counts
            .map(|(name, count)| (basis_of(name, count, directions), directions.clone()))
            .collect::<Vec<_>>()
    };
    let bases: Vec<_> = sets.iter().flat_map(of).collect();
    assert!(bases.len() >= 2 * (3 + 6 + 4 + 36), "{} bases", bases.len());
    bases
}

/// Largest difference of a coefficient, and of a component of base colour.
fn errors(found: &CoefficientMap, expected: &CoefficientMap) -> (f64, f64) {
    assert_eq!(found.planes.len(), expected.planes.len());
    let worst = |planes: std::ops::Range<usize>| {
        let pairs = planes.flat_map(|p| found.planes[p].iter().zip(&expected.planes[p]));
        let error =
            |(a, b): (&f32, &f32)| if a.is_finite() { f64::from((a - b).abs()) } else { f64::INFINITY };
        pairs.map(error).fold(0.0, f64::max)
    };
    let (k, all) = (expected.model.basis.count(), expected.planes.len());
    let coefficients = if expected.model.layout == Layout::Lrgb { k } else { all };
    (worst(0..coefficients), worst(coefficients..all))
}

/// What rounding to f32 may do to coefficients of up to 1.
///
/// Values, matrix and sums are rounded to 2^-24 of themselves; N terms in order add up to sqrt(N)
/// such errors, four times that where all are alike, and the least singular value hands them on
/// `condition` times enlarged.
fn rounding(fit: &LeastSquares) -> f64 {
    let decomposition = &fit.decomposition;
    let terms = decomposition.lights.max(16) as f64 * decomposition.functions as f64;
    4.0 * terms.sqrt() * decomposition.condition() / 16_777_216.0
}

fn check(fit: &LeastSquares, lights: &[Direction], layout: Layout, size: (usize, usize)) {
    let expected = lopsided(&fit.basis, layout, size);
    let pictures = pictures_of(&expected, lights);
    let found = fit_map(&pictures, fit, model_of(&fit.basis, layout), CpuLevel::detect()).unwrap();
    let (coefficient, color) = errors(&found, &expected);
    let (name, count) = (fit.basis.family().name, fit.basis.count());
    let bound = rounding(fit);
    assert!(bound < 0.2, "{name} {count}: condition {}", fit.decomposition.condition());
    assert!(coefficient <= bound, "{name} {count} {layout:?} {size:?}: {coefficient:e} of {bound:e}");
    assert!(color < 1e-5, "{name} {count} {size:?}: base colour {color:e}");
}

#[test]
fn every_basis_recovers_its_coefficients_in_every_layout() {
    for (basis, lights) in every_basis(300) {
        let pictures = pictures_of(&lopsided(&basis, Layout::Rgb, (7, 5)), &lights);
        let fit = fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Fixed(0.0), &pictures);
        assert_eq!(fit.decomposition.rank(), basis.count());
        assert!(fit.figures.fit_rmse < 1e-6 && fit.figures.leave_one_out_rmse < 1e-6, "{:?}", fit.figures);
        for layout in LAYOUTS {
            check(&fit, &lights, layout, (7, 5));
        }
    }
}

/// A fit that nobody judged: leaving out each of 2,000 lights in turn would take minutes.
fn unjudged(basis: &Basis, lights: &[Direction]) -> LeastSquares {
    let decomposition = Decomposition::new(basis, lights, LightWeights::Uniform).unwrap();
    let solution = decomposition.solution(0.0);
    let leave_one_out = LeaveOneOut { fit: Vec::new(), left_out: Vec::new(), leverage: Vec::new() };
    let figures = FitFigures::default();
    LeastSquares { basis: basis.clone(), decomposition, ridge: 0.0, solution, leave_one_out, figures }
}

#[test]
fn two_thousand_lights_recover_coefficients_too() {
    // Tiles of the least size, and sums of 2,000 terms.
    for (name, count) in [("ptm", 15), ("sh", 36), ("hsh", 16), ("srbf", 36)] {
        let lights = if name == "sh" { sphere::fibonacci(2100) } else { dome(2100) };
        let fit = unjudged(&basis_of(name, count, &lights), &lights);
        for layout in LAYOUTS {
            check(&fit, &lights, layout, (37, 1));
        }
    }
}

#[test]
fn sizes_that_are_no_multiples_of_spans_and_tiles() {
    let lights = dome(60);
    for (name, count) in [("ptm", 6), ("sh", 4), ("hsh", 9), ("srbf", 13)] {
        let fit = unjudged(&basis_of(name, count, &lights), &lights);
        for layout in LAYOUTS {
            for size in [(1, 1), (1, 5000), (91, 101)] {
                check(&fit, &lights, layout, size);
            }
        }
    }
}

#[test]
fn spans_hold_every_pixel_once() {
    let lights = dome(12);
    let fit = unjudged(&basis_of("ptm", 6, &lights), &lights);
    for (size, layout) in [
        ((1, 1), Layout::Rgb),
        ((8192, 1), Layout::Grey),
        ((1, 8193), Layout::Lrgb),
        ((219, 113), Layout::Rgb),
    ] {
        let pictures = pictures_of(&lopsided(&fit.basis, layout, size), &lights);
        let channels = if layout == Layout::Rgb { 3 } else { 1 };
        let colors = if layout == Layout::Lrgb { 3 } else { 0 };
        let spans = std::sync::Mutex::new(Vec::new());
        for_each_span(&pictures, (&fit, layout), CpuLevel::BASELINE, SPAN, |span| {
            assert_eq!(span.maps.len(), 6 * channels * span.pixels);
            assert_eq!(span.base_color.len(), colors * span.pixels);
            spans.lock().unwrap().push((span.first, span.pixels));
            Ok::<(), FitError>(())
        })
        .unwrap();
        let mut spans = spans.into_inner().unwrap();
        spans.sort_unstable();
        let end = spans.iter().fold(0, |end, &(first, pixels)| {
            assert_eq!(first, end, "{size:?}");
            first + pixels
        });
        assert_eq!(end, size.0 * size.1);
    }
}

#[test]
fn distributions_are_those_of_the_planes() {
    let lights = dome(20);
    let fit = unjudged(&basis_of("ptm", 6, &lights), &lights);
    for layout in LAYOUTS {
        // A last span of one pixel, whose neighbours in memory belong to the span before.
        for size in [(1, 1), (5, 7), (1, 8193)] {
            let pictures = pictures_of(&lopsided(&fit.basis, layout, size), &lights);
            let model: Model = model_of(&fit.basis, layout);
            let map = fit_map(&pictures, &fit, model, CpuLevel::detect()).unwrap();
            let check = || Ok::<(), FitError>(());
            let found =
                coefficient_distributions(&pictures, (&fit, layout), CpuLevel::detect(), check).unwrap();
            assert_eq!(found.len(), map.planes.len());
            for (plane, (distribution, values)) in found.iter().zip(&map.planes).enumerate() {
                let mut expected = [CoefficientCounter::new()];
                CoefficientCounter::add_interleaved(&mut expected, values, 0);
                assert!(*distribution == expected[0].distribution(), "{layout:?} {size:?} plane {plane}");
            }
        }
    }
}

#[test]
fn sampled_blocks_are_those_of_the_planes() {
    let lights = dome(20);
    let fit = unjudged(&basis_of("ptm", 6, &lights), &lights);
    for layout in LAYOUTS {
        for size in [(1, 1), (3, 5), (64, 32), (131, 97)] {
            let pictures = pictures_of(&lopsided(&fit.basis, layout, size), &lights);
            let map = fit_map(&pictures, &fit, model_of(&fit.basis, layout), CpuLevel::detect()).unwrap();
            let grid = (size.0.div_ceil(4), size.1.div_ceil(4));
            for most in [1, 100, 10_000] {
                let sample = coefficient_sample(&pictures, (&fit, layout), CpuLevel::detect(), most).unwrap();
                assert_eq!(sample.blocks, most.min(grid.0 * grid.1));
                assert_eq!(sample.planes.len(), map.planes.len());
                // Every value is of its own: the first coefficient says where a block lies.
                let corner = |block: usize| {
                    let first = sample.planes[0][16 * block];
                    let pixel = map.planes[0].iter().position(|value| *value == first).unwrap();
                    (pixel % size.0, pixel / size.0)
                };
                let corners: Vec<_> = (0..sample.blocks).map(corner).collect();
                let columns: HashSet<usize> = corners.iter().map(|&(x, _)| x).collect();
                assert!(columns.len() > grid.0.min(sample.blocks) / 2, "{size:?} {most}: {columns:?}");
                assert!(corners.iter().all(|&(x, y)| x % 4 == 0 && y % 4 == 0), "{corners:?}");
                let places: Vec<_> = corners.iter().map(|&(x, y)| (y / 4) * grid.0 + x / 4).collect();
                assert!(places.is_sorted_by(|a, b| a < b), "{places:?}");
                for (plane, (blocks, values)) in sample.planes.iter().zip(&map.planes).enumerate() {
                    assert_eq!(blocks.len(), 16 * sample.blocks);
                    for (i, found) in blocks.iter().enumerate() {
                        let (x, y) = corners[i / 16];
                        let (x, y) = ((x + i % 4).min(size.0 - 1), (y + i % 16 / 4).min(size.1 - 1));
                        let expected = values[y * size.0 + x];
                        assert_eq!(found.to_bits(), expected.to_bits(), "{layout:?} {size:?} {plane} {i}");
                    }
                }
            }
        }
    }
}

/// How far the decomposition's solution is from satisfying (A^T W A + ridge s0^2) S = A^T W, which
/// is what it is by definition; relative to the largest weighted value.
fn normal_equations_error(decomposition: &Decomposition, ridge: f64) -> f64 {
    let (n, k, weights) = (decomposition.lights, decomposition.functions, &decomposition.weights);
    let a = DMatrix::from_row_slice(n, k, &decomposition.design);
    let weighted = DMatrix::from_fn(n, k, |i, j| weights[i] * a[(i, j)]);
    let solution = DMatrix::from_row_slice(k, n, &decomposition.solution(ridge));
    let strength = ridge * decomposition.singular_values[0].powi(2);
    let normal = a.transpose() * &weighted + DMatrix::identity(k, k) * strength;
    (normal * solution - weighted.transpose()).abs().max() / weighted.abs().max()
}

#[test]
fn the_solution_satisfies_the_normal_equations_of_the_weighted_ridge() {
    // In f64, where nothing hides behind the rounding of pictures.
    for (basis, lights) in every_basis(120) {
        for weighting in [LightWeights::Uniform, LightWeights::Voronoi] {
            let decomposition = Decomposition::new(&basis, &lights, weighting).unwrap();
            let (n, k, singular) = (120, basis.count(), &decomposition.singular_values);
            for (row, light) in decomposition.design.chunks_exact(k).zip(&lights) {
                assert_eq!(row, weights_of(&basis, *light));
            }
            let a = DMatrix::from_row_slice(n, k, &decomposition.design);
            let weighted = DMatrix::from_fn(n, k, |i, j| decomposition.weights[i] * a[(i, j)]);
            let normal = a.transpose() * weighted;
            // The squares of the singular values are its eigenvalues: their sum is the trace.
            let squares: f64 = singular.iter().map(|s| s * s).sum();
            assert!((squares / normal.trace() - 1.0).abs() < 1e-13, "{squares} {}", normal.trace());
            assert!((singular[0].powi(2) / normal.symmetric_eigenvalues().max() - 1.0).abs() < 1e-12);
            let (name, condition) = (basis.family().name, decomposition.condition());
            for ridge in [0.0, 1e-4, 0.1] {
                let error = normal_equations_error(&decomposition, ridge);
                // Small singular values lend their own rounding, 1e-16 s0, an inverse of themselves.
                let bound =
                    2e-14 * if ridge == 0.0 { condition } else { condition.min(1.0 / ridge) }.max(10.0);
                assert!(error < bound, "{name} {k} {weighting:?} ridge {ridge}: {error:e} of {bound:e}");
            }
            let solution = DMatrix::from_row_slice(k, n, &decomposition.solution(0.0));
            let error = (solution * a - DMatrix::identity(k, k)).abs().max();
            assert!(error < 1e-14 * condition.max(10.0), "{name} {k} {weighting:?}: {error:e}");
        }
    }
}

/// Rings of equally many lights at equal steps, and one at the pole: as domes are built.
fn rings(rings: usize, lights: usize) -> Vec<Direction> {
    let light = |ring: usize, i: usize| {
        let azimuth = std::f64::consts::TAU * i as f64 / lights as f64;
        Direction::from_azimuth_elevation(azimuth, 0.1 + 1.3 * ring as f64 / rings as f64).unwrap()
    };
    let mut all: Vec<_> = (0..rings).flat_map(|ring| (0..lights).map(move |i| light(ring, i))).collect();
    all.push(Direction::OUT);
    all
}

#[test]
fn symmetric_domes_whose_singular_values_come_in_pairs() {
    // Equal singular values cost nalgebra's iteration its digits: 2 to 4 % off on these very sets.
    for (lights, name, count) in [
        (rings(4, 30), "ptm", 6),
        (rings(5, 12), "ptm", 6),
        (rings(5, 24), "ptm", 6),
        (rings(4, 15), "hsh", 16),
        (rings(5, 12), "hsh", 9),
        (dome(150), "hsh", 9),
        (dome(120), "hsh", 16),
        (dome(150), "sh", 25),
        (sphere::fibonacci(48), "srbf", 25),
    ] {
        for weighting in [LightWeights::Uniform, LightWeights::Voronoi] {
            let basis = basis_of(name, count, &lights);
            let decomposition = Decomposition::new(&basis, &lights, weighting).unwrap();
            assert_eq!(decomposition.rank(), count);
            for ridge in [0.0, 1e-3] {
                let error = normal_equations_error(&decomposition, ridge);
                let lights = lights.len();
                assert!(error < 5e-12, "{name} {count}, {lights} lights, {weighting:?}: off by {error:e}");
            }
        }
    }
}
