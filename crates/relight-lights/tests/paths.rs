//! Every way of evaluating a basis against the basis itself, in f64, at directions that are hard.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{Basis, CpuLevel, Design, Direction, Family, LightSet};
use relight_lights::{Accuracy, Directions, Evaluator, Path};
use std::f64::consts::PI;

fn bases() -> Vec<Basis> {
    let dome = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.4 }, 60);
    let sets = [LightSet::from_directions(dome), LightSet::default()];
    let mut bases = Vec::new();
    for (family, counts) in [
        ("srbf", &[3usize, 25, 64][..]),
        ("ptm", &[6, 10, 15]),
        ("sh", &[1, 9, 36, 121]),
        ("hsh", &[1, 4, 9, 16]),
    ] {
        for &count in counts {
            for set in &sets {
                bases.push(Family::by_name(family).unwrap().build(&Design::new(count, set)).unwrap());
            }
        }
    }
    for kernel in [relight_core::basis::Kernel::Geodesic, relight_core::basis::Kernel::Spherical] {
        for spread in [0.1, 0.2, 0.5, 1.2] {
            let centres = fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, 20);
            bases.push(Basis::Srbf(relight_core::basis::Srbf::new(centres, spread, kernel).unwrap()));
        }
    }
    bases
}

/// All around, the poles and axes, the centres of the basis, their opposites and close to both.
fn directions(basis: &Basis) -> Vec<Direction> {
    let mut all = fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, 500);
    for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
        for sign in [1.0, -1.0] {
            for off in [0.0, 1e-8, 1e-4] {
                all.push(Direction::new(sign * axis[0] + off, sign * axis[1], sign * axis[2] - off).unwrap());
            }
        }
    }
    if let Basis::Srbf(srbf) = basis {
        for centre in srbf.centres() {
            let c = centre.components();
            for sign in [1.0, -1.0] {
                for off in [0.0, 1e-7, 1e-3] {
                    all.push(Direction::new(sign * c[0] + off, sign * c[1], sign * c[2]).unwrap());
                }
            }
        }
    }
    all
}

/// The largest error of `path` over those directions, relative to the largest value of a function of
/// order l, which only grows with SH.
fn worst_error(basis: &Basis, path: Path, level: CpuLevel) -> f64 {
    let evaluator = Evaluator::new(basis, path).unwrap();
    let all = directions(basis);
    let axis = |a: usize| -> Vec<f32> { all.iter().map(|d| d.components()[a] as f32).collect() };
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let n = all.len();
    let mut found = vec![f32::NAN; n * basis.count()];
    evaluator.evaluate(level, Directions { x: &x, y: &y, z: &z }, &mut found);
    let mut exact = vec![0.0; basis.count()];
    let mut worst = 0.0f64;
    for i in 0..n {
        // Of the direction that the evaluator was given: rounding to f32 is the position's, not the path's.
        let given = Direction::new(f64::from(x[i]), f64::from(y[i]), f64::from(z[i])).unwrap();
        basis.evaluate(given, &mut exact);
        for (j, exact) in exact.iter().enumerate() {
            let error = (f64::from(found[j * n + i]) - exact).abs();
            assert!(error.is_finite(), "{path} {}: {} at {given:?}", basis.label(j), found[j * n + i]);
            worst = worst.max(error);
        }
    }
    worst
}

#[test]
fn formulas_hold_to_the_rounding_of_f32_at_every_level() {
    for basis in bases() {
        // SH of order 10 reach 1.3 and their recursion has ten steps.
        let allowed = match &basis {
            Basis::Sh(_) => 8e-6,
            Basis::Hsh(_) => 5e-6,
            _ => 3e-6,
        };
        for level in CpuLevel::available() {
            let worst = worst_error(&basis, Path::Exact, level);
            assert!(worst < allowed, "{} {}: {worst:e}", basis.family().name, basis.count());
        }
    }
}

#[test]
fn an_accuracy_is_kept_by_the_path_that_is_taken_for_it() {
    for basis in bases() {
        for accuracy in Accuracy::ALL {
            let path = Path::of_accuracy(&basis, accuracy);
            let worst = worst_error(&basis, path, CpuLevel::detect());
            let allowed = accuracy.error().max(8e-6);
            assert!(worst <= allowed, "{} {}: {path} errs by {worst:e}", basis.family().name, basis.count());
        }
    }
    let short = bases().into_iter().map(|basis| Path::of_accuracy(&basis, Accuracy::Coarse));
    assert!(short.into_iter().any(|path| path == Path::Coarse), "something is gained");
}

/// MATH.md section 1.2: the nodes that its formula asks for are enough, and a third of them are not.
#[test]
fn tables_need_the_nodes_that_their_formula_says() {
    for basis in bases() {
        let Basis::Srbf(srbf) = &basis else { continue };
        // Wide ones have their slope's singularity opposite to the centre.
        if srbf.spread() > 0.6 {
            continue;
        }
        for error in [1e-3, 1e-4] {
            let nodes = Path::cosine_nodes(srbf.spread(), error);
            let enough = worst_error(&basis, Path::CosineTable { nodes: nodes + 1 }, CpuLevel::detect());
            assert!(enough < 1.3 * error, "cosine {} {nodes}: {enough:e}", srbf.spread());
            let nodes = Path::half_sine_nodes(srbf.spread(), error);
            let enough = worst_error(&basis, Path::HalfSineTable { nodes }, CpuLevel::detect());
            assert!(enough < 1.3 * error, "half sine {} {nodes}: {enough:e}", srbf.spread());
        }
        let few = Path::cosine_nodes(srbf.spread(), 1e-3) / 3;
        assert!(worst_error(&basis, Path::CosineTable { nodes: few.max(2) }, CpuLevel::detect()) > 2e-3);
    }
}

/// The ends of a table: the centre itself and its opposite, and beyond by rounding.
#[test]
fn tables_end_at_the_kernels_own_values() {
    let centre = Direction::new(0.3, -0.5, 0.8).unwrap();
    let srbf =
        relight_core::basis::Srbf::new(vec![centre], 0.7, relight_core::basis::Kernel::Geodesic).unwrap();
    let basis = Basis::Srbf(srbf);
    for path in [Path::CosineTable { nodes: 64 }, Path::HalfSineTable { nodes: 64 }] {
        let evaluator = Evaluator::new(&basis, path).unwrap();
        let c = centre.components().map(|c| c as f32);
        // Longer than 1 by rounding: the dot product leaves -1 .. 1.
        let scale = 1.0 + 3e-7f32;
        let axis = |a: usize| [scale * c[a], -scale * c[a], f32::NAN];
        let mut out = [0.0f32; 3];
        evaluator.evaluate(
            CpuLevel::detect(),
            Directions { x: &axis(0), y: &axis(1), z: &axis(2) },
            &mut out,
        );
        let opposite = libm::exp(-PI * PI / (2.0 * 0.49)) as f32;
        assert!((out[0] - 1.0).abs() < 1e-5 && (out[1] - opposite).abs() < 1e-5, "{path}: {out:?}");
        assert!(out[2].is_finite(), "not a number stays within the table");
    }
}

#[test]
fn cube_maps_converge_and_have_no_seams() {
    for basis in bases() {
        // HSH bend sharply at the horizon, wide Gaussians opposite to their centres.
        let bends = match &basis {
            Basis::Srbf(srbf) => srbf.spread() > 0.6,
            Basis::Hsh(_) => true,
            _ => basis.count() > 40,
        };
        if bends {
            continue;
        }
        let [coarse, fine] =
            [32, 128].map(|size| worst_error(&basis, Path::CubeMap { size }, CpuLevel::BASELINE));
        assert!(fine < 0.12 * coarse + 1e-6, "{}: {coarse:e} {fine:e}", basis.family().name);
    }
}

#[test]
fn tables_are_for_gaussians_alone() {
    let basis = Family::by_name("sh").unwrap().build(&Design::new(9, &LightSet::default())).unwrap();
    let error = Evaluator::new(&basis, Path::CosineTable { nodes: 64 }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "functions of sh can't be evaluated by a table of 64 over the cosine; tables are for srbf"
    );
}
