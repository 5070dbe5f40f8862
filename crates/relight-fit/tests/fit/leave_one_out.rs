//! Leaving lights out in closed form against leaving them out; pictures under each other's names.

use crate::pictures::{
    Pictures, basis_of, dome, fit_of, glossy_bumps, model_of, random, rms_error, weights_of,
};
use nalgebra::{DMatrix, DVector};
use relight_core::{Basis, CpuLevel, Direction, Layout, LightSet};
use relight_fit::{LightWeights, Ridge, fit_map, misfits};

fn without<T: Clone>(all: &[T], left_out: usize) -> Vec<T> {
    all.iter().enumerate().filter(|&(i, _)| i != left_out).map(|(_, value)| value.clone()).collect()
}

/// Pictures that no basis fits.
fn noisy(lights: &[Direction]) -> Pictures {
    Pictures::of((lights.len(), (13, 3), 1), |i, pixel, _| {
        let [x, y, z] = lights[i].components();
        z + 0.3 * x * random(5, pixel) + 0.2 * y + 0.1 * random(i, pixel)
    })
}

/// Root mean square error of predicting picture `light` from the others by
/// argmin |W^(1/2) (A c - y)|^2 + strength |c|^2, the normal equations solved anew.
fn refitted(
    basis: &Basis,
    lights: &[Direction],
    weights: &[f64],
    strength: f64,
    pictures: &Pictures,
    light: usize,
) -> f64 {
    let (others, k) = (without(lights, light), basis.count());
    let (weights, rows) = (without(weights, light), without(&pictures.rows, light));
    let a = DMatrix::from_fn(others.len(), k, |i, j| weights_of(basis, others[i])[j]);
    let weighted = DMatrix::from_fn(others.len(), k, |i, j| weights[i] * a[(i, j)]);
    let normal = a.transpose() * &weighted + DMatrix::identity(k, k) * strength;
    let solver = normal.cholesky().unwrap();
    let own = DVector::from_vec(weights_of(basis, lights[light]));
    let pixels = pictures.rows[0].len();
    let squares: f64 = (0..pixels)
        .map(|s| {
            let values = DVector::from_fn(others.len(), |i, _| f64::from(rows[i][s]));
            let predicted = own.dot(&solver.solve(&(weighted.transpose() * values)));
            (predicted - f64::from(pictures.rows[light][s])).powi(2)
        })
        .sum();
    (squares / pixels as f64).sqrt()
}

#[test]
fn equals_fitting_again_without_each_light() {
    let lights = dome(31);
    let pictures = noisy(&lights);
    for (name, count) in [("ptm", 6), ("sh", 9), ("hsh", 9), ("srbf", 12)] {
        let basis = basis_of(name, count, &lights);
        let fit = fit_of(&basis, &lights, LightWeights::Uniform, Ridge::Fixed(0.0), &pictures);
        for (light, left_out) in fit.leave_one_out.left_out.iter().enumerate() {
            let (others, mut rows) = (without(&lights, light), pictures.only(&[]));
            rows.rows = without(&pictures.rows, light);
            let again = fit_of(&basis, &others, LightWeights::Uniform, Ridge::Fixed(0.0), &rows);
            let map = fit_map(&rows, &again, model_of(&basis, Layout::Grey), CpuLevel::detect()).unwrap();
            let error = rms_error(&map, &lights[light..=light], &pictures.only(&[light]));
            // The map is rounded to f32, errors are about 0.1.
            assert!(
                (error - left_out).abs() < 2e-5 * left_out.max(0.1),
                "{name} {light}: {error} {left_out}"
            );
        }
    }
}

#[test]
fn equals_fitting_again_with_the_weights_and_the_ridge_of_all() {
    // A ridge is relative to s0^2 of all lights, so the reduced fit is given its absolute strength.
    let mut lights = dome(25);
    lights.extend(dome(300).into_iter().filter(|d| d.x() > 0.6 && d.y() > 0.4));
    let pictures = noisy(&lights);
    for (name, count) in [("ptm", 6), ("sh", 9), ("hsh", 16), ("srbf", 12)] {
        let basis = basis_of(name, count, &lights);
        for ridge in [0.0, 1e-3, 0.3] {
            let fit = fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Fixed(ridge), &pictures);
            let (weights, s0) = (&fit.decomposition.weights, fit.decomposition.singular_values[0]);
            for (light, left_out) in fit.leave_one_out.left_out.iter().enumerate() {
                let error = refitted(&basis, &lights, weights, ridge * s0 * s0, &pictures, light);
                let difference = (error - left_out).abs();
                assert!(difference < 1e-7 * left_out, "{name} ridge {ridge} light {light}: {difference:e}");
            }
        }
    }
}

#[test]
fn fit_errors_are_the_residuals_of_the_map() {
    let lights = dome(31);
    let pictures = noisy(&lights);
    let basis = basis_of("sh", 9, &lights);
    let fit = fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Auto, &pictures);
    let map = fit_map(&pictures, &fit, model_of(&basis, Layout::Grey), CpuLevel::detect()).unwrap();
    for (light, error) in fit.leave_one_out.fit.iter().enumerate() {
        let direct = rms_error(&map, &lights[light..=light], &pictures.only(&[light]));
        assert!((direct - error).abs() < 1e-6, "{light}: {direct} {error}");
    }
    let weights = &fit.decomposition.weights;
    let of = |errors: &[f64]| {
        let sum: f64 = errors.iter().zip(weights).map(|(e, w)| w * e * e).sum();
        (sum / weights.iter().sum::<f64>()).sqrt()
    };
    assert!((fit.figures.fit_rmse - of(&fit.leave_one_out.fit)).abs() < 1e-12);
    assert!((fit.figures.leave_one_out_rmse - of(&fit.leave_one_out.left_out)).abs() < 1e-12);
}

#[test]
fn leverages_add_up_to_the_effective_rank() {
    let lights = dome(40);
    let pictures = noisy(&lights);
    for (name, count) in [("ptm", 15), ("sh", 25), ("hsh", 16), ("srbf", 36)] {
        let basis = basis_of(name, count, &lights);
        for ridge in [0.0, 1e-4, 0.05] {
            let fit = fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Fixed(ridge), &pictures);
            let singular = &fit.decomposition.singular_values;
            let rank: f64 =
                singular.iter().map(|s| s * s / (s * s + ridge * singular[0] * singular[0])).sum();
            let sum: f64 = fit.leave_one_out.leverage.iter().sum();
            assert!((sum - rank).abs() < 1e-9, "{name} ridge {ridge}: {sum} {rank}");
            assert!(fit.leave_one_out.leverage.iter().all(|h| (-1e-12..1.0 + 1e-9).contains(h)), "{name}");
        }
    }
}

#[test]
fn a_light_that_nothing_predicts_has_an_infinite_error_and_no_nan() {
    // As many lights as functions: each is fitted by itself alone.
    let lights = dome(6);
    let pictures = noisy(&lights);
    let fit =
        fit_of(&basis_of("ptm", 6, &lights), &lights, LightWeights::Voronoi, Ridge::Fixed(0.0), &pictures);
    assert!(fit.leave_one_out.left_out.iter().all(|e| *e == f64::INFINITY), "{:?}", fit.leave_one_out);
    assert!(fit.figures.fit_rmse < 1e-6);
    assert_eq!(fit.leave_one_out.cross_validation(&fit.decomposition.weights), f64::INFINITY);
}

#[test]
fn a_swapped_pair_of_names_is_found_and_each_names_the_other() {
    let lights = dome(50);
    let set = LightSet::from_directions(lights.clone());
    let right = glossy_bumps(&lights, 20);
    assert_eq!(misfits(&set, &right.sample()).unwrap(), []);
    for (a, b) in [(3, 31), (10, 44), (20, 29), (7, 41), (2, 47)] {
        assert!(lights[a].angle_to(lights[b]) > 0.7, "{a} {b}: {}", lights[a].angle_to(lights[b]));
        let mut swapped = right.only(&(0..50).collect::<Vec<_>>());
        swapped.rows.swap(a, b);
        let mut found = misfits(&set, &swapped.sample()).unwrap();
        // A neighbour that the wrong pictures pull along may stand out too, but less.
        found.sort_by(|m, n| n.rmse.total_cmp(&m.rmse));
        let mut pair: Vec<_> = found.iter().take(2).map(|m| (m.light, m.better)).collect();
        pair.sort_unstable();
        assert_eq!(pair, [(a, Some(b)), (b, Some(a))], "{found:?}");
        assert!(found.len() <= 3 && found[2..].iter().all(|m| m.better.is_none()), "{found:?}");
    }
}

#[test]
fn captures_too_small_to_judge_have_no_misfits() {
    for count in 1..6 {
        let lights = dome(count);
        let pictures = noisy(&lights);
        assert_eq!(misfits(&LightSet::from_directions(lights), &pictures.sample()).unwrap(), []);
    }
}
