//! Directions, bases and point sets against values of 50 digits (testdata/golden, made with mpmath),
//! and the two orthonormal families against quadrature that is exact for them.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

use relight_core::basis::{Domain, PointSet};
use relight_core::basis::{FunctionsOfLight, Hsh, Kernel, Spread, Srbf, SrbfDesign, evaluate_sh};
use relight_core::{Basis, Design, Direction, Family, LightSet, sphere};
use serde_json::Value;
use std::f64::consts::PI;

fn golden(name: &str) -> Value {
    let path = format!("{}/../../testdata/golden/{name}", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_slice(&std::fs::read(&path).expect(&path)).expect(&path)
}

/// The entries of the list `key`; a file without any would make a test that cannot fail.
fn entries<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    let list = value[key].as_array().expect(key);
    assert!(!list.is_empty(), "{key} is empty");
    list
}

/// A number, or one written as a decimal string of more digits than f64 has.
fn number(value: &Value) -> f64 {
    match value {
        Value::String(digits) => digits.parse().expect(digits),
        other => other.as_f64().expect("a number"),
    }
}

fn direction(value: &Value) -> Direction {
    Direction::new(number(&value[0]), number(&value[1]), number(&value[2])).unwrap()
}

fn evaluate(basis: &impl FunctionsOfLight, light: Direction) -> Vec<f64> {
    let mut weights = vec![f64::NAN; basis.count()];
    basis.evaluate(light, &mut weights);
    weights
}

/// Nodes and weights of Gauss and Legendre's rule of `count` points on -1..1: exact for polynomials
/// of degree 2 count - 1.
fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let node = |i: usize| {
        let mut x = libm::cos(PI * (i as f64 + 0.75) / (count as f64 + 0.5));
        let mut slope = 1.0;
        for _ in 0..50 {
            let (mut before, mut value) = (1.0, x);
            for l in 2..=count {
                let l = l as f64;
                (before, value) = (value, ((2.0 * l - 1.0) * x * value - (l - 1.0) * before) / l);
            }
            slope = count as f64 * (before - x * value) / (1.0 - x * x);
            x -= value / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..count).map(node).collect()
}

/// Largest deviation of the functions' inner products over z in `bottom`..1 from the identity:
/// `rings` Gauss points in z, `spokes` equal steps of azimuth.
fn gram_error(
    bottom: f64,
    (rings, spokes): (usize, usize),
    count: usize,
    evaluate: impl Fn(Direction, &mut [f64]),
) -> f64 {
    let mut gram = vec![0.0; count * count];
    let mut values = vec![0.0; count];
    for (node, weight) in gauss_legendre(rings) {
        let half = (1.0 - bottom) / 2.0;
        let z = bottom + half * (node + 1.0);
        let area = weight * half * 2.0 * PI / spokes as f64;
        for spoke in 0..spokes {
            // The offset keeps the spokes off the axes, where many functions are 0.
            let (sin, cos) = libm::sincos(2.0 * PI * (spoke as f64 + 0.3) / spokes as f64);
            let radius = ((1.0 - z) * (1.0 + z)).sqrt();
            evaluate(Direction::new(radius * cos, radius * sin, z).unwrap(), &mut values);
            for (row, a) in gram.chunks_exact_mut(count).zip(&values) {
                for (sum, b) in row.iter_mut().zip(&values) {
                    *sum += area * a * b;
                }
            }
        }
    }
    let deviation =
        |(i, product): (usize, &f64)| (product - f64::from(u8::from(i / count == i % count))).abs();
    gram.iter().enumerate().map(deviation).fold(0.0, f64::max)
}

#[test]
fn spherical_harmonics_to_order_10() {
    // Values stay below 1.3. A direction is rounded by 1e-16, slopes reach order x value = 13, and
    // each recursion step rounds twice: a few 1e-15. 1e-14 leaves no room for a wrong constant.
    let file = golden("sh_basis_l10.json");
    let order = file["lmax"].as_u64().unwrap() as usize;
    for case in entries(&file, "cases") {
        let light = direction(&case["dir"]);
        let mut values = vec![f64::NAN; (order + 1) * (order + 1)];
        evaluate_sh(order, light, &mut values);
        let expected = entries(case, "cs");
        assert_eq!(expected.len(), values.len());
        for (i, (value, expected)) in values.iter().zip(expected).enumerate() {
            let expected = number(expected);
            assert!((value - expected).abs() < 1e-14, "Y_{i} at {light:?}: {value}, not {expected}");
        }
    }
}

#[test]
fn spherical_harmonics_to_order_100() {
    // Where the literal formula overflows (from order 18 in f32, 86 in f64). Values above 1e-3 within
    // 2e-13: slopes reach 100 x 4. Below, down to the least normal number, their digits count: each
    // of up to 100 factors of sin(theta) rounds once.
    for case in entries(&golden("sh_high_l.json"), "cases") {
        let (l, m) = (case["l"].as_i64().unwrap(), case["m"].as_i64().unwrap());
        let light = direction(&case["dir"]);
        let mut values = vec![f64::NAN; ((l + 1) * (l + 1)) as usize];
        evaluate_sh(l as usize, light, &mut values);
        assert!(values.iter().all(|value| value.is_finite()), "l {l} at {light:?}");
        let (value, expected) = (values[(l * l + l + m) as usize], number(&case["cs"]));
        let tolerance =
            if expected.abs() > 1e-3 { 2e-13 } else { (1e-12 * expected.abs()).max(f64::MIN_POSITIVE) };
        assert!((value - expected).abs() <= tolerance, "Y_{l},{m} at {light:?}: {value:e}, not {expected:e}");
    }
}

#[test]
fn spherical_harmonics_are_orthonormal() {
    // Products have degree 2 order: order + 1 Gauss points and 2 order + 1 spokes are exact.
    for (order, bound) in [(4, 5e-15), (10, 2e-14), (20, 5e-14)] {
        let count = (order + 1) * (order + 1);
        let error = gram_error(-1.0, (order + 1, 2 * order + 1), count, |d, out| evaluate_sh(order, d, out));
        assert!(error < bound, "order {order}: {error:e}");
    }
}

#[test]
fn hemispherical_harmonics_of_rti_files() {
    let hsh = Hsh::with_count(16).unwrap();
    let mut below = 0;
    for case in entries(&golden("hsh_hbasis.json"), "cases") {
        let light = direction(&case["dir"]);
        assert!(light.z() >= 0.0, "the file has no lights below the horizon");
        for (j, (value, expected)) in evaluate(&hsh, light).iter().zip(entries(case, "hsh_rti")).enumerate() {
            let expected = number(expected);
            // Values stay below 3, the slope of sqrt(z) at z = 1e-3 is 16.
            assert!((value - expected).abs() < 1e-14, "H_{j} at {light:?}: {value}, not {expected}");
        }
        // The file's formula is NaN below the horizon; ours stays what it is on it.
        let [x, y, z] = light.components();
        for down in [1e-300, 1e-9, z, 1e9] {
            let under = Direction::new(x, y, -down).unwrap();
            assert!(evaluate(&hsh, under).iter().all(|value| value.is_finite()), "at {under:?}");
            below += 1;
        }
    }
    assert!(below > 20);
    let horizon = evaluate(&hsh, Direction::new(0.6, 0.8, 0.0).unwrap());
    let (under, over) = (Direction::new(0.6, 0.8, -1e-9).unwrap(), Direction::new(0.6, 0.8, 1e-9).unwrap());
    assert_eq!(evaluate(&hsh, under), horizon);
    // sqrt(z): 1e-9 above the horizon the functions have moved by 5 sqrt(1e-9).
    let jump = evaluate(&hsh, over).iter().zip(&horizon).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!((1e-6..3e-4).contains(&jump), "{jump:e}");
}

#[test]
fn hemispherical_harmonics_are_orthonormal_over_the_hemisphere() {
    // Products of functions of one |m| are polynomials of degree 6 in z; others vanish over azimuth.
    let hsh = Hsh::with_count(16).unwrap();
    let error = gram_error(0.0, (8, 16), 16, |d, out| hsh.evaluate(d, out));
    assert!(error < 5e-15, "{error:e}");
}

#[test]
fn radial_functions_by_angle() {
    for case in entries(&golden("srbf.json"), "by_angle") {
        let (angle, expected) = (number(&case["angle"]), number(&case["R"]));
        let spread = number(&case["spread_deg"]) * PI / 180.0;
        let srbf = Srbf::new(vec![Direction::OUT], spread, Kernel::Geodesic).unwrap();
        for azimuth in [0.0, 1.0, 2.5] {
            let light = Direction::from_azimuth_elevation(azimuth, PI / 2.0 - angle).unwrap();
            let value = evaluate(&srbf, light)[0];
            // The angle is off by 5e-16 at most, the exponent by angle / spread^2 times that:
            // 5e-14 of a value as small as 4e-71.
            let tolerance = expected * (4e-16 + 5e-16 * angle / (spread * spread));
            assert!((value - expected).abs() <= tolerance, "{spread} {angle}: {value:e}, not {expected:e}");
        }
    }
}

#[test]
fn radial_functions_and_angles_by_vectors() {
    for case in entries(&golden("srbf.json"), "by_vectors") {
        let (a, b) = (direction(&case["a"]), direction(&case["b"]));
        let angle = number(&case["angle"]);
        assert!((a.angle_to(b) - angle).abs() < 5e-16, "{a:?} {b:?}: {} {angle}", a.angle_to(b));
        let srbf = Srbf::new(vec![a], 28.5 * PI / 180.0, Kernel::Geodesic).unwrap();
        let (value, expected) = (evaluate(&srbf, b)[0], number(&case["R_28_5deg"]));
        assert!((value - expected).abs() <= 1e-14 * expected, "{a:?} {b:?}: {value:e}, not {expected:e}");
    }
}

#[test]
fn radial_functions_at_their_centre_and_opposite_it() {
    // The dot product of a rounded unit vector with itself exceeds 1 at times: acos would be NaN.
    let centres = sphere::fibonacci(500);
    let beyond = centres.iter().filter(|c| c.components().iter().map(|x| x * x).sum::<f64>() > 1.0).count();
    assert!(beyond > 10, "the centres must contain the hazard");
    for spread in [0.05, 0.5, 3.0] {
        for kernel in [Kernel::Geodesic, Kernel::Spherical] {
            for centre in &centres {
                let srbf = Srbf::new(vec![*centre], spread, kernel).unwrap();
                let at = evaluate(&srbf, *centre)[0];
                // The geodesic kernel knows equal directions; the cosine of the other may be 1 - 2e-16.
                let missing = if kernel == Kernel::Geodesic { 0.0 } else { 5e-16 / (spread * spread) };
                assert!(at <= 1.0 && at >= 1.0 - missing, "{kernel:?} {centre:?}: {at:e}");
                let [x, y, z] = centre.components();
                let opposite = evaluate(&srbf, Direction::new(-x, -y, -z).unwrap())[0];
                let exponent = if kernel == Kernel::Geodesic { -PI * PI / 2.0 } else { -2.0 };
                let expected = libm::exp(exponent / (spread * spread));
                let tolerance = 2e-15 * (1.0 - exponent / (spread * spread)) * expected;
                assert!((opposite - expected).abs() <= tolerance, "{kernel:?}: {opposite:e} {expected:e}");
            }
        }
    }
}

#[test]
fn hammersley_points_and_their_distances() {
    for set in entries(&golden("hammersley.json"), "sets") {
        let (n, base) = (set["n"].as_u64().unwrap() as usize, set["base"].as_u64().unwrap() as usize);
        let points = sphere::hammersley(n, base);
        assert_eq!(points.len(), n);
        if set["points"].is_array() {
            for (k, (point, expected)) in points.iter().zip(entries(set, "points")).enumerate() {
                for (axis, value) in point.components().into_iter().enumerate() {
                    let expected = number(&expected[axis]);
                    assert!((value - expected).abs() < 1e-15, "n {n} base {base} {k}: {value} {expected}");
                }
            }
        }
        let nearest = sphere::nearest_neighbour_distances(&points);
        if n < 2 {
            assert!(nearest.is_empty());
            continue;
        }
        let (min, sum, max) = nearest
            .iter()
            .fold((f64::INFINITY, 0.0, 0.0f64), |(min, sum, max), &d| (min.min(d), sum + d, max.max(d)));
        for (value, key) in [(min, "nn_min"), (sum / n as f64, "nn_mean"), (max, "nn_max")] {
            let expected = number(&set[key]);
            assert!((value - expected).abs() < 2e-15, "n {n} base {base} {key}: {value} {expected}");
        }
    }
}

/// The SRBF basis of 20 Hammersley centres on the sphere.
fn twenty_centres(points: PointSet, spread: Spread) -> Srbf {
    let lights = LightSet::from_directions(sphere::fibonacci(50));
    let srbf = SrbfDesign { points, domain: Domain::Sphere, spread, kernel: Kernel::Geodesic };
    let design = Design { count: 20, lights: &lights, srbf };
    match Family::by_name("srbf").unwrap().build(&design).unwrap() {
        Basis::Srbf(srbf) => srbf,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_spread_read_literally_and_as_the_authors_program_has_it() {
    let file = golden("hammersley.json");
    let set = |base: u64| {
        entries(&file, "sets").iter().find(|set| set["n"] == 20 && set["base"] == base).expect("n = 20")
    };
    // The paper's words: the least distance between two centres, 20.4 degrees.
    let literal = twenty_centres(PointSet::Hammersley2, Spread::LeastDistance);
    assert!((literal.spread() - number(&set(2)["nn_min"])).abs() < 2e-15, "{}", literal.spread());
    assert!((literal.spread() * 180.0 / PI - 20.4).abs() < 0.05, "{}", literal.spread());
    // The authors' rbfcal.cpp: the mean, and base 3.
    let program = twenty_centres(PointSet::Hammersley3, Spread::OfMean(1.0));
    assert!((program.spread() - number(&set(3)["nn_mean"])).abs() < 2e-15, "{}", program.spread());
    for (srbf, base) in [(literal, 2), (program, 3)] {
        for (centre, expected) in srbf.centres().iter().zip(entries(set(base), "points")) {
            assert!(centre.angle_to(direction(expected)) < 2e-15, "{centre:?}");
        }
    }
}
