//! Errors by distance: the tables, the envelope, the cheapest model and the plan.

#![allow(clippy::unwrap_used, reason = "tests")]

mod shapes;

use relight_core::{CpuLevel, srgb_from_linear};
use relight_rig::{
    Envelope, Fitting, Ground, Light, LightFamily, Model, Pixels, PlacedPart, Placement, RigPart, Source,
    cheapest, directions, error_table, plan,
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

/// A small sphere light of radiance (1 / .01)^2 at a place.
fn small_light(centre: [f64; 3]) -> Light {
    Light { name: String::new(), source: Source::Sphere { centre, radius: 0.01 }, color: [1e4; 3] }
}

#[test]
fn false_zeros_of_the_papers_criterion_are_not_chosen() {
    // MATH.md, section 1.4: at the point that faces the light, the overshoot of three bands cancels the rig's own error at 33.5
    // radii (constant) and 6.78 radii (gradient).
    let shape = sphere(48);
    for (model, zero) in [("constant", 33.5), ("gradient", 6.78)] {
        let part = part(&shape, model, Fitting::Nodes);
        let facing = |distance: f64| {
            let light = small_light([0.0, 0.0, distance]);
            let coefficients = part.coefficients(&[(&light, 1.0)], &Placement::IDENTITY, 3);
            let rig = part.reflectance(&coefficients, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0])[0];
            rig - light.irradiance([0.0, 0.0, 1.0], [0.0, 0.0, 1.0])[0] / PI
        };
        let (mut near, mut far) = (0.9 * zero, 1.1 * zero);
        assert!(facing(near) * facing(far) < 0.0, "{model}: the sign changes around {zero}");
        for _ in 0..40 {
            let middle = 0.5 * (near + far);
            if facing(near) * facing(middle) <= 0.0 { far = middle } else { near = middle }
        }
        assert!((near / zero - 1.0).abs() < 0.02, "{model}: {near}");
        // Ours is far from 0 there, and falls all the way.
        let table = error_table(&part, 3, &directions(), &[0.8 * zero, zero, 1.2 * zero, 2.0 * zero]);
        assert!(table.total[1] > 0.03 / (zero * zero), "{model}: {:?}", table.total);
        let envelope = Envelope::new(&table).unwrap();
        let errors: Vec<f64> = (0..100).map(|i| envelope.error(zero * (0.8 + 0.02 * f64::from(i)))).collect();
        assert!(errors.windows(2).all(|pair| pair[1] <= pair[0]), "{model}");
        for strength in [0.1, 1.0, 50.0] {
            let error = envelope.error(1.1 * zero) * strength;
            assert!((envelope.distance(strength, error) / (1.1 * zero) - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn the_cheapest_model_refines_the_axes_that_need_it() {
    let lights = LightFamily { nearest: 3.0, brightness: 0.25 };
    let long = ground(&cuboid([-4.0, -0.5, -0.4], [4.0, 0.5, 0.4]));
    let tried = cheapest(&long, Fitting::Surface, 3, lights, 8.0, 512).unwrap();
    let found = tried.last().unwrap();
    assert!(found.error_grey <= 8.0, "{found:?}");
    let nodes = |axis: usize| {
        let functions = found.model.parameters().iter().map(|product| format!("{:?}", product[axis]));
        functions.collect::<std::collections::HashSet<_>>().len()
    };
    assert!(nodes(0) >= 3 && nodes(0) > nodes(1).max(nodes(2)), "{}", found.model.text());
    let cheaper = tried.iter().filter(|c| c.model.parameters().len() < found.model.parameters().len());
    assert!(cheaper.into_iter().all(|choice| choice.error_grey > 8.0), "{tried:?}");
    // Far lights need nothing but a constant.
    let far = LightFamily { nearest: 500.0, brightness: 0.25 };
    assert_eq!(
        cheapest(&long, Fitting::Surface, 3, far, 8.0, 512).unwrap().last().unwrap().model.text(),
        "constant"
    );
}

/// A part with its table.
fn baked(shape: &shapes::Shape, model: &str) -> RigPart {
    ground(shape).part(&Model::parse(model).unwrap(), Fitting::Surface, 3)
}

#[test]
fn plans_keep_the_tolerance_and_leave_out_what_is_not_seen() {
    let part = baked(&sphere(32), "gradient");
    let placed = PlacedPart { part: &part, placement: Placement::IDENTITY };
    let mut lights =
        vec![small_light([1.5, 0.2, 0.3]), small_light([40.0, 3.0, 8.0]), small_light([0.0, 900.0, 0.0])];
    lights[1].color = [4e6, 3e6, 2e6];
    lights.push(Light {
        name: String::new(),
        source: Source::Directional { direction: [0.0, 0.0, 1.0] },
        color: [1.5; 3],
    });
    let level = CpuLevel::detect();
    let plan = plan(&[(&lights, vec![placed])], 3, 2.0, level);
    let plans = &plan.pictures[0].parts[0];
    assert_eq!(plans[0].analytic, 1.0, "right beside the mesh: {plans:?}");
    assert!(plans[2].dropped && !plans[1].dropped, "{plans:?}");
    assert_eq!(plans[3].analytic, 1.0, "as bright a sun shows what three bands lack: {plans:?}");
    // Against brute force at other points than those that the plan was measured at.
    let mut pixels = Pixels::default();
    for point in sphere(32).surface().strewn(4000, 99).unwrap() {
        pixels.push(&placed, point.position, point.normal);
    }
    let exact = pixels.by_brute_force(&placed, &lights, level);
    let planned = pixels.by_plan(&placed, &lights, plans, 3, level);
    let encoded = |v: f32| 255.0 * srgb_from_linear(v.clamp(0.0, 1.0));
    let worst =
        exact.iter().flatten().zip(planned.iter().flatten()).map(|(a, b)| (encoded(*a) - encoded(*b)).abs());
    let worst = worst.fold(0.0, f32::max);
    assert!(worst <= 2.0 && worst > 0.0, "{worst}");
    assert!(plan.pictures[0].error_grey.unwrap() <= 2.0);
}

#[test]
fn a_light_that_flies_past_does_not_pop() {
    let part = baked(&sphere(32), "gradient");
    let placed = PlacedPart { part: &part, placement: Placement::IDENTITY };
    let frames = 160;
    let light = |frame: usize| {
        // 40 radii to 1.6 and away again, by the same ratio a frame.
        let share = (2.0 * frame as f64 / (frames - 1) as f64 - 1.0).abs();
        let along = (libm::pow(40.0 / 1.6, share) - 1.0) * 1.6;
        let mut light = small_light([1.6, if 2 * frame < frames { along } else { -along }, 0.2]);
        light.color = [3e4, 2e4, 1e4];
        light
    };
    let lights: Vec<_> = (0..frames).map(|frame| [light(frame)]).collect();
    let pictures: Vec<_> = lights.iter().map(|light| (&light[..], vec![placed])).collect();
    let level = CpuLevel::detect();
    let plan = plan(&pictures, 3, 1.0, level);
    let mut pixels = Pixels::default();
    for point in sphere(32).surface().strewn(600, 5).unwrap() {
        pixels.push(&placed, point.position, point.normal);
    }
    let mut worst = 0.0f32;
    let mut in_transition = 0;
    let mut before: Option<[relight_rig::Reflected; 2]> = None;
    for (frame, &(lights, _)) in pictures.iter().enumerate() {
        let plans = &plan.pictures[frame].parts[0];
        let now =
            [pixels.by_plan(&placed, lights, plans, 3, level), pixels.by_brute_force(&placed, lights, level)];
        if let Some(before) = &before {
            let change = |which: usize| {
                let pairs = now[which].iter().flatten().zip(before[which].iter().flatten());
                pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            };
            if plans[0].analytic > 0.0 && plans[0].analytic < 1.0 {
                in_transition += 1;
                worst = worst.max(change(0) / change(1));
            }
        }
        before = Some(now);
    }
    assert!(in_transition >= 4, "{in_transition}");
    assert!(worst < 2.0, "a frame changes by up to {worst} times as much as by brute force");
}
