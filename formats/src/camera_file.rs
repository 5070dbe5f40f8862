//! Camera files: JSON or TOML with the same fields, which docs/formats.md describes.

use crate::machine::line_of;
use crate::{FormatError, read_text};
use relight_core::{Camera, Projection};
use serde::Deserialize;
use std::path::Path;

/// How far the components of unit vectors that say the same thing may be apart.
const AGREEMENT: f64 = 1e-4;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
enum Kind {
    #[serde(rename = "perspective", alias = "persp")]
    Perspective,
    #[serde(rename = "orthographic", alias = "ortho")]
    Orthographic,
    #[serde(rename = "equirectangular", alias = "pano")]
    Equirectangular,
}

/// Which way V goes, the vector along the middle of the view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Sense {
    /// As a ray: P = E + d V.
    #[default]
    EyeToScene,
    /// As in the papers: P = E - d V.
    SceneToEye,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraRecord {
    kind: Kind,
    width: usize,
    height: usize,
    eye: [f64; 3],
    target: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    forward: Option<[f64; 3]>,
    right: Option<[f64; 3]>,
    up_true: Option<[f64; 3]>,
    #[serde(default)]
    v: Sense,
    fov_x_deg: Option<f64>,
    width_units: Option<f64>,
    lat_max_deg: Option<f64>,
}

/// Reads a camera from a JSON or TOML file, told apart by the brace with which JSON begins.
///
/// `forward` is read as `v` says, `"eye_to_scene"` or `"scene_to_eye"`: the same camera either way.
/// # Errors
/// [`FormatError::Invalid`] for text that is neither, with its line; for fields that are unknown, missing
/// or of another kind of camera; for vectors that contradict each other or span no view.
/// [`FormatError::Io`].
pub fn read_camera_file(path: &Path) -> Result<Camera, FormatError> {
    let text = read_text(path)?;
    let record = if text.trim_start().starts_with('{') { from_json(&text) } else { from_toml(&text) };
    record.and_then(|record| camera_of(&record)).map_err(|problem| FormatError::invalid(path, problem))
}

fn from_json(text: &str) -> Result<CameraRecord, String> {
    serde_json::from_str(text).map_err(|error| format!("is no camera: {error}"))
}

fn from_toml(text: &str) -> Result<CameraRecord, String> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| line_of(text, span.start));
        format!("is no camera: {} at line {line}", error.message().replace('\n', " "))
    })
}

fn camera_of(record: &CameraRecord) -> Result<Camera, String> {
    let CameraRecord { kind, width, height, eye, .. } = *record;
    let projection = projection_of(record)?;
    let sign = if record.v == Sense::SceneToEye { -1.0 } else { 1.0 };
    let given = record.forward.map(|v| v.map(|c| sign * c));
    let panorama = kind == Kind::Equirectangular;
    // A panorama that says nothing is the one of a world whose z is up, seen along y.
    let forward = match (record.target, given) {
        (Some(target), _) => [0, 1, 2].map(|i| target[i] - eye[i]),
        (None, Some(forward)) => forward,
        (None, None) if panorama => [0.0, 1.0, 0.0],
        (None, None) => return Err("says not where it looks; give target or forward".to_owned()),
    };
    let up = match record.up.or(record.up_true) {
        Some(up) => up,
        None if panorama => [0.0, 0.0, 1.0],
        None => return Err("says not which way is up; give up or up_true".to_owned()),
    };
    let camera =
        Camera::along(projection, (width, height), eye, forward, up).map_err(|error| error.to_string())?;
    let pairs = [
        ("forward", given, camera.forward),
        ("right", record.right, camera.right),
        ("up_true", record.up_true, camera.up),
    ];
    for (name, given, found) in pairs {
        let Some(given) = given else { continue };
        let length = given.iter().map(|c| c * c).sum::<f64>().sqrt();
        // What is not finite agrees with nothing.
        if !(0..3).all(|i| (given[i] / length - found[i]).abs() <= AGREEMENT) {
            return Err(disagreement(name, record.v, given, found));
        }
    }
    Ok(camera)
}

fn disagreement(name: &str, v: Sense, given: [f64; 3], found: [f64; 3]) -> String {
    let remedy = match (name, v) {
        ("forward", Sense::EyeToScene) => {
            "or write v = \"scene_to_eye\" if it points from the scene to the eye"
        }
        ("forward", Sense::SceneToEye) => {
            "or write v = \"eye_to_scene\" if it points from the eye into the scene"
        }
        _ => "cameras are right-handed, right = forward x up",
    };
    format!("{name} is {given:?} where the other fields give {found:?}; leave one of them away, {remedy}")
}

fn projection_of(record: &CameraRecord) -> Result<Projection, String> {
    match (record.kind, record.fov_x_deg, record.width_units, record.lat_max_deg) {
        (Kind::Perspective, Some(fov), None, None) => Ok(Projection::Perspective { fov_x: fov.to_radians() }),
        (Kind::Orthographic, None, Some(width), None) => Ok(Projection::Orthographic { width }),
        (Kind::Equirectangular, None, None, latitude) => {
            Ok(Projection::Equirectangular { latitude: latitude.unwrap_or(90.0).to_radians() })
        }
        (kind, ..) => {
            let (name, takes) = match kind {
                Kind::Perspective => ("perspective", "fov_x_deg, the angle between left and right edge,"),
                Kind::Orthographic => ("orthographic", "width_units, the picture's width in the world,"),
                Kind::Equirectangular => ("equirectangular", "lat_max_deg, the latitude of the upper edge,"),
            };
            Err(format!("kind {name} takes {takes} and no other of fov_x_deg, width_units and lat_max_deg"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COURT: &str = r#"{ "kind": "persp", "width": 160, "height": 120, "eye": [0.4, -3.2, 4.4],
        "target": [0, 2.2, 0.4], "up": [0, 0, 1], "fov_x_deg": 60.0,
        "forward": [-0.05941759110223066, 0.802137479880114, -0.5941759110223066],
        "right": [0.997267754456709, 0.07387168551531177, -0.0],
        "up_true": [-0.0438927760398137, 0.592552476537485, 0.8043351209295861] }"#;

    fn camera(text: &str) -> Result<Camera, String> {
        let record = if text.starts_with('{') { from_json(text) } else { from_toml(text) };
        record.and_then(|record| camera_of(&record))
    }

    #[test]
    fn json_and_toml_say_the_same_with_and_without_what_follows_from_the_rest() {
        let court = camera(COURT).unwrap();
        let projection = Projection::Perspective { fov_x: 60f64.to_radians() };
        let expected =
            Camera::new(projection, (160, 120), [0.4, -3.2, 4.4], [0.0, 2.2, 0.4], [0.0, 0.0, 1.0]);
        assert_eq!(Ok(court), expected.map_err(|e| e.to_string()));
        let toml = "kind = 'perspective'\nwidth = 160\nheight = 120\nfov_x_deg = 60\neye = [0.4, -3.2, 4.4]\n\
            target = [0, 2.2, 0.4]\nup = [0, 0, 1]\n";
        assert_eq!(camera(toml).unwrap(), court);
    }

    #[test]
    fn forward_in_either_sense_is_the_same_camera() {
        let of = |v: &str, forward: &str| {
            camera(&format!(
                "kind = 'ortho'\nwidth = 3\nheight = 2\nwidth_units = 5\neye = [1, 2, 3]\nup_true = [0, 0.6, 0.8]\n\
                 forward = {forward}\n{v}"
            ))
        };
        let ray = of("", "[0, 4, -3]").unwrap();
        assert_eq!((ray.forward, ray.right), ([0.0, 0.8, -0.6], [1.0, 0.0, 0.0]));
        assert_eq!(of("v = 'eye_to_scene'", "[0, 8, -6]").unwrap(), ray);
        assert_eq!(of("v = 'scene_to_eye'", "[0, -12, 9]").unwrap(), ray);
    }

    #[test]
    fn a_panorama_without_axes_has_y_in_the_middle_and_z_up() {
        let pano = "{\"kind\": \"pano\", \"width\": 256, \"height\": 64, \"eye\": [0.2, 2.3, 1.35], \
            \"lat_max_deg\": 45.0}";
        let camera = camera(pano).unwrap();
        assert_eq!(camera.projection, Projection::Equirectangular { latitude: 45f64.to_radians() });
        let axes = (camera.right, camera.forward, camera.up);
        assert_eq!(axes, ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]));
    }

    #[test]
    fn contradictions_and_gaps_are_named() {
        let with = |what: &str, by: &str| {
            let text = COURT.replacen(what, by, 1);
            assert_ne!(text, COURT, "{what}");
            camera(&text).unwrap_err()
        };
        for (what, by, words) in [
            ("[-0.05941759110223066, 0.802", "[-0.05941759110223066, 0.812", "forward is [-0.05"),
            (
                "[-0.05941759110223066, 0.802137479880114, -0.5",
                "[0.05941759110223066, -0.802137479880114, 0.5",
                "scene_to_eye",
            ),
            ("\"right\": [0.99", "\"right\": [-0.99", "right-handed"),
            ("0.592552476537485", "-0.592552476537485", "up_true is"),
            ("\"fov_x_deg\": 60.0,", "", "perspective takes fov_x_deg"),
            ("\"fov_x_deg\"", "\"width_units\"", "perspective takes fov_x_deg"),
            ("\"fov_x_deg\"", "\"fov_x\"", "unknown field `fov_x`, expected one of"),
            ("60.0", "180", "the horizontal field of view is 180"),
            ("\"persp\"", "\"fish\"", "unknown variant `fish`"),
            ("160,", "0,", "the width in pixels is 0"),
            ("160,", "-1,", "at line 1"),
            ("[0, 0, 1], \"fov", "[0, 0], \"fov", "at line 2"),
            ("[0, 0, 1]", "[-0.4, 5.4, -4]", "must not point along the view"),
            ("[0, 2.2, 0.4]", "[0.4, -3.2, 4.4]", "eye and target must differ"),
            (" }", "", "EOF"),
        ] {
            let error = with(what, by);
            assert!(error.contains(words), "{what} -> {by}: {error}");
        }
        let short = "kind = 'persp'\nwidth = 3\nheight = 2\nfov_x_deg = 50\neye = [1, 2, nan]\n";
        assert!(camera(short).unwrap_err().contains("give target or forward"));
        assert!(camera(&format!("{short}target = [0, 0, 0]")).unwrap_err().contains("give up or up_true"));
        let nan = camera(&format!("{short}target = [0, 0, 0]\nup = [0, 0, 1]")).unwrap_err();
        assert!(nan.contains("a coordinate is NaN; the camera needs finite numbers"), "{nan}");
        let forward = camera(&format!(
            "{}target = [0, 0, 0]\nup = [0, 0, 1]\nforward = [0, 0, 0]",
            short.replace("nan", "3")
        ));
        assert!(forward.unwrap_err().contains("forward is [0.0, 0.0, 0.0]"));
        let toml = camera("kind = 'persp'\nwidth = 3\nheight == 2").unwrap_err();
        assert!(toml.contains("at line 3"), "{toml}");
    }
}
