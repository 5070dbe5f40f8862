//! All the lights of a capture, in picture order.

use crate::Direction;

/// One light of a capture and the picture taken under it.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The picture's name as the light file gives it.
    pub name: String,
    /// From the surface towards the light.
    pub direction: Direction,
}

/// All lights of a capture, in picture order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightSet {
    /// One per picture, in the order of the `.lp` file.
    pub lights: Vec<Light>,
}

impl LightSet {
    /// A light set whose pictures have no names.
    pub fn from_directions(directions: Vec<Direction>) -> Self {
        let lights =
            directions.into_iter().map(|direction| Light { name: String::new(), direction }).collect();
        Self { lights }
    }

    /// The directions, in picture order.
    pub fn directions(&self) -> Vec<Direction> {
        self.lights.iter().map(|light| light.direction).collect()
    }

    /// How many lights there are.
    pub fn len(&self) -> usize {
        self.lights.len()
    }

    /// Whether there is no light.
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }
}
