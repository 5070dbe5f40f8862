//! Scene files as rigs know them: lights in physical units, motions of objects and parts.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

use relight_core::CpuLevel;
use relight_formats::{FormatError, RigScene, SceneFile, read_scene};
use relight_lights::Lamp;
use relight_rig::{Light, Placement, Source};
use std::f64::consts::PI;
use std::fs;
use std::path::Path;

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
        let across = relight_core::vectors::cross(r[0], r[1]);
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
