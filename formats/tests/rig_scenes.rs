//! Scene files as rigs know them: lights in physical units, motions of objects and parts.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

use relight_core::CpuLevel;
use relight_core::vectors::{cross, difference, dot, length, wide};
use relight_formats::{FormatError, RigScene, SceneFile, read_mesh, read_mesh_parts, read_scene};
use relight_lights::Lamp;
use relight_rig::{Light, Placement, Source};
use relight_surface::Mesh;
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

fn scene_file(text: &str) -> Result<SceneFile, FormatError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    fs::write(&path, text).unwrap();
    fs::write(folder.path().join("sky.hdr"), sky()).unwrap();
    read_scene(&path, CpuLevel::BASELINE, 1 << 24)
}

fn rig_scene(text: &str, time: f64) -> RigScene {
    scene_file(text).unwrap().rig_scene(Path::new("scene.toml"), time).unwrap()
}

fn light(text: &str, time: f64) -> Light {
    rig_scene(&format!("[[light]]\n{text}"), time).lights.remove(0)
}

#[track_caller]
fn assert_near(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= tolerance * b.abs().max(1.0), "{found:?} for {expected:?}");
    }
}

/// 32 x 16 pixels: red from the half around the middle, green from the upper half, blue from everywhere.
fn sky() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n".to_vec();
    for (y, x) in (0..16).flat_map(|y| (0..32).map(move |x| (y, x))) {
        let lit = |is: bool| if is { 128 } else { 0 };
        bytes.extend([lit((8..24).contains(&x)), lit(y < 8), 128, 129]);
    }
    bytes
}

#[test]
fn lights_shine_in_physical_units() {
    let sphere = light(
        "kind = \"sphere\"\nposition = [1, 2, 3]\nradius = 0.5\nintensity = 2\ncolor = [1, 0.5, 0.25]",
        0.0,
    );
    assert_eq!(sphere.source, Source::Sphere { centre: [1.0, 2.0, 3.0], radius: 0.5 });
    // Facing, at distance d: irradiance radiance x pi (r / d)^2, and reflected from white intensity / d^2.
    let d = 40.0;
    assert_near(&sphere.color.map(|c| c * 0.5 * 0.5 / (d * d)), &[2.0, 1.0, 0.5].map(|i| i / (d * d)), 1e-15);

    let disc =
        light("kind = \"disc\"\nposition = [0, 0, 4]\ndirection = [0, 3, -4]\nradius = 2\nradiance = 7", 0.0);
    assert_eq!(disc.source, Source::Disc { centre: [0.0, 0.0, 4.0], normal: [0.0, 0.6, -0.8], radius: 2.0 });
    assert_eq!(disc.color, [7.0; 3]);
    let disc =
        light("kind = \"disc\"\nposition = [0, 0, 4]\ntarget = [0, 0, 9]\nradius = 2\nintensity = 7", 0.0);
    assert_eq!(disc.source, Source::Disc { centre: [0.0, 0.0, 4.0], normal: [0.0, 0.0, 1.0], radius: 2.0 });
    assert_eq!(disc.color, [1.75; 3]);

    let point = light("kind = \"point\"\nposition = [1, 2, 3]\nintensity = 3\nnearest = 0.25", 0.0);
    assert_eq!(point.source, Source::Point { position: [1.0, 2.0, 3.0], nearest: 0.25 });
    assert_near(&point.color, &[3.0 * PI; 3], 1e-15);
    let far = light("kind = \"directional\"\ndirection = [0, 0, 5]\nintensity = 0.5", 0.0);
    assert_eq!(far.source, Source::Directional { direction: [0.0, 0.0, 1.0] });
    assert_near(&far.color, &[0.5 * PI; 3], 1e-15);
}

#[test]
fn environments_are_projected_to_radiance_with_condon_shortley_phase() {
    let text = "kind = \"environment\"\nfile = \"sky.hdr\"\nforward = [1, 0, 0]\nup = [0, 0, 1]\nintensity = 2\ncolor = [1, 3, 1]";
    let light = light(text, 0.0);
    assert_eq!(light.color, [2.0, 6.0, 2.0]);
    let Source::Probe(probe) = light.source else { panic!("{:?}", light.source) };
    assert_eq!(probe.coefficients.len(), 121);
    let channel = |c: usize| probe.coefficients.iter().take(4).map(|values| values[c]).collect::<Vec<_>>();
    // Integrals over a half: of Y00 2 pi sqrt(1 / 4 pi), of sqrt(3 / 4 pi) x cosine pi sqrt(3 / 4 pi); Y11 = - .. x.
    let (constant, slope) = (PI.sqrt(), (0.75 * PI).sqrt());
    assert_near(&channel(0), &[constant, 0.0, 0.0, -slope], 1e-4);
    assert_near(&channel(1), &[constant, 0.0, slope, 0.0], 1e-4);
    assert_near(&channel(2), &[2.0 * constant, 0.0, 0.0, 0.0], 1e-4);
    assert!(probe.coefficients.iter().skip(1).all(|values| values[2].abs() < 1e-4));
}

#[test]
fn probes_are_taken_as_they_are() {
    let light =
        light("kind = \"probe\"\nsh = [[1, 2, 3], [-4, 5, 6], [7, 8, 9], [0.5, 0, 1]]\nintensity = 0.5", 0.0);
    let Source::Probe(probe) = light.source else { panic!("{:?}", light.source) };
    assert_eq!(probe.coefficients, [[1.0, 2.0, 3.0], [-4.0, 5.0, 6.0], [7.0, 8.0, 9.0], [0.5, 0.0, 1.0]]);
    assert_eq!(light.color, [0.5; 3]);
}

const KEYED: &str = "kind = \"disc\"\ntarget = [0, 0, 0]\nradiance = 1\nkeys = [\
    { time = 0, position = [0, 0, 2], radius = 1, color = [1, 1, 1] }, \
    { time = 4, position = [4, 0, 2], radius = 3, radiance = 5, color = [0, 1, 3] }]";

#[test]
fn sizes_and_places_change_between_keys() {
    let at = light(KEYED, 2.0);
    let half = 0.5f64.sqrt();
    let Source::Disc { centre, normal, radius } = at.source else { panic!("{:?}", at.source) };
    assert_eq!((centre, radius), ([2.0, 0.0, 2.0], 2.0));
    assert_near(&normal, &[-half, 0.0, -half], 1e-15);
    // The only key with a radiance holds everywhere.
    assert_eq!(at.color, [2.5, 5.0, 10.0]);

    let sphere = "kind = \"sphere\"\nposition = [0, 0, 2]\nradiance = 3\n\
                  keys = [{ time = 0, radius = 1 }, { time = 1, radius = 2 }]";
    assert_eq!(light(sphere, 0.5).color, [3.0; 3]);
    // For pictures: radiance x radius^2.
    let file = scene_file(&format!("[[light]]\n{sphere}")).unwrap();
    let picture = file.scene(Path::new("scene.toml"), 0.5).unwrap();
    assert_eq!(picture.lights[0].intensity, 3.0 * 1.5 * 1.5);
    assert!(matches!(picture.lights[0].lamp, Lamp::Sphere { radius: 1.5, .. }));
}

const WALK: &str = "[object]\nposition = [10, 0, 0]\nrotation_deg = [0, 0, 90]\n\
    [[part]]\nname = \"leg\"\npivot = [0, 0, 1]\nkeys = [\
    { time = 0, rotation_deg = [0, 0, 0] }, { time = 1, rotation_deg = [0, 180, 0] }]\n\
    [[part]]\nname = \"hat\"\nposition = [0, 0, 5]\nrotation_deg = [90, 90, 0]\n";

#[test]
fn parts_move_by_their_own_motion_and_then_by_the_objects() {
    let scene = rig_scene(WALK, 0.5);
    // x goes to y, y to -x, then 10 along x.
    assert_near(&scene.object.point([1.0, 2.0, 3.0]), &[8.0, 1.0, 3.0], 1e-14);
    let names: Vec<_> = scene.parts.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["leg", "hat"]);
    let leg = &scene.parts[0].1;
    // A quarter turn about y through (0, 0, 1) takes z to x: the foot, 1 below, swings to -x; then the object's motion.
    assert_near(&leg.point([0.0, 0.0, 0.0]), &[10.0, -1.0, 1.0], 1e-14);
    assert_near(&leg.point([0.0, 0.0, 1.0]), &[10.0, 0.0, 1.0], 1e-14);
    // About x and then about the fixed y: y goes to z and on to x, z goes to -y and stays; 5 up; the object's motion.
    let hat = &scene.parts[1].1;
    assert_near(&hat.direction([0.0, 1.0, 0.0]), &[0.0, 1.0, 0.0], 1e-14);
    assert_near(&hat.direction([0.0, 0.0, 1.0]), &[1.0, 0.0, 0.0], 1e-14);
    assert_near(&hat.point([0.0, 0.0, 0.0]), &[10.0, 0.0, 5.0], 1e-14);
    for Placement { rotation: r, .. } in [scene.object, *leg, *hat] {
        let across = cross(r[0], r[1]);
        assert_near(&across, &r[2], 1e-14);
    }
    let still = rig_scene("[[light]]\nkind = \"directional\"\ndirection = [0, 0, 1]\n", 0.0);
    assert_eq!((still.object, still.parts), (Placement::IDENTITY, Vec::new()));
}

#[test]
fn what_does_not_belong_is_refused_in_a_sentence() {
    let path = Path::new("scene.toml");
    let read = |text: &str, words: &str| {
        let message = scene_file(text).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("line "), "{message} lacks '{words}'");
    };
    let rig = |text: &str, words: &str| {
        let file = scene_file(&format!("[[light]]\nname = \"a\"\n{text}")).unwrap();
        let message = file.rig_scene(path, 0.0).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("scene.toml"), "{message} lacks '{words}'");
    };
    rig("kind = \"spot\"\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\ncone_deg = 30", "'a' is a spot");
    for attenuation in ["none", "inverse"] {
        let text = format!("kind = \"point\"\nposition = [0, 0, 1]\nattenuation = \"{attenuation}\"");
        rig(&text, "inverse square");
    }
    rig("kind = \"sphere\"\nposition = [0, 0, 1]\nradius = 1e-200", "too small");
    let picture = |text: &str, words: &str| {
        let file = scene_file(text).unwrap();
        let message = file.scene(path, 0.0).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("only rigs know"), "{message} lacks '{words}'");
    };
    let disc = "[[light]]\nkind = \"disc\"\nposition = [0, 0, 1]\n";
    picture(&format!("{disc}target = [0, 0, 0]\nradius = 1"), "is a disc");
    picture("[[light]]\nkind = \"probe\"\nsh = [[1, 1, 1]]", "is a probe");
    picture(WALK, "[object]");
    read(&format!("{disc}radius = 1"), "either a target or the direction");
    read(&format!("{disc}target = [0, 0, 1]\nradius = 1"), "stands at its target");
    read(&format!("{disc}direction = [0, 0, 0]\nradius = 1"), "has no direction");
    read(&format!("{disc}direction = [0, 0, 1]"), "no radius");
    read(&format!("{disc}direction = [0, 0, 1]\nradius = -1"), "its radius is -1");
    read(&format!("{disc}direction = [0, 0, 1]\nradius = 1\nnearest = 1"), "has nearest");
    read(
        &format!("{disc}direction = [0, 0, 1]\nradius = 1\nradiance = 1\nintensity = 1"),
        "both intensity and radiance",
    );
    read(
        "[[light]]\nkind = \"point\"\nposition = [0, 0, 1]\nkeys = [{ time = 0, radius = 1 }]",
        "has radius",
    );
    read("[[light]]\nkind = \"point\"\nposition = [0, 0, 1]\nradiance = 1", "has radiance");
    read("[[light]]\nkind = \"probe\"", "sh of 0 coefficients");
    read("[[light]]\nkind = \"probe\"\nsh = [[1, 1, 1], [1, 1, 1]]", "1, 4, 9 .. 121");
    read("[[light]]\nkind = \"probe\"\nsh = [[1, nan, 1]]", "NaN in sh");
    read("[object]\nname = \"car\"", "[object] has a name");
    read("[[part]]\nposition = [0, 0, 0]", "has no name");
    read("[[part]]\nname = \"a\"\n[[part]]\nname = \"a\"", "a second [[part]] 'a'");
    read("[object]\nkeys = [{ time = inf }]", "key at time inf");
    read("[object]\nkeys = [{ time = 0, pivot = [0, 1e10, 0] }]", "10000000000");
    read("[object]\nscale = 2", "scale");
}

fn testdata(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/rigs").join(name)
}

/// Bounds along each axis.
fn bounds<'a>(meshes: impl Iterator<Item = &'a Mesh> + Clone) -> [[f32; 2]; 3] {
    let values =
        |axis: usize| meshes.clone().flat_map(move |mesh| mesh.positions.iter().map(move |p| p[axis]));
    [0, 1, 2].map(|axis| [values(axis).fold(f32::MAX, f32::min), values(axis).fold(f32::MIN, f32::max)])
}

/// Volume by the signed tetrahedra of its triangles; normals must agree with how triangles are wound.
fn volume(mesh: &Mesh) -> f64 {
    let corner = |vertex: u32| wide(mesh.positions[vertex as usize]);
    let mut volume = 0.0;
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(corner);
        volume += dot(a, cross(b, c)) / 6.0;
        let out = cross(difference(b, a), difference(c, a));
        let normals = corners.map(|vertex| wide(mesh.normals[vertex as usize]));
        assert!(normals.iter().all(|normal| dot(*normal, out) > 0.0), "{corners:?}");
    }
    volume
}

#[test]
fn the_car_and_the_figure_are_what_they_are_said_to_be() {
    let car = read_mesh_parts(&testdata("car.glb"), 1 << 26).unwrap();
    let [(name, car)] = &car[..] else { panic!("one part") };
    assert_eq!(name, "car");
    assert_eq!(bounds([car].into_iter()), [[-2.0, 2.0], [-0.8, 0.8], [0.0, 1.4]]);
    assert!((5000..=8000).contains(&car.triangles.len()));
    assert!((3.0..6.0).contains(&volume(car)), "{}", volume(car));

    let figure = read_mesh_parts(&testdata("figure.glb"), 1 << 26).unwrap();
    let names: Vec<_> = figure.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["torso", "head", "arm_left", "arm_right", "leg_left", "leg_right"]);
    let meshes = || figure.iter().map(|(_, mesh)| mesh);
    let [_, _, [low, high]] = bounds(meshes());
    assert!(low.abs() < 1e-6 && (high - 1.8).abs() < 1e-6, "{low} to {high}");
    assert!((3000..=6000).contains(&meshes().map(|mesh| mesh.triangles.len()).sum::<usize>()));
    assert!(meshes().all(|mesh| volume(mesh) > 0.0));
    // Left is where y is, for someone who looks along x.
    assert!(bounds(meshes().skip(2).take(1))[1][0] > 0.0);
}

#[test]
fn the_room_is_the_papers() {
    let path = testdata("room.toml");
    let file = read_scene(&path, CpuLevel::BASELINE, 1 << 24).unwrap();
    assert_eq!(file.times.len(), 24);
    let at = |time: f64| file.rig_scene(&path, time).unwrap();
    let scene = at(0.0);
    let radius_of = |light: &Light| match light.source {
        Source::Sphere { radius, .. } => radius,
        _ => 0.0,
    };
    let ceiling: Vec<&Light> = scene.lights.iter().filter(|light| radius_of(light) > 0.1).collect();
    let small = scene.lights.iter().filter(|light| (0.001..0.1).contains(&radius_of(light))).count();
    let discs = || scene.lights.iter().filter(|light| matches!(light.source, Source::Disc { .. }));
    assert_eq!((ceiling.len(), small, discs().count()), (4, 8, 192));
    // Every disc shines as its wall reflects: what all walls of one colour give is that colour times the same light.
    let mut area = 0.0;
    for disc in discs() {
        let Source::Disc { centre, normal, radius } = disc.source else { continue };
        area += std::f64::consts::PI * radius * radius;
        let light = ceiling.iter().fold([0.0; 3], |sum, lamp| {
            let Source::Sphere { centre: lamp_centre, radius } = lamp.source else { return sum };
            let toward = difference(lamp_centre, centre);
            let square = dot(toward, toward);
            let share = radius * radius * dot(toward, normal) / (square * square.sqrt());
            [0, 1, 2].map(|i| sum[i] + lamp.color[i] * share)
        });
        let albedo = [0, 1, 2].map(|i| disc.color[i] / light[i]);
        let expected = match (centre[1], centre[2]) {
            (_, 0.0) => [0.45, 0.36, 0.28],
            (3.0, _) => [0.63, 0.06, 0.05],
            (-3.0, _) => [0.14, 0.45, 0.09],
            _ => [0.73; 3],
        };
        for (a, b) in albedo.iter().zip(expected) {
            assert!((a - b).abs() < 0.01 * b + 0.002, "{albedo:?} at {centre:?}");
        }
    }
    // Floor and four walls.
    assert!((area - (48.0 + 2.0 * 24.0 + 2.0 * 18.0)).abs() < 0.1, "{area}");
    let names: Vec<_> = scene.parts.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["arm_left", "arm_right", "leg_left", "leg_right"]);
    assert_ne!(at(0.25).parts[0].1.rotation, scene.parts[0].1.rotation);
    assert_ne!(at(1.0).object, scene.object);
}

#[test]
fn the_light_flies_straight_past_the_car() {
    let path = testdata("flyby.toml");
    let file = read_scene(&path, CpuLevel::BASELINE, 1 << 24).unwrap();
    let mesh = read_mesh(&testdata("car.glb"), 1 << 26).unwrap();
    let middle = [0.0, 0.0, 0.7];
    let from_middle = |place: [f64; 3]| length(difference(place, middle));
    let radius = mesh.positions.iter().map(|p| from_middle(wide(*p))).fold(0.0, f64::max);
    let places: Vec<[f64; 3]> = file
        .times
        .iter()
        .map(|&time| match file.rig_scene(&path, time).unwrap().lights[0].source {
            Source::Sphere { centre, .. } => centre,
            _ => panic!("a sphere"),
        })
        .collect();
    assert_eq!(places.len(), 48);
    let along = difference(places[47], places[0]);
    let off_line = |place: &[f64; 3]| length(cross(difference(*place, places[0]), along)) / length(along);
    assert!(places.iter().map(off_line).fold(0.0, f64::max) < 0.001 * radius);
    let distances: Vec<f64> = places.iter().map(|place| from_middle(*place) / radius).collect();
    assert_near(&[distances[0], distances[47]], &[40.0, 40.0], 1e-3);
    assert_near(&[off_line(&middle) / radius], &[1.5], 1e-3);
    assert!(distances.iter().all(|&distance| distance > 1.5));
    let small = testdata("small.toml");
    let lights =
        read_scene(&small, CpuLevel::BASELINE, 1 << 24).unwrap().rig_scene(&small, 0.0).unwrap().lights;
    assert_eq!(lights.len(), 3);
}
