//! Light sets that leave a fit undetermined or nearly so, one a test (docs/stability.md).

use crate::pictures::{
    Pictures, basis_of, direction, dome, fit_of, glossy_bumps, largest, lopsided, model_of, pictures_of,
    random, relit, rms_error, weights_of,
};
use nalgebra::{DMatrix, DVector};
use relight_core::basis::{Domain, FAMILIES, SrbfDesign};
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{Basis, CoefficientMap, CpuLevel, Design, Direction, Family, Layout, LightSet, sphere};
use relight_fit::{Decomposition, FitError, LeastSquares, LightWeights, Ridge, Sample, fit_map, usability};

/// The grey map of `pictures` and its fit with Voronoi weights.
fn grey_map(
    basis: &Basis,
    lights: &[Direction],
    ridge: Ridge,
    pictures: &Pictures,
) -> (LeastSquares, CoefficientMap) {
    let fit = fit_of(basis, lights, LightWeights::Voronoi, ridge, pictures);
    let map = fit_map(pictures, &fit, model_of(basis, Layout::Grey), CpuLevel::detect()).unwrap();
    (fit, map)
}

/// Pictures with a value of its own for every light and pixel, 0..1.
fn any_pictures(lights: usize) -> Pictures {
    Pictures::of((lights, (5, 3), 1), |light, pixel, _| 0.5 + 0.5 * random(light, pixel))
}

#[test]
fn lights_at_the_pole_and_on_the_horizon() {
    let mut lights = vec![Direction::OUT];
    let around = |i: usize, elevation| {
        Direction::from_azimuth_elevation(i as f64 * std::f64::consts::TAU / 12.0, elevation).unwrap()
    };
    lights.extend((0..12).map(|i| around(i, 0.0)));
    lights.extend([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].map(|(x, y)| direction(x, y, 0.0)));
    lights.extend(fibonacci_in(Cap { axis: Direction::OUT, radius: 1.4 }, 48));
    for (name, count) in [("ptm", 15), ("sh", 16), ("hsh", 16), ("srbf", 25)] {
        let basis = basis_of(name, count, &lights);
        let expected = lopsided(&basis, Layout::Grey, (5, 3));
        let pictures = pictures_of(&expected, &lights);
        let (fit, map) = grey_map(&basis, &lights, Ridge::Fixed(0.0), &pictures);
        assert_eq!(fit.decomposition.rank(), count, "{name}");
        assert!(fit.leave_one_out.left_out.iter().all(|error| *error < 1e-4), "{name}");
        for (found, expected) in map.planes.iter().flatten().zip(expected.planes.iter().flatten()) {
            let bound = 5e-6 * fit.decomposition.condition() as f32;
            assert!((found - expected).abs() < bound, "{name}: {found} {expected} {bound}");
        }
    }
}

#[test]
fn five_lights_for_a_ptm_of_six() {
    let lights = dome(5);
    let (basis, pictures) = (basis_of("ptm", 6, &lights), any_pictures(5));
    let (fit, map) = grey_map(&basis, &lights, Ridge::Fixed(0.0), &pictures);
    assert_eq!(fit.decomposition.rank(), 5);
    assert_eq!(fit.decomposition.condition(), f64::INFINITY);
    assert!(rms_error(&map, &lights, &pictures) < 1e-6, "the five pictures themselves");
    // Of all coefficients that give the five pictures, the least: A^T (A A^T)^-1 y.
    let a = DMatrix::from_fn(5, 6, |i, j| weights_of(&basis, lights[i])[j]);
    let solver = (&a * a.transpose()).cholesky().unwrap();
    for pixel in 0..15 {
        let values = DVector::from_fn(5, |i, _| f64::from(pictures.rows[i][pixel]));
        let least = a.transpose() * solver.solve(&values);
        for (j, expected) in least.iter().enumerate() {
            let found = f64::from(map.planes[j][pixel]);
            assert!((found - expected).abs() < 2e-5, "pixel {pixel} function {j}: {found} {expected}");
        }
    }
}

#[test]
fn one_ring_of_constant_elevation() {
    // u^2 + v^2 is constant there: rank 5 of 6, whatever the number of lights.
    let ring: Vec<_> =
        (0..36).map(|i| Direction::from_azimuth_elevation(f64::from(i) * 0.1745, 0.7).unwrap()).collect();
    let basis = basis_of("ptm", 6, &ring);
    let pictures = pictures_of(&lopsided(&basis, Layout::Grey, (5, 3)), &ring);
    for ridge in [Ridge::Fixed(0.0), Ridge::Auto] {
        let (fit, map) = grey_map(&basis, &ring, ridge, &pictures);
        assert_eq!(fit.decomposition.rank(), 5);
        assert_eq!(fit.decomposition.condition(), f64::INFINITY);
        assert!(largest(&map) < 2.0, "{ridge:?}: coefficients up to {}", largest(&map));
        let bound = if ridge == Ridge::Auto { 2e-3 } else { 1e-6 };
        let error = rms_error(&map, &ring, &pictures);
        assert!(error < bound, "{ridge:?}: the ring's own pictures are off by {error}");
    }
    let set = LightSet::from_directions(ring);
    assert!(!usability(basis, &set).unwrap().usable);
}

#[test]
fn all_lights_in_one_plane() {
    // v = s u leaves u^2, u and 1: rank 3 of 6.
    for slope in [0.0, 1.0, -0.3] {
        let lights: Vec<_> = (0..30)
            .map(|i| {
                let u = (f64::from(i) - 14.0) / 16.0;
                direction(u, slope * u, 0.9)
            })
            .collect();
        let basis = basis_of("ptm", 6, &lights);
        let pictures = pictures_of(&lopsided(&basis, Layout::Grey, (5, 3)), &lights);
        let (fit, map) = grey_map(&basis, &lights, Ridge::Fixed(0.0), &pictures);
        assert_eq!(fit.decomposition.rank(), 3, "{slope}: {:?}", fit.decomposition.singular_values);
        assert!(largest(&map) < 3.5, "{slope}: coefficients up to {}", largest(&map));
        let error = rms_error(&map, &lights, &pictures);
        assert!(error < 1e-6, "{slope}: {error}");
    }
}

#[test]
fn two_hundred_clustered_lights_and_forty_eight_spread_ones() {
    let mut lights = fibonacci_in(Cap { axis: direction(0.6, 0.2, 0.7), radius: 0.15 }, 200);
    lights.extend(dome(48));
    let held_out: Vec<_> = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.4 }, 199);
    let (pictures, truth) = (glossy_bumps(&lights, 20), glossy_bumps(&held_out, 20));
    for (name, count, part) in [("ptm", 6, 0.95), ("hsh", 9, 0.95), ("sh", 9, 0.95)] {
        let basis = basis_of(name, count, &lights);
        let [voronoi, uniform] = [LightWeights::Voronoi, LightWeights::Uniform].map(|weighting| {
            let fit = fit_of(&basis, &lights, weighting, Ridge::Auto, &pictures);
            let map = fit_map(&pictures, &fit, model_of(&basis, Layout::Grey), CpuLevel::detect()).unwrap();
            rms_error(&map, &held_out, &truth)
        });
        assert!(voronoi < part * uniform, "{name}: {voronoi} with weights, {uniform} without");
    }
}

#[test]
fn a_light_photographed_twenty_times() {
    let lights = dome(40);
    let mut doubled = lights.clone();
    doubled.extend([lights[5]; 19]);
    let pictures = glossy_bumps(&lights, 20);
    let mut repeated = pictures.only(&(0..40).collect::<Vec<_>>());
    repeated.rows.extend((0..19).map(|_| pictures.rows[5].clone()));
    for (name, count) in [("ptm", 6), ("sh", 9), ("hsh", 9), ("srbf", 16)] {
        let basis = basis_of(name, count, &lights);
        let (_, map) = grey_map(&basis, &lights, Ridge::Auto, &pictures);
        let (fit, with_copies) = grey_map(&basis, &doubled, Ridge::Auto, &repeated);
        assert_eq!(fit.decomposition.rank(), count);
        let change = |other: &CoefficientMap| {
            let pairs = other.planes.iter().flatten().zip(map.planes.iter().flatten());
            f64::from(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max))
        };
        let unweighted = fit_of(&basis, &doubled, LightWeights::Uniform, Ridge::Auto, &repeated);
        let model = model_of(&basis, Layout::Grey);
        let pulled = fit_map(&repeated, &unweighted, model, CpuLevel::detect()).unwrap();
        let (weighted, uniform) = (change(&with_copies), change(&pulled));
        assert!(weighted < 0.15 * uniform, "{name}: copies pull by {weighted}, unweighted by {uniform}");
    }
}

#[test]
fn sixty_four_centres_on_the_whole_sphere_under_a_dome() {
    let lights = dome(120);
    let held_out = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.4 }, 199);
    let (pictures, truth) = (glossy_bumps(&lights, 20), glossy_bumps(&held_out, 20));
    let set = LightSet::from_directions(lights.clone());
    let basis = |domain| {
        let srbf = SrbfDesign { domain, ..SrbfDesign::default() };
        let design = Design { count: 64, lights: &set, srbf };
        Family::by_name("srbf").unwrap().build(&design).unwrap()
    };
    let whole = basis(Domain::Sphere);
    let (bare, wild) = grey_map(&whole, &lights, Ridge::Fixed(0.0), &pictures);
    assert!(bare.decomposition.condition() > 1e4, "{}", bare.decomposition.condition());
    let (_, map) = grey_map(&whole, &lights, Ridge::Auto, &pictures);
    let (_, on_cap) = grey_map(&basis(Domain::Cap), &lights, Ridge::Auto, &pictures);
    let [error, cap_error] = [&map, &on_cap].map(|m| rms_error(m, &held_out, &truth));
    assert!(largest(&wild) > 20.0, "without a ridge coefficients reach {}", largest(&wild));
    assert!(largest(&map) < 3.0, "with one {}", largest(&map));
    assert!(error < 1.5 * cap_error, "{error} at lights between, {cap_error} with centres on the cap");
}

#[test]
fn harmonics_of_order_10_under_150_lights_with_both_poles() {
    let mut lights = sphere::fibonacci(148);
    lights.extend([Direction::OUT, direction(0.0, 0.0, -1.0)]);
    let basis = basis_of("sh", 121, &lights);
    let expected = lopsided(&basis, Layout::Grey, (5, 3));
    let pictures = pictures_of(&expected, &lights);
    let (fit, map) = grey_map(&basis, &lights, Ridge::Fixed(0.0), &pictures);
    assert_eq!(fit.decomposition.rank(), 121);
    let worst = map.planes.iter().flatten().zip(expected.planes.iter().flatten());
    let worst = worst.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(f64::from(worst) < 1e-5 * fit.decomposition.condition(), "{worst}");
    // The same under a dome, where half of the sphere says nothing.
    let mut lights = dome(149);
    lights.push(Direction::OUT);
    let pictures = glossy_bumps(&lights, 20);
    let (fit, map) = grey_map(&basis, &lights, Ridge::Auto, &pictures);
    assert!(fit.decomposition.rank() <= 121 && fit.decomposition.condition() > 1e4);
    assert!(largest(&map) < 2.0, "coefficients up to {}", largest(&map));
    assert!(rms_error(&map, &lights, &pictures) < 0.05, "{}", rms_error(&map, &lights, &pictures));
}

#[test]
fn fewer_lights_than_functions_in_every_family() {
    for family in FAMILIES.iter().filter(|family| !family.learned) {
        for count in family.counts_up_to(36).into_iter().filter(|&count| count > 1) {
            let lights = dome(count.div_ceil(2));
            let (basis, pictures) = (basis_of(family.name, count, &lights), any_pictures(lights.len()));
            let (fit, map) = grey_map(&basis, &lights, Ridge::Fixed(0.0), &pictures);
            let name = family.name;
            assert_eq!(fit.decomposition.singular_values.len(), lights.len());
            assert_eq!(fit.decomposition.rank(), lights.len(), "{name} {count}");
            assert_eq!(fit.decomposition.condition(), f64::INFINITY);
            let error = rms_error(&map, &lights, &pictures);
            assert!(error < 1e-5, "{name} {count}: the pictures themselves are off by {error}");
            let (_, map) = grey_map(&basis, &lights, Ridge::Auto, &pictures);
            assert!(largest(&map) < 10.0, "{name} {count}: coefficients up to {}", largest(&map));
        }
    }
}

#[test]
fn one_light() {
    for family in FAMILIES.iter().filter(|family| !family.learned) {
        for light in [Direction::OUT, direction(0.3, -0.2, 0.9), direction(1.0, 0.0, 0.0)] {
            let count = family.counts_up_to(36)[0];
            let (basis, pictures) = (basis_of(family.name, count, &[light]), any_pictures(1));
            for ridge in [Ridge::Fixed(0.0), Ridge::Auto] {
                let (fit, map) = grey_map(&basis, &[light], ridge, &pictures);
                assert_eq!(fit.decomposition.weights, [1.0]);
                assert_eq!(fit.decomposition.rank(), 1);
                let bound = if ridge == Ridge::Auto { 2e-3 } else { 1e-6 };
                assert!(rms_error(&map, &[light], &pictures) < bound, "{} {ridge:?}", family.name);
                assert!(relit(&map, direction(-0.5, 0.5, 0.5), 3, 0).is_finite());
            }
        }
    }
}

#[test]
fn functions_that_no_light_sees() {
    // Kernels so narrow that every one of them is 0 at every light: rank 0, a black map, no 0/0.
    let centres = vec![direction(0.0, 0.0, -1.0), direction(1.0, 0.0, -1.0)];
    let srbf = relight_core::basis::Srbf::new(centres, 0.01, relight_core::basis::Kernel::Geodesic).unwrap();
    let (basis, lights) = (Basis::Srbf(srbf), dome(20));
    for ridge in [Ridge::Fixed(0.0), Ridge::Auto] {
        let (fit, map) = grey_map(&basis, &lights, ridge, &any_pictures(20));
        assert_eq!(fit.decomposition.rank(), 0);
        assert_eq!(fit.decomposition.condition(), f64::INFINITY);
        assert!(map.planes.iter().flatten().all(|value| *value == 0.0));
    }
}

#[test]
fn no_light_is_refused() {
    let basis = basis_of("ptm", 6, &[]);
    let refused = Decomposition::new(&basis, &[], LightWeights::Voronoi);
    assert!(matches!(refused, Err(FitError::NoLights)));
    let none = Sample::from_values(&[]);
    for ridge in [Ridge::Auto, Ridge::Fixed(0.0)] {
        let refused = LeastSquares::new(basis.clone(), &[], LightWeights::Uniform, ridge, &none);
        assert!(matches!(refused, Err(FitError::NoLights)));
    }
    assert!(usability(basis, &LightSet::default()).is_err());
}

#[test]
fn a_ridge_out_of_range_is_refused() {
    let (lights, pictures) = (dome(12), any_pictures(12));
    let with = |ridge| {
        let basis = basis_of("ptm", 6, &lights);
        LeastSquares::new(basis, &lights, LightWeights::Voronoi, Ridge::Fixed(ridge), &pictures.sample())
    };
    for ridge in [-1e-9, 1.000_001, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let Err(FitError::Ridge { ridge: named }) = with(ridge) else { panic!("{ridge} was taken") };
        assert_eq!(named.to_bits(), ridge.to_bits());
    }
    for ridge in [0.0, 1e-300, 1.0] {
        assert_eq!(with(ridge).unwrap().ridge, ridge);
    }
}
