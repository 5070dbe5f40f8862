//! What a scene is lit by.

use crate::environment::Environment;
use relight_core::Direction;
use relight_core::relighter::Picture;
use std::fmt;

/// The lights of a scene, and what happens where the capture knows nothing of a direction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// In the order in which they are added up.
    pub lights: Vec<Light>,
    /// What becomes of light from beyond the capture's lights.
    pub horizon: HorizonRule,
}

/// A light.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// For people.
    pub name: String,
    /// What it is and where.
    pub lamp: Lamp,
    /// Linear R, G, B relative to the capture's own light; (1, 1, 1) is that light.
    pub color: [f32; 3],
    /// Multiplies the colour. With [`Attenuation::InverseSquare`] a lamp of intensity 1 is, at a distance of
    /// 1, as bright as the capture's light: radiant intensity pi where that light has irradiance pi.
    pub intensity: f64,
    /// How local lights weaken with distance.
    pub attenuation: Attenuation,
}

/// Kinds of lights. Positions are in the axes and units of the asset's position map.
#[derive(Clone, Debug, PartialEq)]
pub enum Lamp {
    /// From one direction everywhere.
    Directional {
        /// From the surface towards the light.
        direction: Direction,
    },
    /// From a point.
    Point {
        /// Where it stands.
        position: [f64; 3],
    },
    /// From a point into a cone.
    Spot(Box<Spot>),
    /// From a sphere, all of whose visible disc shines alike.
    Sphere {
        /// Its middle.
        position: [f64; 3],
        /// Above 0.
        radius: f64,
        /// Directions that stand for it at each pixel, 1 to 1024.
        samples: usize,
    },
    /// From all around.
    Environment(Box<Environment>),
}

/// A spot light.
#[derive(Clone, Debug, PartialEq)]
pub struct Spot {
    /// Where it stands.
    pub position: [f64; 3],
    /// Where it shines.
    pub axis: Direction,
    /// Angle from the axis beyond which it is dark, 0 to pi radians.
    pub cone: f64,
    /// Angle from the axis within which it is whole, up to `cone`; between them it falls linearly with the
    /// angle, as Mitsuba's and pbrt's falloff in the limit of narrow cones does.
    pub beam: f64,
    /// A picture in its way.
    pub gobo: Option<Gobo>,
}

/// A picture through which a spot shines: it fills the square around the cone, a tangent of the cone's
/// angle to each side, and wraps nowhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Gobo {
    /// Linear; multiplies the light, bilinear between pixel centres.
    pub picture: Picture,
    /// What is up in the picture; need not be perpendicular to the axis.
    pub up: Direction,
    /// Whether it is in the way.
    pub on: bool,
}

/// How a local light weakens with the distance d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Attenuation {
    /// Not at all.
    None,
    /// a0 / d.
    ///
    /// Source: both papers of Wong et al.; not physical.
    Inverse {
        /// Distance at which it is 1.
        a0: f64,
    },
    /// 1 / d^2, no larger than at `nearest`.
    InverseSquare {
        /// Above 0.
        nearest: f64,
    },
}

/// What becomes of light from directions that the capture's lights don't reach, below the horizon of a dome.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum HorizonRule {
    /// It is taken from the nearest direction of the capture and fades to nothing within 10 degrees.
    #[default]
    Fade,
    /// All light is multiplied by a ramp of its height above the horizon's plane, from 0 at the plane to 1
    /// at the sine `width`.
    ///
    /// Source: McAllister, *PTM for games*, the 1-D texture over N.L against "a sharp transition".
    DropOff {
        /// Sine of the elevation at which light is whole, above 0 and up to 1.
        width: f64,
    },
    /// The basis goes on however it does.
    Extrapolate,
}

/// A number of a light outside its range.
#[derive(Clone, Debug, PartialEq)]
pub struct LightError {
    /// The light's name.
    pub light: String,
    /// Which number.
    pub what: &'static str,
    /// What it was.
    pub value: f64,
    /// What is allowed.
    pub allowed: &'static str,
}

impl fmt::Display for LightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { light, what, value, allowed } = self;
        write!(f, "light '{light}': {what} is {value}; give {allowed}")
    }
}

impl std::error::Error for LightError {}

impl Light {
    /// Whether its direction differs from pixel to pixel, so that positions are needed.
    pub fn is_local(&self) -> bool {
        !matches!(self.lamp, Lamp::Directional { .. } | Lamp::Environment(_))
    }

    /// Where it stands, if it is local.
    pub fn position(&self) -> Option<[f64; 3]> {
        match &self.lamp {
            Lamp::Point { position } | Lamp::Sphere { position, .. } => Some(*position),
            Lamp::Spot(spot) => Some(spot.position),
            Lamp::Directional { .. } | Lamp::Environment(_) => None,
        }
    }

    /// `directional`, `point`, `spot`, `sphere` or `environment`.
    pub fn kind(&self) -> &'static str {
        match self.lamp {
            Lamp::Directional { .. } => "directional",
            Lamp::Point { .. } => "point",
            Lamp::Spot(_) => "spot",
            Lamp::Sphere { .. } => "sphere",
            Lamp::Environment(_) => "environment",
        }
    }

    /// Whether every number is one that the relighter defines.
    ///
    /// # Errors
    /// [`LightError`] naming the first that is not.
    pub fn check(&self) -> Result<(), LightError> {
        let fail = |what, value, allowed| Err(LightError { light: self.name.clone(), what, value, allowed });
        for component in self.color {
            if !(0.0..=1e6).contains(&component) {
                return fail("a component of its colour", f64::from(component), "0 to 1e6");
            }
        }
        if !(0.0..=1e12).contains(&self.intensity) {
            return fail("its intensity", self.intensity, "0 to 1e12");
        }
        match self.attenuation {
            Attenuation::Inverse { a0 } if !(a0 > 0.0 && a0 <= 1e12) => {
                return fail("a0 of its attenuation", a0, "a distance above 0, up to 1e12");
            }
            Attenuation::InverseSquare { nearest } if !(1e-6..=1e12).contains(&nearest) => {
                return fail("the least distance of its attenuation", nearest, "1e-6 to 1e12");
            }
            _ => {}
        }
        for coordinate in self.position().into_iter().flatten() {
            if !(-1e9..=1e9).contains(&coordinate) {
                return fail("a coordinate of its position", coordinate, "-1e9 to 1e9");
            }
        }
        match &self.lamp {
            Lamp::Sphere { radius, .. } if !(*radius > 0.0 && *radius <= 1e12) => {
                fail("its radius", *radius, "above 0, up to 1e12")
            }
            Lamp::Sphere { samples, .. } if !(1..=1024).contains(samples) => {
                fail("its number of samples", *samples as f64, "1 to 1024")
            }
            Lamp::Spot(spot) if !(0.0..=std::f64::consts::PI).contains(&spot.cone) => {
                fail("its cone in degrees", degrees(spot.cone), "0 to 180 from the axis")
            }
            Lamp::Spot(spot) if !(0.0..=spot.cone).contains(&spot.beam) => {
                fail("its beam in degrees", degrees(spot.beam), "0 up to its cone")
            }
            _ => Ok(()),
        }
    }
}

/// An angle for people: without the digits that the way to radians and back adds.
fn degrees(angle: f64) -> f64 {
    (angle.to_degrees() * 1e9).round() / 1e9
}

impl Attenuation {
    /// The factor at `distance` above 0.
    pub fn factor(self, distance: f64) -> f64 {
        match self {
            Self::None => 1.0,
            Self::Inverse { a0 } => a0 / distance,
            Self::InverseSquare { nearest } => {
                let distance = distance.max(nearest);
                1.0 / (distance * distance)
            }
        }
    }
}

/// A keyframed value's neighbours: linear between keys, held beyond them.
///
/// `keys` are (time, value) by rising time.
pub fn between_keys<const N: usize>(keys: &[(f64, [f64; N])], time: f64) -> Option<[f64; N]> {
    let after = keys.iter().position(|(at, _)| *at >= time);
    match after {
        None => keys.last().map(|(_, value)| *value),
        Some(0) => keys.first().map(|(_, value)| *value),
        Some(next) => {
            let ((t0, a), (t1, b)) = (keys[next - 1], keys[next]);
            let share = if t1 > t0 { (time - t0) / (t1 - t0) } else { 1.0 };
            Some(std::array::from_fn(|i| a[i] + share * (b[i] - a[i])))
        }
    }
}
