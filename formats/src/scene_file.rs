//! Scene files: lights in TOML. docs/formats.md has the fields.

mod keyed_light;
mod motion;
mod record;

use crate::machine::line_of;
use crate::{FormatError, Samples, decode, read_text};
use keyed_light::{Facing, KeptEnvironment, KeyedLight, SceneLamp, SceneLight, Strength};
use motion::{KeyedMotion, Pose, one_after_another};
use record::{AttenuationName, HorizonName, Kind, LightRecord, MotionRecord, SceneRecord, SequenceRecord};
use relight_core::basis::Sh;
use relight_core::relighter::Picture;
use relight_core::vectors::difference;
use relight_core::{CpuLevel, Direction, linear_from_srgb};
use relight_lights::{Attenuation, Environment, Gobo, HorizonRule, Lamp, Scene, Spot};
use relight_rig::Placement;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Most pictures of a sequence.
const MOST_FRAMES: usize = 100_000;

/// Largest coefficient of a probe, as the largest intensity.
const LARGEST_HARMONIC: f64 = 1e12;

/// A scene as its file has it.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// Pictures that it names: environments and gobos.
    pub inputs: Vec<PathBuf>,
    /// Times of the sequence's pictures; empty where the scene stands still.
    pub times: Vec<f64>,
    horizon: HorizonRule,
    lights: Vec<KeyedLight>,
    object: Option<KeyedMotion>,
    parts: Vec<(String, KeyedMotion)>,
}

/// A scene as rigs know it, at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct RigScene {
    /// In the order of the file.
    pub lights: Vec<relight_rig::Light>,
    /// Where the mesh stands.
    pub object: Placement,
    /// Where parts stand that have a motion of their own: by it, then by the object's. All others are as `object`.
    pub parts: Vec<(String, Placement)>,
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
    let object = match record.object {
        None => None,
        Some(spanned) => {
            let at = spanned.span().start;
            let motion = spanned.into_inner();
            if motion.name.is_some() {
                let words =
                    "[object] has a name; only a [[part]] has one, that of a part of the mesh".to_owned();
                return Err(reader.invalid(at, words));
            }
            Some(keyed_motion(motion).map_err(|words| reader.invalid(at, format!("[object]: {words}")))?)
        }
    };
    let mut parts: Vec<(String, KeyedMotion)> = Vec::new();
    for spanned in record.part {
        let at = spanned.span().start;
        let mut record = spanned.into_inner();
        let name = record.name.take().ok_or_else(|| {
            reader.invalid(at, "a [[part]] has no name; give that of a part of the mesh".to_owned())
        })?;
        if parts.iter().any(|(other, _)| *other == name) {
            return Err(reader.invalid(at, format!("a second [[part]] '{name}'; give its motion once")));
        }
        let motion =
            keyed_motion(record).map_err(|words| reader.invalid(at, format!("part '{name}': {words}")))?;
        parts.push((name, motion));
    }
    Ok(SceneFile { inputs, times, horizon, lights, object, parts })
}

fn keyed_motion(record: MotionRecord) -> Result<KeyedMotion, String> {
    let rest = Pose {
        position: record.position.unwrap_or_default(),
        rotation_deg: record.rotation_deg.unwrap_or_default(),
        pivot: record.pivot.unwrap_or_default(),
    };
    let motion = KeyedMotion { rest, keys: by_time(record.keys, |key| key.time)? };
    motion.check()?;
    Ok(motion)
}

fn by_time<K>(mut keys: Vec<K>, time: fn(&K) -> f64) -> Result<Vec<K>, String> {
    if let Some(key) = keys.iter().find(|key| !time(key).is_finite()) {
        return Err(format!("has a key at time {}; times must be finite", time(key)));
    }
    keys.sort_by(|a, b| time(a).total_cmp(&time(b)));
    Ok(keys)
}

impl SceneFile {
    /// The scene at `time` for pictures: keyed values lie between their neighbours in time, linearly.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] where a key's direction passes through nothing and for what only rigs know: discs, probes and
    /// motions; `path` is for the message.
    pub fn scene(&self, path: &Path, time: f64) -> Result<Scene, FormatError> {
        if self.object.is_some() || !self.parts.is_empty() {
            let words =
                "[object] and [[part]] move a mesh, which only rigs know; leave them out for pictures";
            return Err(FormatError::invalid(path, words));
        }
        let lights = self.lights.iter().map(|keyed| keyed.at(time)?.of_picture()).collect::<Result<_, _>>();
        let lights = lights.map_err(|problem: String| FormatError::invalid(path, problem))?;
        Ok(Scene { lights, horizon: self.horizon })
    }

    /// The scene at `time` for rigs. What is for pictures alone doesn't count: `horizon`, and `samples` and `nearest` of
    /// spheres.
    ///
    /// A light of intensity 1 reflects as much from a white diffuser as in pictures: a sphere or disc has radiance intensity
    /// / radius^2, a point radiant intensity pi, a directional light irradiance pi. Environments are projected to
    /// 121 harmonics.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] as [`Self::scene`], and for what only pictures know: spots and attenuation other than the
    /// inverse square; `path` is for the message.
    pub fn rig_scene(&self, path: &Path, time: f64) -> Result<RigScene, FormatError> {
        let lights = self.lights.iter().map(|keyed| keyed.at(time)?.of_rig()).collect::<Result<_, _>>();
        let lights = lights.map_err(|problem: String| FormatError::invalid(path, problem))?;
        let object = self.object.as_ref().map_or(Placement::IDENTITY, |motion| motion.at(time));
        let placed = |(name, motion): &(String, KeyedMotion)| {
            (name.clone(), one_after_another(&object, &motion.at(time)))
        };
        Ok(RigScene { lights, object, parts: self.parts.iter().map(placed).collect() })
    }

    /// Whether any light's direction differs from pixel to pixel.
    pub fn has_local_lights(&self) -> bool {
        self.lights.iter().any(|keyed| keyed.light.is_local())
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
        let position = || needed(record.first(record.position, |key| key.position), "position");
        let direction = record.first(record.direction, |key| key.direction);
        let target = record.first(record.target, |key| key.target);
        let radius = || {
            let radius = record.first(record.radius, |key| key.radius);
            radius.ok_or_else(|| format!("light '{name}' has no radius; give one above 0"))
        };
        let attenuation = match record.attenuation {
            Some(AttenuationName::None) => Attenuation::None,
            Some(AttenuationName::Inverse) => Attenuation::Inverse { a0: record.a0.unwrap_or(1.0) },
            Some(AttenuationName::InverseSquare) | None => {
                Attenuation::InverseSquare { nearest: record.nearest.unwrap_or(0.01) }
            }
        };
        let lamp = match record.kind {
            Kind::Directional => {
                let direction = match record.angles_deg {
                    Some([azimuth, elevation]) => {
                        Direction::from_azimuth_elevation(azimuth.to_radians(), elevation.to_radians())
                            .map_err(|error| format!("light '{name}': {error}"))?
                    }
                    None => toward(needed(direction, "direction")?, &name)?,
                };
                SceneLamp::Lamp(Lamp::Directional { direction }, Attenuation::None)
            }
            Kind::Point => SceneLamp::Lamp(Lamp::Point { position: position()? }, attenuation),
            Kind::Sphere => {
                let samples = record.samples.unwrap_or(16);
                let lamp = Lamp::Sphere { position: position()?, radius: radius()?, samples };
                SceneLamp::Lamp(lamp, attenuation)
            }
            Kind::Disc => {
                let facing = match (direction, target) {
                    (Some(direction), None) => Facing::Direction(direction),
                    (None, Some(target)) => Facing::Target(target),
                    _ => {
                        let words =
                            format!("light '{name}' needs either a target or the direction that it faces");
                        return Err(words.into());
                    }
                };
                SceneLamp::Disc { position: position()?, facing, radius: radius()? }
            }
            Kind::Probe => SceneLamp::Probe(probe(record.sh.as_deref(), &name)?),
            Kind::Spot => {
                let position = position()?;
                let axis = match (record.direction, target) {
                    (Some(axis), None) => axis,
                    (None, Some(target)) => difference(target, position),
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
                let spot = Spot { position, axis: toward(axis, &name)?, cone, beam, gobo };
                SceneLamp::Lamp(Lamp::Spot(Box::new(spot)), attenuation)
            }
            Kind::Environment => {
                let file = record.file.as_ref().ok_or_else(|| {
                    format!("light '{name}' has no file; give an equirectangular .hdr, .exr, .png or .jpg")
                })?;
                let forward = toward(record.forward.unwrap_or([0.0, 0.0, 1.0]), &name)?;
                let up = toward(record.up.unwrap_or([0.0, 1.0, 0.0]), &name)?;
                let environment = Environment::new(self.picture(file, inputs)?, forward, up)
                    .map_err(|error| format!("light '{name}': {error}"))?;
                SceneLamp::Environment(Arc::new(KeptEnvironment { environment, harmonics: OnceLock::new() }))
            }
        };
        let strength = match record.first(record.radiance, |key| key.radiance) {
            Some(radiance) => Strength::Radiance(radiance),
            None => Strength::Intensity(record.intensity.unwrap_or(1.0)),
        };
        let light = SceneLight { name, color: record.color.unwrap_or([1.0; 3]), strength, lamp };
        light.check()?;
        let keys = by_time(record.keys, |key| key.time);
        let keys = keys.map_err(|words| format!("light '{}' {words}", light.name))?;
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

fn probe(coefficients: Option<&[[f64; 3]]>, name: &str) -> Result<Vec<[f64; 3]>, String> {
    let coefficients = coefficients.unwrap_or_default();
    let count = coefficients.len();
    if Sh::with_count(count).is_err() {
        return Err(format!(
            "light '{name}' has sh of {count} coefficients; give 1, 4, 9 .. 121, each [r, g, b]"
        ));
    }
    match coefficients.iter().flatten().find(|value| !(-LARGEST_HARMONIC..=LARGEST_HARMONIC).contains(*value))
    {
        Some(value) => Err(format!("light '{name}' has {value} in sh; give numbers from -1e12 to 1e12")),
        None => Ok(coefficients.to_vec()),
    }
}

fn toward(v: [f64; 3], name: &str) -> Result<Direction, String> {
    Direction::new(v[0], v[1], v[2]).map_err(|error| format!("light '{name}': {error}"))
}
