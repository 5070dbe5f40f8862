//! Scene files as their text has them, before anything is believed.

use serde::Deserialize;
use std::path::PathBuf;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneRecord {
    #[serde(default)]
    pub(super) light: Vec<Spanned<LightRecord>>,
    #[serde(default)]
    pub(super) horizon: HorizonName,
    #[serde(default)]
    pub(super) drop_off_sine: Option<Spanned<f64>>,
    pub(super) sequence: Option<Spanned<SequenceRecord>>,
    pub(super) object: Option<Spanned<MotionRecord>>,
    #[serde(default)]
    pub(super) part: Vec<Spanned<MotionRecord>>,
}

#[derive(Deserialize, Default, Clone, Copy, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub(super) enum HorizonName {
    #[default]
    Fade,
    DropOff,
    Extrapolate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SequenceRecord {
    pub(super) frames: usize,
    #[serde(default)]
    pub(super) from: f64,
    #[serde(default = "one")]
    pub(super) to: f64,
}

#[derive(Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "lowercase")]
pub(super) enum Kind {
    Directional,
    Point,
    Spot,
    Sphere,
    Environment,
    Disc,
    Probe,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
pub(super) enum AttenuationName {
    None,
    Inverse,
    InverseSquare,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightRecord {
    pub(super) kind: Kind,
    pub(super) name: Option<String>,
    #[serde(default = "yes")]
    pub(super) on: bool,
    pub(super) color: Option<[f64; 3]>,
    pub(super) intensity: Option<f64>,
    pub(super) radiance: Option<f64>,
    pub(super) direction: Option<[f64; 3]>,
    pub(super) angles_deg: Option<[f64; 2]>,
    pub(super) position: Option<[f64; 3]>,
    pub(super) target: Option<[f64; 3]>,
    pub(super) cone_deg: Option<f64>,
    pub(super) beam_deg: Option<f64>,
    pub(super) radius: Option<f64>,
    pub(super) samples: Option<usize>,
    pub(super) attenuation: Option<AttenuationName>,
    pub(super) a0: Option<f64>,
    pub(super) nearest: Option<f64>,
    pub(super) gobo: Option<PathBuf>,
    pub(super) gobo_up: Option<[f64; 3]>,
    pub(super) gobo_on: Option<bool>,
    pub(super) file: Option<PathBuf>,
    pub(super) forward: Option<[f64; 3]>,
    pub(super) up: Option<[f64; 3]>,
    pub(super) sh: Option<Vec<[f64; 3]>>,
    #[serde(default)]
    pub(super) keys: Vec<Key>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Key {
    pub(super) time: f64,
    pub(super) direction: Option<[f64; 3]>,
    pub(super) position: Option<[f64; 3]>,
    pub(super) target: Option<[f64; 3]>,
    pub(super) radius: Option<f64>,
    pub(super) intensity: Option<f64>,
    pub(super) radiance: Option<f64>,
    pub(super) color: Option<[f64; 3]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MotionRecord {
    pub(super) name: Option<String>,
    pub(super) position: Option<[f64; 3]>,
    pub(super) rotation_deg: Option<[f64; 3]>,
    pub(super) pivot: Option<[f64; 3]>,
    #[serde(default)]
    pub(super) keys: Vec<MotionKey>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MotionKey {
    pub(super) time: f64,
    pub(super) position: Option<[f64; 3]>,
    pub(super) rotation_deg: Option<[f64; 3]>,
    pub(super) pivot: Option<[f64; 3]>,
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

impl LightRecord {
    /// Whether it has fields of other kinds only, which would do nothing.
    pub(super) fn check_fields(&self, name: &str) -> Result<(), String> {
        use Kind::{Directional, Disc, Environment, Point, Probe, Sphere, Spot};
        let local: &[Kind] = &[Point, Spot, Sphere];
        let keyed = |field: fn(&Key) -> Option<f64>| self.keys.iter().any(|key| field(key).is_some());
        let radius = self.radius.is_some() || keyed(|key| key.radius);
        let fields: [(&str, bool, &[Kind]); 19] = [
            ("direction", self.direction.is_some(), &[Directional, Spot, Disc]),
            ("angles_deg", self.angles_deg.is_some(), &[Directional]),
            ("position", self.position.is_some(), &[Point, Spot, Sphere, Disc]),
            ("target", self.target.is_some(), &[Spot, Disc]),
            ("cone_deg", self.cone_deg.is_some(), &[Spot]),
            ("beam_deg", self.beam_deg.is_some(), &[Spot]),
            ("gobo", self.gobo.is_some(), &[Spot]),
            ("gobo_up", self.gobo_up.is_some(), &[Spot]),
            ("gobo_on", self.gobo_on.is_some(), &[Spot]),
            ("radius", radius, &[Sphere, Disc]),
            ("radiance", self.has_radiance(), &[Sphere, Disc]),
            ("samples", self.samples.is_some(), &[Sphere]),
            ("attenuation", self.attenuation.is_some(), local),
            ("a0", self.a0.is_some(), local),
            ("nearest", self.nearest.is_some(), local),
            ("file", self.file.is_some(), &[Environment]),
            ("forward", self.forward.is_some(), &[Environment]),
            ("up", self.up.is_some(), &[Environment]),
            ("sh", self.sh.is_some(), &[Probe]),
        ];
        for (field, given, kinds) in fields {
            if given && !kinds.contains(&self.kind) {
                return Err(format!("light '{name}' has {field}, which its kind does not; leave it out"));
            }
        }
        if self.has_radiance() && (self.intensity.is_some() || keyed(|key| key.intensity)) {
            return Err(format!("light '{name}' has both intensity and radiance; leave one out"));
        }
        let attenuation = |wanted: &str| format!("attenuation = \"{wanted}\"");
        match self.attenuation {
            Some(AttenuationName::Inverse) => {}
            _ if self.a0.is_some() => {
                return Err(format!("light '{name}' has a0, which belongs to {}", attenuation("inverse")));
            }
            _ => {}
        }
        match self.attenuation {
            Some(AttenuationName::InverseSquare) | None => Ok(()),
            _ if self.nearest.is_some() => {
                Err(format!("light '{name}' has nearest, which belongs to {}", attenuation("inverse-square")))
            }
            _ => Ok(()),
        }
    }

    fn has_radiance(&self) -> bool {
        self.radiance.is_some() || self.keys.iter().any(|key| key.radiance.is_some())
    }

    /// The value of a field, or else the first that its keys have.
    pub(super) fn first<T>(&self, value: Option<T>, field: fn(&Key) -> Option<T>) -> Option<T> {
        value.or_else(|| self.keys.iter().find_map(field))
    }
}
