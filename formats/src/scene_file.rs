//! Scene files: lights in TOML. docs/formats.md has the fields.

use crate::machine::line_of;
use crate::{FormatError, Samples, decode, read_text};
use relight_core::relighter::Picture;
use relight_core::{CpuLevel, Direction, linear_from_srgb};
use relight_lights::{Attenuation, Environment, Gobo, HorizonRule, Lamp, Light, Scene, Spot, between_keys};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Most pictures of a sequence.
const MOST_FRAMES: usize = 100_000;

/// A scene as its file has it.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// Pictures that it names: environments and gobos.
    pub inputs: Vec<PathBuf>,
    /// Times of the sequence's pictures; empty where the scene stands still.
    pub times: Vec<f64>,
    horizon: HorizonRule,
    lights: Vec<KeyedLight>,
}

#[derive(Clone, Debug)]
struct KeyedLight {
    light: Light,
    keys: Vec<Key>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneRecord {
    #[serde(default)]
    light: Vec<Spanned<LightRecord>>,
    #[serde(default)]
    horizon: HorizonName,
    #[serde(default)]
    drop_off_sine: Option<Spanned<f64>>,
    sequence: Option<Spanned<SequenceRecord>>,
}

#[derive(Deserialize, Default, Clone, Copy, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum HorizonName {
    #[default]
    Fade,
    DropOff,
    Extrapolate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SequenceRecord {
    frames: usize,
    #[serde(default)]
    from: f64,
    #[serde(default = "one")]
    to: f64,
}

#[derive(Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Directional,
    Point,
    Spot,
    Sphere,
    Environment,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
enum AttenuationName {
    None,
    Inverse,
    InverseSquare,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LightRecord {
    kind: Kind,
    name: Option<String>,
    #[serde(default = "yes")]
    on: bool,
    color: Option<[f32; 3]>,
    intensity: Option<f64>,
    direction: Option<[f64; 3]>,
    angles_deg: Option<[f64; 2]>,
    position: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    cone_deg: Option<f64>,
    beam_deg: Option<f64>,
    radius: Option<f64>,
    samples: Option<usize>,
    attenuation: Option<AttenuationName>,
    a0: Option<f64>,
    nearest: Option<f64>,
    gobo: Option<PathBuf>,
    gobo_up: Option<[f64; 3]>,
    gobo_on: Option<bool>,
    file: Option<PathBuf>,
    forward: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    #[serde(default)]
    keys: Vec<Key>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Key {
    time: f64,
    direction: Option<[f64; 3]>,
    position: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    intensity: Option<f64>,
    color: Option<[f64; 3]>,
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

/// Reads a scene and the pictures that it names, which lie relative to its folder. Lights that are not `on`
/// are left out.
///
/// # Errors
/// [`FormatError`] for files that can't be read, with the line for fields that are unknown, missing, of
/// another kind of light or out of range.
pub fn read_scene(path: &Path, level: CpuLevel, memory_limit: u64) -> Result<SceneFile, FormatError> {
    let text = read_text(path)?;
    let record: SceneRecord = toml::from_str(&text).map_err(|error| {
        let line =
            error.span().map_or(String::new(), |span| format!("line {}: ", line_of(&text, span.start)));
        let message = error.message().replace('\n', "; ");
        FormatError::invalid(path, format!("{line}{message}"))
    })?;
    let reader = Reader { path, text: &text, level, memory_limit };
    let mut inputs = Vec::new();
    let mut lights = Vec::new();
    for (index, spanned) in record.light.into_iter().enumerate() {
        let at = spanned.span().start;
        let record = spanned.into_inner();
        if record.on {
            lights.push(reader.light(index, record, &mut inputs).map_err(|problem| match problem {
                Problem::Here(words) => reader.invalid(at, words),
                Problem::File(error) => error,
            })?);
        }
    }
    let horizon = match (record.horizon, &record.drop_off_sine) {
        (HorizonName::DropOff, width) => {
            let value = width.as_ref().map_or(0.2, |width| *width.get_ref());
            if !(value > 0.0 && value <= 1.0) {
                let at = width.as_ref().map_or(0, |width| width.span().start);
                return Err(
                    reader.invalid(at, format!("drop_off_sine is {value}; give a sine above 0, up to 1"))
                );
            }
            HorizonRule::DropOff { width: value }
        }
        (_, Some(width)) => {
            let words = "drop_off_sine belongs to horizon = \"drop-off\"".to_owned();
            return Err(reader.invalid(width.span().start, words));
        }
        (HorizonName::Fade, None) => HorizonRule::Fade,
        (HorizonName::Extrapolate, None) => HorizonRule::Extrapolate,
    };
    let times = match record.sequence {
        None => Vec::new(),
        Some(sequence) => {
            let at = sequence.span().start;
            let SequenceRecord { frames, from, to } = sequence.into_inner();
            if !(1..=MOST_FRAMES).contains(&frames) {
                return Err(
                    reader.invalid(at, format!("a sequence of {frames} frames; give 1 to {MOST_FRAMES}"))
                );
            }
            if !(from.is_finite() && to.is_finite()) {
                return Err(reader.invalid(at, "the sequence's from and to must be finite times".to_owned()));
            }
            let step = if frames == 1 { 0.0 } else { (to - from) / (frames - 1) as f64 };
            (0..frames).map(|frame| from + step * frame as f64).collect()
        }
    };
    Ok(SceneFile { inputs, times, horizon, lights })
}

impl SceneFile {
    /// The scene at `time`: keyed values lie between their neighbours in time, linearly.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] where a key's direction passes through nothing; `path` is for the message.
    pub fn scene(&self, path: &Path, time: f64) -> Result<Scene, FormatError> {
        let lights = self.lights.iter().map(|keyed| keyed.at(time)).collect::<Result<Vec<_>, String>>();
        let lights = lights.map_err(|problem| FormatError::invalid(path, problem))?;
        for light in &lights {
            light.check().map_err(|error| FormatError::invalid(path, format!("at time {time}: {error}")))?;
        }
        Ok(Scene { lights, horizon: self.horizon })
    }

    /// Whether any light's direction differs from pixel to pixel.
    pub fn has_local_lights(&self) -> bool {
        self.lights.iter().any(|keyed| keyed.light.is_local())
    }
}

impl KeyedLight {
    fn at(&self, time: f64) -> Result<Light, String> {
        let mut light = self.light.clone();
        let value = |field: fn(&Key) -> Option<[f64; 3]>| {
            let keys: Vec<_> = self.keys.iter().filter_map(|key| Some((key.time, field(key)?))).collect();
            between_keys(&keys, time)
        };
        let toward = |v: [f64; 3]| {
            Direction::new(v[0], v[1], v[2])
                .map_err(|error| format!("light '{}' at time {time}: {error}", light.name))
        };
        let direction = value(|key| key.direction).map(toward).transpose()?;
        let moved = value(|key| key.position);
        let target = value(|key| key.target);
        match &mut light.lamp {
            Lamp::Directional { direction: d } => *d = direction.unwrap_or(*d),
            Lamp::Point { position } | Lamp::Sphere { position, .. } => {
                *position = moved.unwrap_or(*position)
            }
            Lamp::Spot(spot) => {
                spot.position = moved.unwrap_or(spot.position);
                if let Some(target) = target {
                    let [x, y, z] = [0, 1, 2].map(|i| target[i] - spot.position[i]);
                    spot.axis = Direction::new(x, y, z)
                        .map_err(|_| format!("light '{}' at time {time} stands at its target", light.name))?;
                }
            }
            Lamp::Environment(_) => {}
        }
        light.color = value(|key| key.color).map_or(light.color, |color| color.map(|c| c as f32));
        if let Some([intensity, ..]) = value(|key| key.intensity.map(|intensity| [intensity; 3])) {
            light.intensity = intensity;
        }
        Ok(light)
    }
}

enum Problem {
    /// Of the light itself.
    Here(String),
    /// Of a picture.
    File(FormatError),
}

impl From<String> for Problem {
    fn from(words: String) -> Self {
        Self::Here(words)
    }
}

struct Reader<'a> {
    path: &'a Path,
    text: &'a str,
    level: CpuLevel,
    memory_limit: u64,
}

impl Reader<'_> {
    fn invalid(&self, at: usize, words: String) -> FormatError {
        FormatError::invalid(self.path, format!("line {}: {words}", line_of(self.text, at)))
    }

    fn light(
        &self,
        index: usize,
        record: LightRecord,
        inputs: &mut Vec<PathBuf>,
    ) -> Result<KeyedLight, Problem> {
        let name = record.name.clone().unwrap_or_else(|| format!("light {}", index + 1));
        record.check_fields(&name)?;
        let needed = |value: Option<[f64; 3]>, field: &str| {
            value.ok_or_else(|| format!("light '{name}' has no {field}; give {field} = [x, y, z]"))
        };
        let first_key = |field: fn(&Key) -> Option<[f64; 3]>| record.keys.iter().find_map(field);
        let position = || needed(record.position.or(first_key(|key| key.position)), "position");
        let lamp = match record.kind {
            Kind::Directional => {
                let direction = match record.angles_deg {
                    Some([azimuth, elevation]) => {
                        Direction::from_azimuth_elevation(azimuth.to_radians(), elevation.to_radians())
                            .map_err(|error| format!("light '{name}': {error}"))?
                    }
                    None => {
                        let v = needed(record.direction.or(first_key(|key| key.direction)), "direction")?;
                        toward(v, &name)?
                    }
                };
                Lamp::Directional { direction }
            }
            Kind::Point => Lamp::Point { position: position()? },
            Kind::Sphere => Lamp::Sphere {
                position: position()?,
                radius: record
                    .radius
                    .ok_or_else(|| format!("light '{name}' has no radius; give one above 0"))?,
                samples: record.samples.unwrap_or(16),
            },
            Kind::Spot => {
                let position = position()?;
                let axis = match (record.direction, record.target.or(first_key(|key| key.target))) {
                    (Some(axis), None) => axis,
                    (None, Some(target)) => [0, 1, 2].map(|i| target[i] - position[i]),
                    _ => {
                        return Err(format!(
                            "light '{name}' needs either a target or a direction in which it shines"
                        )
                        .into());
                    }
                };
                let cone = record.cone_deg.ok_or_else(|| {
                    format!("light '{name}' has no cone_deg; give the angle from its axis at which it ends, 0 to 180")
                })?;
                let beam = record.beam_deg.unwrap_or(0.75 * cone);
                let gobo = match &record.gobo {
                    None => None,
                    Some(_) if cone >= 89.0 => {
                        return Err(
                            format!("light '{name}': cone_deg is {cone}; a gobo needs less than 89").into()
                        );
                    }
                    Some(file) => Some(Gobo {
                        picture: self.picture(file, inputs)?,
                        up: toward(record.gobo_up.unwrap_or([0.0, 1.0, 0.0]), &name)?,
                        on: record.gobo_on.unwrap_or(true),
                    }),
                };
                let [cone, beam] = [cone, beam].map(f64::to_radians);
                Lamp::Spot(Box::new(Spot { position, axis: toward(axis, &name)?, cone, beam, gobo }))
            }
            Kind::Environment => {
                let file = record.file.as_ref().ok_or_else(|| {
                    format!("light '{name}' has no file; give an equirectangular .hdr, .exr, .png or .jpg")
                })?;
                let forward = toward(record.forward.unwrap_or([0.0, 0.0, 1.0]), &name)?;
                let up = toward(record.up.unwrap_or([0.0, 1.0, 0.0]), &name)?;
                let environment = Environment::new(self.picture(file, inputs)?, forward, up)
                    .map_err(|error| format!("light '{name}': {error}"))?;
                Lamp::Environment(Box::new(environment))
            }
        };
        let local = !matches!(record.kind, Kind::Directional | Kind::Environment);
        let attenuation = match record.attenuation {
            _ if !local => Attenuation::None,
            Some(AttenuationName::None) => Attenuation::None,
            Some(AttenuationName::Inverse) => Attenuation::Inverse { a0: record.a0.unwrap_or(1.0) },
            Some(AttenuationName::InverseSquare) | None => {
                Attenuation::InverseSquare { nearest: record.nearest.unwrap_or(0.01) }
            }
        };
        let light = Light {
            name,
            lamp,
            color: record.color.unwrap_or([1.0; 3]),
            intensity: record.intensity.unwrap_or(1.0),
            attenuation,
        };
        light.check().map_err(|error| error.to_string())?;
        let mut keys = record.keys;
        if let Some(key) = keys.iter().find(|key| !key.time.is_finite()) {
            return Err(format!(
                "light '{}' has a key at time {}; times must be finite",
                light.name, key.time
            )
            .into());
        }
        keys.sort_by(|a, b| a.time.total_cmp(&b.time));
        Ok(KeyedLight { light, keys })
    }

    /// A picture beside the scene, in linear light.
    fn picture(&self, file: &Path, inputs: &mut Vec<PathBuf>) -> Result<Picture, Problem> {
        let path = self.path.parent().map_or_else(|| file.to_owned(), |folder| folder.join(file));
        let picture = linear_picture(&path, self.level, self.memory_limit).map_err(Problem::File)?;
        inputs.push(path);
        Ok(picture)
    }
}

/// Reads a picture in linear light: integers are decoded from sRGB, floats are taken as they are.
///
/// # Errors
/// As of [`decode`](crate::decode); [`FormatError::TooLarge`] counts the floats that it becomes.
pub fn linear_picture(path: &Path, level: CpuLevel, memory_limit: u64) -> Result<Picture, FormatError> {
    let info = crate::probe(path)?;
    let floats = 4 * info.width as u64 * info.height as u64 * info.channels as u64;
    if floats > memory_limit {
        return Err(FormatError::too_large(path, floats, memory_limit));
    }
    let decoded = decode(path, level, memory_limit - floats)?;
    let samples = match decoded.samples {
        Samples::U8(codes) => {
            let table: Vec<f32> = (0..256).map(|code| linear_from_srgb(code as f32 / 255.0)).collect();
            codes.into_iter().map(|code| table[usize::from(code)]).collect()
        }
        Samples::U16(codes) => {
            codes.into_iter().map(|code| linear_from_srgb(f32::from(code) / 65535.0)).collect()
        }
        Samples::F16(values) => values.into_iter().map(half::f16::to_f32).collect(),
        Samples::F32(values) => values,
    };
    let crate::PictureInfo { width, height, channels, .. } = decoded.info;
    Ok(Picture { width, height, channels, samples })
}

impl LightRecord {
    /// Whether it has fields of other kinds only, which would do nothing.
    fn check_fields(&self, name: &str) -> Result<(), String> {
        use Kind::{Directional, Environment, Point, Sphere, Spot};
        let local: &[Kind] = &[Point, Spot, Sphere];
        let fields: [(&str, bool, &[Kind]); 17] = [
            ("direction", self.direction.is_some(), &[Directional, Spot]),
            ("angles_deg", self.angles_deg.is_some(), &[Directional]),
            ("position", self.position.is_some(), local),
            ("target", self.target.is_some(), &[Spot]),
            ("cone_deg", self.cone_deg.is_some(), &[Spot]),
            ("beam_deg", self.beam_deg.is_some(), &[Spot]),
            ("gobo", self.gobo.is_some(), &[Spot]),
            ("gobo_up", self.gobo_up.is_some(), &[Spot]),
            ("gobo_on", self.gobo_on.is_some(), &[Spot]),
            ("radius", self.radius.is_some(), &[Sphere]),
            ("samples", self.samples.is_some(), &[Sphere]),
            ("attenuation", self.attenuation.is_some(), local),
            ("a0", self.a0.is_some(), local),
            ("nearest", self.nearest.is_some(), local),
            ("file", self.file.is_some(), &[Environment]),
            ("forward", self.forward.is_some(), &[Environment]),
            ("up", self.up.is_some(), &[Environment]),
        ];
        for (field, given, kinds) in fields {
            if given && !kinds.contains(&self.kind) {
                return Err(format!("light '{name}' has {field}, which its kind does not; leave it out"));
            }
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
}

fn toward(v: [f64; 3], name: &str) -> Result<Direction, String> {
    Direction::new(v[0], v[1], v[2]).map_err(|error| format!("light '{name}': {error}"))
}
