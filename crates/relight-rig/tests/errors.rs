//! Errors by distance: the tables, the envelope, the cheapest model and the plan.

#![allow(clippy::unwrap_used, reason = "tests")]

mod shapes;

use relight_rig::{
    Envelope, Fitting, Ground, Light, LightFamily, Model, Placement, RigPart, Source, cheapest, directions,
    error_table,
};
use shapes::{cuboid, sphere};
use std::f64::consts::PI;

const DISTANCES: [f64; 5] = [2.0, 3.0, 4.0, 6.0, 12.0];

fn ground(shape: &shapes::Shape) -> Ground {
    Ground::new("", &shape.surface(), 512).unwrap()
}

fn part(shape: &shapes::Shape, model: &str, fitting: Fitting) -> RigPart {
    ground(shape).without_errors(&Model::parse(model).unwrap(), fitting)
}

#[test]
fn errors_on_a_sphere_are_those_of_the_mathematics() {
    // MATH.md, section 1.4: max error / (L (r/R)^2) at 2, 3, 4, 6, 12 radii. Those of lattices depend on the direction: they are
    // the ones towards (.36, .48, .8).
    let toward = [0.36, 0.48, 0.8];
    let shape = sphere(48);
    let expected = [
        ("constant", Fitting::Nodes, [0.75, 0.14, 0.050, 0.013, 1.4e-3]),
        ("constant", Fitting::Surface, [0.75, 0.14, 0.050, 0.013, 1.4e-3]),
        ("gradient", Fitting::Nodes, [0.49, 0.066, 0.018, 3e-3, 1.7e-4]),
        ("gradient", Fitting::Surface, [0.51, 0.068, 0.018, 3.2e-3, 1.7e-4]),
        ("lattice:2x2x2", Fitting::Surface, [0.33, 0.033, 8e-3, 1.2e-3, 6e-5]),
        ("lattice:4x4x4", Fitting::Surface, [0.052, 4e-3, 1e-3, 1.7e-4, 9e-6]),
    ];
    for (model, fitting, expected) in expected {
        let part = part(&shape, model, fitting);
        let table = error_table(&part, 3, &[toward], &DISTANCES);
        println!("{model} {fitting:?}: {:?}", table.rig);
        let all = error_table(&part, 3, &directions(), &DISTANCES);
        println!("  any direction: {:?}", all.rig);
        for (i, expected) in expected.into_iter().enumerate() {
            let ratio = table.rig[i] / expected;
            assert!(
                (0.89..1.12).contains(&ratio),
                "{model} {fitting:?} at {}: {} for {expected}",
                DISTANCES[i],
                table.rig[i]
            );
            assert!(all.rig[i] >= 0.8 * table.rig[i]);
        }
    }
}
