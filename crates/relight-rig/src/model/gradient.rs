//! Lighting that changes evenly: a value and three slopes.
//!
//! Source: *Irradiance Rigs*, section 2.1, after Annen et al., *Spherical Harmonic Gradients for Mid-Range Illumination*.

use super::AxisFunction::{Coordinate, One};
use super::{ModelFamily, Products};

pub(super) const FAMILY: ModelFamily = ModelFamily { name: "gradient", form: "gradient", parse };

fn parse(rest: &str) -> Option<Products> {
    let products =
        vec![[One, One, One], [Coordinate, One, One], [One, Coordinate, One], [One, One, Coordinate]];
    rest.is_empty().then_some(Products::These(products))
}
