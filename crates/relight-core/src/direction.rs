//! Unit vectors from the surface towards the light: x right, y up, z out of the picture.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A unit vector from the surface towards the light (x right, y up, z towards the camera).
///
/// The invariant, length 1 to rounding, is why the field is hidden.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct Direction([f64; 3]);

/// Why three numbers are not a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum DirectionError {
    /// A component is NaN or infinite.
    NotFinite([f64; 3]),
    /// The vector is zero, so it points nowhere.
    Zero,
}

impl fmt::Display for DirectionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite([x, y, z]) => {
                write!(f, "light direction ({x}, {y}, {z}) is not finite; give three finite numbers")
            }
            Self::Zero => {
                write!(f, "light direction (0, 0, 0) points nowhere; give a vector of length above 0")
            }
        }
    }
}

impl std::error::Error for DirectionError {}

impl Direction {
    /// Straight out of the picture, (0, 0, 1).
    pub const OUT: Self = Self([0.0, 0.0, 1.0]);

    /// To the right of the picture, (1, 0, 0).
    pub const RIGHT: Self = Self([1.0, 0.0, 0.0]);

    /// Normalises (x, y, z); any finite length above 0 is accepted, 1e-300 and 1e300 included.
    ///
    /// # Errors
    /// [`DirectionError`] for a zero vector and for NaN or infinite components.
    pub fn new(x: f64, y: f64, z: f64) -> Result<Self, DirectionError> {
        let vector = [x, y, z];
        if vector.iter().any(|c| !c.is_finite()) {
            return Err(DirectionError::NotFinite(vector));
        }
        let largest = vector.iter().fold(0.0f64, |a, c| a.max(c.abs()));
        if largest == 0.0 {
            return Err(DirectionError::Zero);
        }
        // Scaled by the largest component first: squares neither overflow nor underflow.
        let [x, y, z] = vector.map(|c| c / largest);
        let length = (x * x + y * y + z * z).sqrt();
        Ok(Self([x / length, y / length, z / length]))
    }

    /// The direction at `azimuth` (radians, counter-clockwise from x towards y) and `elevation`
    /// (radians above the picture plane).
    ///
    /// # Errors
    /// [`DirectionError::NotFinite`] when an angle is not finite.
    pub fn from_azimuth_elevation(azimuth: f64, elevation: f64) -> Result<Self, DirectionError> {
        let (sin_a, cos_a) = libm::sincos(azimuth);
        let (sin_e, cos_e) = libm::sincos(elevation);
        Self::new(cos_e * cos_a, cos_e * sin_a, sin_e)
    }

    /// Component to the right of the picture.
    pub fn x(self) -> f64 {
        self.0[0]
    }

    /// Component upwards in the picture.
    pub fn y(self) -> f64 {
        self.0[1]
    }

    /// Component out of the picture, towards the camera.
    pub fn z(self) -> f64 {
        self.0[2]
    }

    /// The three components.
    pub fn components(self) -> [f64; 3] {
        self.0
    }

    /// Angle above the picture plane in radians, -pi/2..pi/2.
    pub fn elevation(self) -> f64 {
        let [x, y, z] = self.0;
        libm::atan2(z, (x * x + y * y).sqrt())
    }

    /// Angle in the picture plane in radians, counter-clockwise from x, -pi..pi; 0 at the poles.
    pub fn azimuth(self) -> f64 {
        libm::atan2(self.0[1], self.0[0])
    }

    /// Cosine of the angle between two directions, clamped to -1..1.
    pub fn cosine(self, other: Self) -> f64 {
        let [a, b] = [self.0, other.0];
        (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0)
    }

    /// Geodesic distance in radians, 0..pi, accurate to 1e-15 even where the arc cosine of the dot
    /// product loses half its digits: near 0 and near pi.
    ///
    /// Source: W. Kahan, *How futile are mindless assessments of roundoff*, section 12.
    pub fn angle_to(self, other: Self) -> f64 {
        let [a, b] = [self.0, other.0];
        let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let difference = length([a[0] - b[0], a[1] - b[1], a[2] - b[2]]);
        let sum = length([a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
        2.0 * libm::atan2(difference, sum)
    }
}

impl TryFrom<[f64; 3]> for Direction {
    type Error = DirectionError;

    /// Keeps a vector that is already of unit length to the bit, so that files round-trip.
    fn try_from(v: [f64; 3]) -> Result<Self, DirectionError> {
        let [x, y, z] = v;
        if (x * x + y * y + z * z - 1.0).abs() < 1e-15 {
            return Ok(Self(v));
        }
        Self::new(x, y, z)
    }
}

impl From<Direction> for [f64; 3] {
    fn from(direction: Direction) -> Self {
        direction.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angle_keeps_its_digits_where_acos_loses_them() {
        for tiny in [1e-3f64, 1e-6, 1e-9] {
            let a = Direction::OUT;
            let b = Direction::new(libm::sin(tiny), 0.0, libm::cos(tiny)).unwrap();
            assert!((a.angle_to(b) - tiny).abs() < 1e-15, "{tiny}");
            let c = Direction::new(libm::sin(tiny), 0.0, -libm::cos(tiny)).unwrap();
            assert!((a.angle_to(c) - (std::f64::consts::PI - tiny)).abs() < 1e-15, "{tiny}");
        }
    }

    #[test]
    fn cosine_never_leaves_its_range() {
        // A dot product of rounded unit vectors exceeds 1 for about 2% of near-parallel pairs.
        let mut worst = 0.0f64;
        for i in 0..1000 {
            let a = Direction::new(0.1 + f64::from(i) * 0.7, 0.3, 1.0 / (1.0 + f64::from(i))).unwrap();
            let raw: f64 = a.components().iter().map(|c| c * c).sum();
            worst = worst.max(raw);
            assert!(libm::acos(a.cosine(a)).is_finite());
        }
        assert!(worst > 1.0, "the inputs must contain the hazard");
    }

    #[test]
    fn extreme_lengths_are_directions_and_nothing_is_not() {
        assert_eq!(Direction::new(0.0, 1e-300, 0.0).unwrap().y(), 1.0);
        assert_eq!(Direction::new(3e300, 0.0, 4e300).unwrap().components(), [0.6, 0.0, 0.8]);
        assert_eq!(Direction::new(0.0, 0.0, 0.0), Err(DirectionError::Zero));
        assert!(Direction::new(f64::NAN, 0.0, 1.0).is_err());
        assert!(Direction::new(0.0, f64::INFINITY, 1.0).is_err());
    }
}
