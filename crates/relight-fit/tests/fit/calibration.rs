//! Mirror spheres and the rays that leave them, against closed forms.

use crate::pictures::random;
use relight_core::vectors::{cross, difference, dot, length, scaled, unit};
use relight_fit::calibration::{
    LuminancePicture, MirrorSphere, Ray, SphereError, SphereOutline, Viewer, find_highlight, find_outlines,
    mean_direction, position_of,
};

const SIZE: (usize, usize) = (400, 300);

fn outline(x: f64, y: f64, radius: f64) -> SphereOutline {
    SphereOutline { x, y, radius, rise: None }
}

#[test]
fn spheres_show_what_the_law_of_reflection_says() {
    let sphere = MirrorSphere::from_outline(&outline(250.0, 90.0, 40.0), SIZE, Viewer::Orthographic).unwrap();
    assert_eq!((sphere.centre, sphere.radius), ([50.0, 60.0, 40.0], 40.0));
    // In the middle the viewer; at half the root of 2 of the radius what lies beside, at the rim what lies behind.
    let at = |part: f64| sphere.reflection([250.0, 90.0 - part * 40.0], SIZE, Viewer::Orthographic);
    for (part, expected) in
        [(0.0, [0.0, 0.0, 1.0]), (0.5f64.sqrt(), [0.0, 1.0, 0.0]), (1.0, [0.0, 0.0, -1.0])]
    {
        let ray = at(part).unwrap();
        assert!(length(difference(ray.direction, expected)) < 1e-6, "{part}: {ray:?}");
        assert!((length(difference(ray.origin, sphere.centre)) - 40.0).abs() < 1e-9, "{part}");
    }
    assert_eq!(at(1.001), None);
    let raised = SphereOutline { rise: Some(7.0), ..outline(250.0, 90.0, 40.0) };
    let raised = MirrorSphere::from_outline(&raised, SIZE, Viewer::Orthographic).unwrap();
    assert_eq!(raised.centre, [50.0, 60.0, 7.0]);
}

#[test]
fn a_sphere_in_perspective_has_the_outline_it_was_made_from() {
    let distance = 700.0;
    let viewer = Viewer::Perspective { distance };
    let given = outline(330.0, 60.0, 45.0);
    let sphere = MirrorSphere::from_outline(&given, SIZE, viewer).unwrap();
    assert_eq!(sphere.centre[2], sphere.radius);
    // The tangents from the eye to the sphere, where they meet the plane z = 0: a circle around the way to its middle.
    let eye = [0.0, 0.0, distance];
    let way = difference(sphere.centre, eye);
    let axis = unit(way).unwrap();
    let side = unit(cross(axis, [0.0, 0.0, 1.0])).unwrap();
    let up = cross(axis, side);
    let sine = sphere.radius / length(way);
    let cosine = (1.0 - sine * sine).sqrt();
    let edge = |angle: f64| {
        let (s, c) = libm::sincos(angle);
        let ray: [f64; 3] = std::array::from_fn(|i| cosine * axis[i] + sine * (c * side[i] + s * up[i]));
        [-distance * ray[0] / ray[2], -distance * ray[1] / ray[2]]
    };
    let turn = std::f64::consts::TAU;
    let points: Vec<[f64; 2]> = (0..4000).map(|i| edge(turn * f64::from(i) / 4000.0)).collect();
    let bounds = |c: usize| {
        let least = points.iter().fold(f64::INFINITY, |least, p| least.min(p[c]));
        (least, points.iter().fold(f64::NEG_INFINITY, |most, p| most.max(p[c])))
    };
    let ((left, right), (bottom, top)) = (bounds(0), bounds(1));
    let middle = [0.5 * (left + right) + 200.0, 150.0 - 0.5 * (bottom + top)];
    assert!((middle[0] - given.x).abs() < 1e-3 && (middle[1] - given.y).abs() < 1e-3, "{middle:?}");
    let from_middle = |p: &[f64; 2]| libm::hypot(p[0] + 200.0 - given.x, 150.0 - p[1] - given.y);
    let axes = points.iter().map(from_middle);
    let (least, most) = axes.fold((f64::INFINITY, 0.0f64), |(a, b), r| (a.min(r), b.max(r)));
    assert!(most / least > 1.01, "the outline must be an ellipse: {least} {most}");
    assert!((0.5 * (least + most) - given.radius).abs() < 1e-3, "{least} {most}");
    // Far away it is the orthographic one.
    let far = MirrorSphere::from_outline(&given, SIZE, Viewer::Perspective { distance: 1e9 }).unwrap();
    let flat = MirrorSphere::from_outline(&given, SIZE, Viewer::Orthographic).unwrap();
    assert!(length(difference(far.centre, flat.centre)) < 1e-3 && (far.radius - flat.radius).abs() < 1e-3);
}

#[test]
fn outlines_that_are_no_spheres_are_refused() {
    let sphere = |outline, viewer| MirrorSphere::from_outline(&outline, SIZE, viewer);
    for radius in [1.0, f64::NAN, f64::INFINITY, -20.0] {
        let refused = sphere(outline(50.0, 50.0, radius), Viewer::Orthographic).unwrap_err();
        assert!(matches!(refused, SphereError::Radius { .. }), "{radius}");
    }
    let refused = sphere(outline(50.0, 300.5, 20.0), Viewer::Orthographic).unwrap_err();
    assert!(matches!(refused, SphereError::Outside { .. }));
    let near = Viewer::Perspective { distance: 80.0 };
    assert!(matches!(sphere(outline(200.0, 150.0, 140.0), near), Err(SphereError::TooNear { .. })));
}

/// Rays from `origins` to `lamp`, each turned by up to `error` radians.
fn rays(origins: &[[f64; 3]], lamp: [f64; 3], error: f64) -> Vec<Ray> {
    let ray = |(i, origin): (usize, &[f64; 3])| {
        let way = unit(difference(lamp, *origin)).unwrap();
        let noise: [f64; 3] = std::array::from_fn(|c| error * random(i, c));
        Ray { origin: *origin, direction: unit(std::array::from_fn(|c| way[c] + noise[c])).unwrap() }
    };
    origins.iter().enumerate().map(ray).collect()
}

#[test]
fn rays_meet_at_the_lamp() {
    let origins = [[-300.0, 10.0, 50.0], [280.0, -150.0, 60.0], [40.0, 220.0, 40.0]];
    let lamp = [120.0, -340.0, 610.0];
    for count in [2, 3] {
        let found = position_of(&rays(&origins[..count], lamp, 0.0)).unwrap();
        assert!(length(difference(found.position, lamp)) < 1e-9 && found.residual < 1e-12, "{found:?}");
    }
    let found = position_of(&rays(&origins, lamp, 1e-3)).unwrap();
    assert!(length(difference(found.position, lamp)) < 6.0, "{found:?}");
    assert!((1e-4..2e-3).contains(&found.residual), "{found:?}");
    // Far lamps, one ray, and rays that part.
    let far = scaled([0.6, 0.0, 0.8], 1e5);
    assert_eq!(position_of(&rays(&origins, far, 0.0)), None);
    assert_eq!(position_of(&rays(&origins[..1], lamp, 0.0)), None);
    let mut parting = rays(&origins[..2], lamp, 0.0);
    parting.iter_mut().for_each(|ray| ray.direction = scaled(ray.direction, -1.0));
    assert_eq!(position_of(&parting), None);
    assert!(mean_direction(&[]).is_none());
    let (mean, widest) = mean_direction(&rays(&origins[..2], far, 0.0)).unwrap();
    assert!(dot(mean.components(), [0.6, 0.0, 0.8]) > 1.0 - 1e-6 && widest < 0.006, "{widest}");
}

/// A dark disc with bright spots (x, y, radius, value) in a grey picture.
fn picture(disc: [f64; 3], spots: &[[f64; 4]]) -> LuminancePicture {
    let value = |at: usize| {
        let (x, y) = ((at % SIZE.0) as f64 + 0.5, (at / SIZE.0) as f64 + 0.5);
        let covered =
            |[cx, cy, radius]: [f64; 3]| (radius + 0.5 - libm::hypot(x - cx, y - cy)).clamp(0.0, 1.0);
        let ground = 0.3 + 0.05 * random(at, 1);
        let dark = ground + covered(disc) * (0.02 - ground);
        let lit = spots.iter().map(|&[x, y, r, value]| value * covered([x, y, r])).fold(0.0, f64::max);
        dark.max(lit) as f32
    };
    LuminancePicture { left: 0, top: 0, width: SIZE.0, values: (0..SIZE.0 * SIZE.1).map(value).collect() }
}

#[test]
fn highlights_are_found_to_a_part_of_a_pixel() {
    let given = outline(170.3, 140.8, 60.2);
    let sphere = MirrorSphere::from_outline(&given, SIZE, Viewer::Orthographic).unwrap();
    let find = |picture: &LuminancePicture| {
        find_highlight(&picture.around(&given, 1.0), &given, &sphere, SIZE, Viewer::Orthographic)
    };
    // The second spot is smaller; the third, larger and brighter, lies where the sphere shows the table.
    let disc = [170.3, 140.8, 60.2];
    let spots = [[150.4, 121.7, 2.3, 0.9], [190.0, 150.0, 1.2, 0.9], [120.0, 145.0, 6.0, 1.0]];
    let found = find(&picture(disc, &spots)).unwrap();
    assert!((found.at[0] - 150.4).abs() < 0.05 && (found.at[1] - 121.7).abs() < 0.05, "{found:?}");
    let expected = sphere.reflection([150.4, 121.7], SIZE, Viewer::Orthographic).unwrap();
    assert!(dot(found.ray.direction, expected.direction) > 1.0 - 1e-5, "{found:?}");
    assert!((0.2..0.6).contains(&found.rival), "{found:?}");
    assert_eq!(find(&picture(disc, &[])), None);
    assert_eq!(find(&picture(disc, &[[165.0, 140.0, 30.0, 0.9]])), None, "a window is no lamp");
}

#[test]
fn outlines_of_spheres_are_found_and_others_are_not() {
    let found = find_outlines(&picture([170.3, 140.8, 60.2], &[[330.0, 80.0, 21.5, 0.9]]));
    println!("{found:?}");
    assert_eq!(found.len(), 2);
    for [x, y, radius] in [[170.3, 140.8, 60.2], [330.0, 80.0, 21.5]] {
        let near = |found: &SphereOutline| {
            libm::hypot(found.x - x, found.y - y) < 0.2 && (found.radius - radius).abs() < 0.3
        };
        assert!(found.iter().any(|found| near(&found.outline) && found.support > 0.95), "{x}: {found:?}");
    }
    assert_eq!(find_outlines(&picture([-1e3, -1e3, 1.0], &[])), []);
    let nothing = LuminancePicture { left: 0, top: 0, width: 3, values: vec![0.5; 9] };
    assert_eq!(find_outlines(&nothing), []);
}
