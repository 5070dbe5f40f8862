//! Pictures made from known coefficients give them back, for every basis in the table.

use crate::pictures::{basis_of, dome, fit_of, lopsided, model_of, pictures_of, weights_of};
use nalgebra::DMatrix;
use relight_core::basis::FAMILIES;
use relight_core::{Basis, CoefficientMap, CpuLevel, Direction, FitFigures, Layout, Model, sphere};
use relight_fit::{
    Decomposition, FitError, LeastSquares, LeaveOneOut, LightWeights, Ridge, coefficient_ranges, fit_map,
    for_each_span,
};

const LAYOUTS: [Layout; 3] = [Layout::Grey, Layout::Rgb, Layout::Lrgb];

/// Every basis of up to 36 functions, on a dome and on the sphere.
fn every_basis(lights: usize) -> Vec<(Basis, Vec<Direction>)> {
    let sets = [dome(lights), sphere::fibonacci(lights)];
    let of = |directions: &Vec<Direction>| {
        let counts =
            FAMILIES.iter().flat_map(|family| family.counts_up_to(36).into_iter().map(|c| (family.name, c)));
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
/// such errors, and the least singular value hands them on `condition` times enlarged.
fn rounding(fit: &LeastSquares) -> f64 {
    let decomposition = &fit.decomposition;
    let terms = decomposition.lights.max(16) as f64 * decomposition.functions as f64;
    terms.sqrt() * decomposition.condition() / 16_777_216.0
}

fn check(fit: &LeastSquares, lights: &[Direction], layout: Layout, size: (usize, usize)) {
    let expected = lopsided(&fit.basis, layout, size);
    let pictures = pictures_of(&expected, lights);
    let found = fit_map(&pictures, fit, model_of(&fit.basis, layout), CpuLevel::detect()).unwrap();
    let (coefficient, color) = errors(&found, &expected);
    let (name, count) = (fit.basis.family().name, fit.basis.count());
    let bound = rounding(fit);
    assert!(bound < 0.02, "{name} {count}: condition {}", fit.decomposition.condition());
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
        for_each_span(&pictures, &fit, layout, CpuLevel::BASELINE, |span| {
            assert_eq!(span.functions.len(), 6 * channels * span.pixels);
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
fn ranges_are_those_of_the_planes() {
    let lights = dome(20);
    let fit = unjudged(&basis_of("ptm", 6, &lights), &lights);
    for layout in LAYOUTS {
        // A last span of one pixel, whose neighbours in memory belong to the span before.
        for size in [(1, 1), (5, 7), (1, 8193)] {
            let pictures = pictures_of(&lopsided(&fit.basis, layout, size), &lights);
            let model: Model = model_of(&fit.basis, layout);
            let map = fit_map(&pictures, &fit, model, CpuLevel::detect()).unwrap();
            let check = || Ok::<(), FitError>(());
            let ranges = coefficient_ranges(&pictures, &fit, layout, CpuLevel::detect(), check).unwrap();
            assert_eq!(ranges.len(), map.planes.len());
            for (plane, (range, values)) in ranges.iter().zip(&map.planes).enumerate() {
                let min = values.iter().copied().fold(f32::INFINITY, f32::min);
                let max = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                assert_eq!((range.min, range.max), (min, max), "{layout:?} {size:?} plane {plane}");
            }
        }
    }
}

#[test]
fn the_solution_satisfies_the_normal_equations_of_the_weighted_ridge() {
    // (A^T W A + ridge s0^2) S = A^T W, and S A = 1 without a ridge: what the solution is by
    // definition, in f64, where nothing hides behind the rounding of pictures.
    for (basis, lights) in every_basis(120) {
        for weighting in [LightWeights::Uniform, LightWeights::Voronoi] {
            let decomposition = Decomposition::new(&basis, &lights, weighting).unwrap();
            let (n, k) = (lights.len(), basis.count());
            let a = DMatrix::from_fn(n, k, |i, j| weights_of(&basis, lights[i])[j]);
            let weighted = DMatrix::from_fn(n, k, |i, j| decomposition.weights[i] * a[(i, j)]);
            let normal = a.transpose() * &weighted;
            let s0 = decomposition.singular_values[0];
            // The largest eigenvalue of A^T W A is s0^2, all of them add up to its trace.
            let squares: f64 = decomposition.singular_values.iter().map(|s| s * s).sum();
            assert!((squares / normal.trace() - 1.0).abs() < 1e-12);
            assert!((s0 * s0 / normal.symmetric_eigenvalues().max() - 1.0).abs() < 1e-12);
            for ridge in [0.0, 1e-4, 0.1] {
                let solution = DMatrix::from_row_slice(k, n, &decomposition.solution(ridge));
                let ridged = &normal + DMatrix::identity(k, k) * (ridge * s0 * s0);
                let error = (&ridged * &solution - weighted.transpose()).abs().max() / weighted.abs().max();
                let condition = decomposition.condition();
                let (name, bound) = (basis.family().name, 1e-14 * condition * k as f64);
 println!("{name} {k} {weighting:?} {ridge} cond {condition:.1} normal {error:e}");
 if ridge==0.0 {let error = (&solution * &a - DMatrix::identity(k, k)).abs().max(); println!("   SA {error:e}");} let _=bound; } } } panic!(); }
