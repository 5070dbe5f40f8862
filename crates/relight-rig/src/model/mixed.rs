//! A model an axis, their tensor product: lighting changes at another rate along each axis of a car.
//!
//! Source: *Irradiance Rigs*, section 2.1: three nodes along the length, a slope over the height, nothing across.

use super::lattice::hats;
use super::{AxisFunction, ModelFamily, Products};

pub(super) const FAMILY: ModelFamily = ModelFamily {
    name: "mixed",
    form: "mixed:X,Y,Z (each constant, gradient or a number of nodes, as in mixed:3,gradient,constant)",
    parse,
};

fn parse(rest: &str) -> Option<Products> {
    let axes = rest.split(',').map(|axis| match axis {
        "constant" => Some(vec![AxisFunction::One]),
        "gradient" => Some(vec![AxisFunction::One, AxisFunction::Coordinate]),
        nodes => nodes.parse().ok().and_then(hats),
    });
    Some(Products::All(axes.collect::<Option<Vec<_>>>()?.try_into().ok()?))
}
