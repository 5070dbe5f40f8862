//! Lights of scene files, whose values may change with time, as pictures and rigs want them.

use super::record::Key;
use relight_core::basis::Sh;
use relight_core::sphere::Cap;
use relight_core::vectors::{difference, unit};
use relight_core::{Basis, Direction};
use relight_lights::{Attenuation, Environment, Horizon, HorizonRule, Lamp, Light, between_keys};
use relight_rig::{Probe, Source};
use std::f64::consts::PI;
use std::sync::{Arc, OnceLock};

/// Functions that an environment is projected to for rigs: to order 10, the most that core knows.
const PROBE_FUNCTIONS: usize = 121;

/// A light as its file has it.
#[derive(Clone, Debug)]
pub(super) struct KeyedLight {
    /// Where no key says otherwise.
    pub(super) light: SceneLight,
    /// By rising time.
    pub(super) keys: Vec<Key>,
}

/// A light at one time.
#[derive(Clone, Debug)]
pub(super) struct SceneLight {
    pub(super) name: String,
    pub(super) color: [f64; 3],
    pub(super) strength: Strength,
    pub(super) lamp: SceneLamp,
}

/// How bright a light is; multiplies its colour.
#[derive(Clone, Copy, Debug)]
pub(super) enum Strength {
    /// A lamp of intensity 1 lights a facing white diffuser at a distance of 1 to 1.
    Intensity(f64),
    /// Of spheres and discs.
    Radiance(f64),
}

#[derive(Clone, Debug)]
pub(super) enum SceneLamp {
    /// What pictures know, but for environments.
    Lamp(Lamp, Attenuation),
    Environment(Arc<KeptEnvironment>),
    Disc {
        position: [f64; 3],
        facing: Facing,
        radius: f64,
    },
    /// Coefficients of radiance.
    Probe(Vec<[f64; 3]>),
}

/// Where the side of a disc that shines looks.
#[derive(Clone, Copy, Debug)]
pub(super) enum Facing {
    Direction([f64; 3]),
    Target([f64; 3]),
}

/// An environment, and its harmonics once a rig has asked for them.
#[derive(Debug)]
pub(super) struct KeptEnvironment {
    pub(super) environment: Environment,
    pub(super) harmonics: OnceLock<Vec<[f64; 3]>>,
}

impl KeptEnvironment {
    /// The radiance's coefficients.
    fn harmonics(&self) -> Vec<[f64; 3]> {
        let projected = || {
            let everywhere =
                Horizon { cap: Cap { axis: Direction::OUT, radius: PI }, rule: HorizonRule::Extrapolate };
            let sh = Sh::with_count(PROBE_FUNCTIONS).expect("a count of its table");
            // Weights are shares of a white diffuser's light: integrals / pi.
            let weights = self.environment.weights(&Basis::Sh(sh), &everywhere);
            weights.into_iter().map(|weight| weight.map(|w| PI * w)).collect()
        };
        self.harmonics.get_or_init(projected).clone()
    }
}

impl KeyedLight {
    pub(super) fn at(&self, time: f64) -> Result<SceneLight, String> {
        let mut light = self.light.clone();
        let value = |field: fn(&Key) -> Option<[f64; 3]>| {
            let keys: Vec<_> = self.keys.iter().filter_map(|key| Some((key.time, field(key)?))).collect();
            between_keys(&keys, time)
        };
        let number = |field: fn(&Key) -> Option<f64>| {
            let keys: Vec<_> = self.keys.iter().filter_map(|key| Some((key.time, [field(key)?]))).collect();
            between_keys(&keys, time).map(|[number]| number)
        };
        let toward = |v: [f64; 3]| {
            Direction::new(v[0], v[1], v[2])
                .map_err(|error| format!("light '{}' at time {time}: {error}", light.name))
        };
        let moved = value(|key| key.position);
        let turned = value(|key| key.direction);
        let target = value(|key| key.target);
        let grown = number(|key| key.radius);
        match &mut light.lamp {
            SceneLamp::Lamp(lamp, _) => match lamp {
                Lamp::Directional { direction } => {
                    *direction = turned.map(toward).transpose()?.unwrap_or(*direction);
                }
                Lamp::Point { position } => *position = moved.unwrap_or(*position),
                Lamp::Sphere { position, radius, .. } => {
                    *position = moved.unwrap_or(*position);
                    *radius = grown.unwrap_or(*radius);
                }
                Lamp::Spot(spot) => {
                    spot.position = moved.unwrap_or(spot.position);
                    if let Some(target) = target {
                        let [x, y, z] = difference(target, spot.position);
                        spot.axis = Direction::new(x, y, z).map_err(|_| {
                            format!("light '{}' at time {time} stands at its target", light.name)
                        })?;
                    }
                }
                Lamp::Environment(_) => {}
            },
            SceneLamp::Disc { position, facing, radius } => {
                *position = moved.unwrap_or(*position);
                *radius = grown.unwrap_or(*radius);
                *facing = match *facing {
                    Facing::Direction(direction) => Facing::Direction(turned.unwrap_or(direction)),
                    Facing::Target(at) => Facing::Target(target.unwrap_or(at)),
                };
            }
            SceneLamp::Environment(_) | SceneLamp::Probe(_) => {}
        }
        light.color = value(|key| key.color).unwrap_or(light.color);
        light.strength = match light.strength {
            Strength::Intensity(own) => Strength::Intensity(number(|key| key.intensity).unwrap_or(own)),
            Strength::Radiance(own) => Strength::Radiance(number(|key| key.radiance).unwrap_or(own)),
        };
        light.check().map_err(|problem| format!("at time {time}: {problem}"))?;
        Ok(light)
    }
}

impl SceneLight {
    /// Whether its direction differs from place to place.
    pub(super) fn is_local(&self) -> bool {
        match &self.lamp {
            SceneLamp::Lamp(lamp, _) => !matches!(lamp, Lamp::Directional { .. }),
            SceneLamp::Disc { .. } => true,
            SceneLamp::Environment(_) | SceneLamp::Probe(_) => false,
        }
    }

    /// Whether every number is one that pictures, or rigs, define.
    pub(super) fn check(&self) -> Result<(), String> {
        // Discs are held to what holds for spheres, the rest to what holds for light from afar.
        let far = || (Lamp::Directional { direction: Direction::OUT }, Attenuation::None);
        let (lamp, attenuation) = match &self.lamp {
            SceneLamp::Lamp(lamp, attenuation) => (lamp.clone(), *attenuation),
            SceneLamp::Disc { position, radius, facing } => {
                if facing.from(*position).is_none() {
                    return Err(format!("light '{}' {NO_SIDE}", self.name));
                }
                (Lamp::Sphere { position: *position, radius: *radius, samples: 1 }, Attenuation::None)
            }
            SceneLamp::Environment(_) | SceneLamp::Probe(_) => far(),
        };
        self.as_picture_light(lamp, attenuation).check().map_err(|error| error.to_string())
    }

    fn as_picture_light(&self, lamp: Lamp, attenuation: Attenuation) -> Light {
        let intensity = match (self.strength, &lamp) {
            (Strength::Radiance(radiance), Lamp::Sphere { radius, .. }) => radiance * radius * radius,
            (Strength::Intensity(strength) | Strength::Radiance(strength), _) => strength,
        };
        let color = self.color.map(|c| c as f32);
        Light { name: self.name.clone(), lamp, color, intensity, attenuation }
    }

    /// The light for pictures.
    pub(super) fn of_picture(&self) -> Result<Light, String> {
        let kind = match &self.lamp {
            SceneLamp::Lamp(lamp, attenuation) => {
                return Ok(self.as_picture_light(lamp.clone(), *attenuation));
            }
            SceneLamp::Environment(kept) => {
                let lamp = Lamp::Environment(Box::new(kept.environment.clone()));
                return Ok(self.as_picture_light(lamp, Attenuation::None));
            }
            SceneLamp::Disc { .. } => "disc",
            SceneLamp::Probe(_) => "probe",
        };
        let name = &self.name;
        Err(format!(
            "light '{name}' is a {kind}, which only rigs know; switch it off for pictures (on = false)"
        ))
    }

    /// The light for rigs.
    pub(super) fn of_rig(&self) -> Result<relight_rig::Light, String> {
        let refused = |why: &str| Err(format!("light '{}' {why}", self.name));
        let (source, factor) = match &self.lamp {
            SceneLamp::Lamp(Lamp::Directional { direction }, _) => {
                (Source::Directional { direction: direction.components() }, PI * self.strength.number())
            }
            SceneLamp::Lamp(Lamp::Point { position }, Attenuation::InverseSquare { nearest }) => {
                (Source::Point { position: *position, nearest: *nearest }, PI * self.strength.number())
            }
            SceneLamp::Lamp(Lamp::Sphere { position, radius, .. }, Attenuation::InverseSquare { .. }) => {
                (Source::Sphere { centre: *position, radius: *radius }, self.strength.radiance(*radius))
            }
            SceneLamp::Lamp(Lamp::Point { .. } | Lamp::Sphere { .. }, _) => {
                return refused(
                    "weakens otherwise than by the inverse square, which rigs need; leave attenuation out",
                );
            }
            SceneLamp::Lamp(Lamp::Spot(_) | Lamp::Environment(_), _) => {
                return refused("is a spot, which rigs don't know; give a point, a sphere or a disc");
            }
            SceneLamp::Environment(kept) => {
                (Source::Probe(Probe { coefficients: kept.harmonics() }), self.strength.number())
            }
            SceneLamp::Disc { position, facing, radius } => {
                let Some(normal) = facing.from(*position) else { return refused(NO_SIDE) };
                let source = Source::Disc { centre: *position, normal, radius: *radius };
                (source, self.strength.radiance(*radius))
            }
            SceneLamp::Probe(coefficients) => {
                (Source::Probe(Probe { coefficients: coefficients.clone() }), self.strength.number())
            }
        };
        if !factor.is_finite() {
            return refused("is too small to shine that brightly; give it a larger radius or less intensity");
        }
        Ok(relight_rig::Light { name: self.name.clone(), source, color: self.color.map(|c| c * factor) })
    }
}

const NO_SIDE: &str = "has no direction, or stands at its target; give a direction or another target";

impl Strength {
    fn number(self) -> f64 {
        let (Self::Intensity(number) | Self::Radiance(number)) = self;
        number
    }

    /// Radiance of a sphere, or of a disc that faces what it lights: radiance x pi radius^2 is the radiant intensity.
    fn radiance(self, radius: f64) -> f64 {
        match self {
            Self::Intensity(intensity) => intensity / (radius * radius),
            Self::Radiance(radiance) => radiance,
        }
    }
}

impl Facing {
    /// The unit vector from a disc at `position`; `None` where there is no such direction.
    fn from(self, position: [f64; 3]) -> Option<[f64; 3]> {
        match self {
            Self::Direction(direction) => unit(direction),
            Self::Target(target) => unit(difference(target, position)),
        }
    }
}
