//! The matrix from samples to parameters, and the samples.

#![allow(clippy::unwrap_used, reason = "tests")]

mod shapes;

use relight_rig::{AxisFunction, Fitting, Ground, Model, RigError, Surface, least_squares};
use shapes::{cuboid, ell, flat, sphere};

/// `operator` times the values at `points`.
fn fitted(operator: &[f64], values: &[f64]) -> Vec<f64> {
    operator.chunks_exact(values.len()).map(|row| row.iter().zip(values).map(|(a, b)| a * b).sum()).collect()
}

#[test]
fn golden_operators_come_back() {
    let text = include_str!("../../../testdata/golden/rig_ls.json");
    let golden: serde_json::Value = serde_json::from_str(text).unwrap();
    let fraction = |text: &str| {
        let (top, bottom) = text.split_once('/').unwrap_or((text, "1"));
        top.parse::<f64>().unwrap() / bottom.parse::<f64>().unwrap()
    };
    for case in golden["cases"].as_array().unwrap() {
        let model = Model::parse(case["rig"].as_str().unwrap()).unwrap();
        let points: Vec<[f64; 3]> = serde_json::from_value(case["samples"].clone()).unwrap();
        let rows: Vec<Vec<String>> = serde_json::from_value(case["L"].clone()).unwrap();
        let expected: Vec<f64> = rows.iter().flatten().map(|text| fraction(text)).collect();
        let found = least_squares(&model, &points);
        assert_eq!(found.len(), expected.len());
        for (a, b) in found.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-12, "{case}: {found:?}");
        }
    }
}

#[test]
fn every_model_gives_back_the_lighting_that_it_can_hold() {
    let shape = sphere(24);
    let ground = Ground::new("", &shape.surface(), 300).unwrap();
    let coordinates: Vec<_> = ground.samples.iter().map(|s| ground.frame.coordinates(s.position)).collect();
    for text in [
        "constant",
        "gradient",
        "lattice:2x2x2",
        "lattice:3x1x2",
        "lattice:4x4x4",
        "mixed:3,gradient,constant",
        "mixed:gradient,5,2",
    ] {
        let model = Model::parse(text).unwrap();
        let parameters: Vec<f64> =
            (0..model.parameters().len()).map(|i| 1.0 + libm::sin(1.7 * i as f64)).collect();
        let mut weights = vec![0.0; parameters.len()];
        let mut value = |point: &[f64; 3]| -> f64 {
            model.weights(*point, &mut weights);
            weights.iter().zip(&parameters).map(|(a, b)| a * b).sum()
        };
        let values: Vec<f64> = coordinates.iter().map(&mut value).collect();
        let found = fitted(&least_squares(&model, &coordinates), &values);
        // Lattices give up a little for smoothness.
        let tolerance = if model.parameters().iter().flatten().any(|f| matches!(f, AxisFunction::Hat { .. }))
        {
            6e-2
        } else {
            1e-12
        };
        for (a, b) in found.iter().zip(&parameters) {
            assert!((a - b).abs() < tolerance, "{text}: {found:?} for {parameters:?}");
        }
    }
}

#[test]
fn nodes_without_surface_near_them_follow_their_neighbours() {
    let shape = ell();
    let ground = Ground::new("", &shape.surface(), 400).unwrap();
    let coordinates: Vec<_> = ground.samples.iter().map(|s| ground.frame.coordinates(s.position)).collect();
    let model = Model::parse("lattice:8x4x4").unwrap();
    let operator = least_squares(&model, &coordinates);
    let dead = |parameter: usize| {
        let mut weights = vec![0.0; model.parameters().len()];
        coordinates.iter().all(|&point| {
            model.weights(point, &mut weights);
            weights[parameter] == 0.0
        })
    };
    let dead: Vec<usize> = (0..model.parameters().len()).filter(|&p| dead(p)).collect();
    assert!(dead.len() > 20, "{} nodes lie in the air", dead.len());
    // Their columns of M are 0, and so are their rows of the pseudo-inverse alone: they would stay black. The same light all over is
    // the same light in the air, too.
    let ones = fitted(&operator, &vec![1.0; coordinates.len()]);
    assert!(ones.iter().all(|value| (value - 1.0).abs() < 1e-9), "{ones:?}");
    // Light that grows along x grows there, too: between its least and its largest value.
    let slope: Vec<f64> = coordinates.iter().map(|point| 2.0 + point[0]).collect();
    let values = fitted(&operator, &slope);
    for &parameter in &dead {
        assert!((0.9..3.1).contains(&values[parameter]), "node {parameter} is {}", values[parameter]);
    }
}

#[test]
fn where_a_mesh_stands_and_how_large_it_is_changes_nothing() {
    let near = sphere(24);
    let model = Model::parse("gradient").unwrap();
    // What a rig makes of light that falls off over the mesh, in the mesh's own measure.
    let fit = |shape: &shapes::Shape| {
        let ground = Ground::new("", &shape.surface(), 128).unwrap();
        let operator = ground.without_errors(&model, Fitting::Surface).operator;
        let light = |s: &relight_rig::SurfacePoint| libm::exp(-ground.frame.coordinates(s.position)[0]);
        fitted(&operator, &ground.samples.iter().map(light).collect::<Vec<_>>())
    };
    let reference = fit(&near);
    for (offset, scale) in [(0.0, 1e-6), (0.0, 1e6), (0.0, 1e-18), (0.0, 1e15), (100.0, 1.0), (4096.0, 1.0)] {
        let moved = near.clone().moved(|p| p.map(|c| c * scale + offset));
        let found = fit(&moved);
        let worst = found.iter().zip(&reference).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Rounded positions make other ones of equally good samples.
        assert!(worst < 0.02, "offset {offset}, scale {scale}: {found:?} for {reference:?}");
    }
    // Far away the mesh's own positions are on a grid of 1/16: it still has a rig of finite numbers.
    let far = near.moved(|p| [p[0] + 1e6, p[1] - 1e6, p[2] + 1e6]);
    let found = fit(&far);
    for (a, b) in found.iter().zip(&reference) {
        assert!((a - b).abs() < 0.1, "{found:?} for {reference:?}");
    }
}

/// Ratio of the largest to the least eigenvalue of M^T M, by Jacobi rotations.
fn condition_of_normal_equations(rows: &[[f64; 4]]) -> f64 {
    let mut a = [[0.0; 4]; 4];
    for row in rows {
        for i in 0..4 {
            for j in 0..4 {
                a[i][j] += row[i] * row[j];
            }
        }
    }
    for _ in 0..60 {
        for p in 0..3 {
            for q in p + 1..4 {
                if a[p][q] == 0.0 {
                    continue;
                }
                let angle = 0.5 * libm::atan2(2.0 * a[p][q], a[q][q] - a[p][p]);
                let (s, c) = libm::sincos(angle);
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                let [of_p, of_q] = [a[p], a[q]];
                a[p] = [0, 1, 2, 3].map(|k| c * of_p[k] - s * of_q[k]);
                a[q] = [0, 1, 2, 3].map(|k| s * of_p[k] + c * of_q[k]);
            }
        }
    }
    let values = [0, 1, 2, 3].map(|i| a[i][i]);
    values.iter().copied().fold(0.0, f64::max) / values.iter().copied().fold(f64::INFINITY, f64::min)
}

#[test]
fn centred_and_scaled_coordinates_are_well_conditioned_and_those_of_the_world_are_not() {
    let shape = sphere(24);
    let ground = Ground::new("", &shape.surface(), 256).unwrap();
    let rows = |map: &dyn Fn([f64; 3]) -> [f64; 3]| -> Vec<[f64; 4]> {
        let row = |p: [f64; 3]| [1.0, p[0], p[1], p[2]];
        ground.samples.iter().map(|s| row(map(s.position))).collect()
    };
    let ours = condition_of_normal_equations(&rows(&|p| ground.frame.coordinates(p))).sqrt();
    let world = condition_of_normal_equations(&rows(&|p| p.map(|c| c + 100.0))).sqrt();
    assert!(ours < 2.0, "{ours}");
    assert!(world > 1e4, "{world}: an f32 has 1.7e7, and normal equations square it");
}

#[test]
fn flat_meshes_have_no_slope_across() {
    let shape = flat();
    let ground = Ground::new("", &shape.surface(), 64).unwrap();
    assert_eq!(ground.frame.half_extent[2], 0.0);
    let operator = ground.without_errors(&Model::parse("gradient").unwrap(), Fitting::Surface).operator;
    let n = ground.samples.len();
    assert!(operator[3 * n..].iter().all(|value| *value == 0.0 || value.abs() < 1e-12), "minimum norm");
    let slope: Vec<f64> = ground.samples.iter().map(|s| 3.0 + 2.0 * s.position[0] - s.position[1]).collect();
    let found = fitted(&operator, &slope);
    for (a, b) in found.iter().zip([3.0, 2.0, -1.0, 0.0]) {
        assert!((a - b).abs() < 1e-9, "{found:?}");
    }
    // Nodes above and below the plane share what it has.
    let operator = ground.without_errors(&Model::parse("lattice:2x2x2").unwrap(), Fitting::Surface).operator;
    let found = fitted(&operator, &slope);
    for node in 0..4 {
        assert!((found[node] - found[node + 4]).abs() < 1e-3, "{found:?}");
    }
}

#[test]
fn samples_are_spread_by_area() {
    // A box of 4 x 1 x 1 whose long sides have a thousandth of the triangles: 16 of 18 parts of its area lie there.
    let shape = cuboid([0.0; 3], [4.0, 1.0, 1.0]);
    let points = shape.surface().spread(288, 1).unwrap();
    assert_eq!(points.len(), 288);
    let ends = points.iter().filter(|p| p.normal[0].abs() > 0.5).count();
    assert!((26..=38).contains(&ends), "{ends} of 288 on a ninth of the area");
    // Evenly: the distance to the nearest other is nearly the same everywhere, which random points' is not.
    let ratio = |points: &[relight_rig::SurfacePoint]| {
        let nearest = |i: usize| {
            let d = |j: usize| {
                (0..3).map(|c| (points[i].position[c] - points[j].position[c]).powi(2)).sum::<f64>().sqrt()
            };
            (0..points.len()).filter(|&j| j != i).map(d).fold(f64::INFINITY, f64::min)
        };
        let all: Vec<f64> = (0..points.len()).map(nearest).collect();
        all.iter().copied().fold(f64::INFINITY, f64::min) / (all.iter().sum::<f64>() / all.len() as f64)
    };
    let round = sphere(48);
    let (spread, strewn) = (round.surface().spread(256, 1).unwrap(), round.surface().strewn(256, 1).unwrap());
    assert!(ratio(&spread) > 0.6, "{}", ratio(&spread));
    assert!(ratio(&strewn) < 0.4, "{}", ratio(&strewn));
    assert_eq!(spread, round.surface().spread(256, 1).unwrap(), "the same seed, the same points");
    assert_ne!(spread, round.surface().spread(256, 2).unwrap());
    for point in &spread {
        let length = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        assert!((length(point.normal) - 1.0).abs() < 1e-12 && length(point.position) > 0.99);
    }
}

#[test]
fn meshes_without_area_and_broken_ones_have_samples_or_a_reason() {
    let point = Surface { positions: &[[3.0, 4.0, 5.0]], normals: &[], triangles: &[[0, 0, 0]] };
    let ground = Ground::new("", &point, 16).unwrap();
    assert!(ground.samples.iter().all(|s| s.position == [3.0, 4.0, 5.0]) && ground.frame.radius == 1.0);
    let operator = ground.without_errors(&Model::parse("lattice:2x2x2").unwrap(), Fitting::Surface).operator;
    let ones = fitted(&operator, &vec![1.0; ground.samples.len()]);
    assert!(ones.iter().all(|value| (value - 1.0).abs() < 1e-9), "{ones:?}");
    let line = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
    let degenerate = Surface { positions: &line, normals: &[], triangles: &[[0, 1, 2], [0, 0, 1]] };
    assert_eq!(Ground::new("", &degenerate, 16).unwrap().samples.len(), 6, "each vertex, from both sides");
    // A triangle among degenerate ones is where all samples lie.
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0, 9.0, 9.0]];
    let mixed =
        Surface { positions: &positions, normals: &[], triangles: &[[3, 3, 3], [0, 1, 2], [0, 0, 3]] };
    let samples = Ground::new("", &mixed, 32).unwrap().samples;
    assert!(
        samples.len() == 32 && samples.iter().all(|s| s.position[2] == 0.0 && s.normal == [0.0, 0.0, 1.0])
    );
    let empty = Surface { positions: &[], normals: &[], triangles: &[] };
    assert_eq!(Ground::new("", &empty, 16).err(), Some(RigError::NoSurface));
    assert!(matches!(Ground::new("", &mixed, 0), Err(RigError::Samples { .. })));
    assert!(matches!(Ground::new("", &mixed, 100_000), Err(RigError::Samples { .. })));
}

#[test]
fn a_million_triangles_are_sampled_like_a_few() {
    let (fine, coarse) = (sphere(708), sphere(24));
    assert!(fine.triangles.len() > 1_000_000);
    let [fine, coarse] = [&fine, &coarse].map(|shape| Ground::new("", &shape.surface(), 128).unwrap());
    let mean = |ground: &Ground| {
        [0, 1, 2].map(|c| ground.samples.iter().map(|s| s.position[c]).sum::<f64>() / 128.0)
    };
    for (a, b) in mean(&fine).iter().zip(mean(&coarse)) {
        assert!((a - b).abs() < 0.03, "{a} {b}");
    }
    assert!((fine.frame.radius - 1.0).abs() < 1e-6);
}

#[test]
fn models_that_make_no_sense_are_refused_with_the_forms() {
    for text in [
        "",
        "quadratic",
        "gradient:2",
        "lattice",
        "lattice:2x2",
        "lattice:0x2x2",
        "lattice:65x1x1",
        "mixed:3,linear,2",
        "mixed:2,2,2,2",
    ] {
        let error = Model::parse(text).unwrap_err();
        assert!(
            matches!(error, RigError::Model { .. }) && error.to_string().contains("lattice:XxYxZ"),
            "{text}: {error}"
        );
    }
    assert!(matches!(
        Model::parse("lattice:9x9x9"),
        Err(RigError::TooManyParameters { parameters: 729, most: 512 })
    ));
}
