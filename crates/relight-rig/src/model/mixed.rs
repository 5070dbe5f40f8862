//! A model an axis, their tensor product: lighting changes at another rate along each axis of a car.
//!
//! Source: *Irradiance Rigs*, section 2.1: three nodes along the length, a slope over the height, nothing across.

use super::lattice::hats;
use super::{AxisFunction, ModelFamily};

pub(super) const FAMILY: ModelFamily = ModelFamily {
    name: "mixed",
    form: "mixed:X,Y,Z (each constant, gradient or a number of nodes, as in mixed:3,gradient,constant)",
    parse,
};

fn parse(rest: &str) -> Option<Vec<[AxisFunction; 3]>> {
    let axes = rest.split(',').map(|axis| match axis {
        "constant" => Some(vec![AxisFunction::One]),
        "gradient" => Some(vec![AxisFunction::One, AxisFunction::Coordinate]),
        nodes => nodes.parse().ok().and_then(hats),
    });
    Some(product(&<[_; 3]>::try_from(axes.collect::<Option<Vec<_>>>()?).ok()?))
}

/// Every product of a function of x, one of y and one of z; x changes fastest.
pub(super) fn product([x, y, z]: &[Vec<AxisFunction>; 3]) -> Vec<[AxisFunction; 3]> {
    let rows = z.iter().flat_map(|&z| y.iter().map(move |&y| (y, z)));
    rows.flat_map(|(y, z)| x.iter().map(move |&x| [x, y, z])).collect()
}
