//! Lighting at the nodes of a lattice over the mesh's box, trilinear between them.

use super::{AxisFunction, ModelFamily, Products};

pub(super) const FAMILY: ModelFamily =
    ModelFamily { name: "lattice", form: "lattice:XxYxZ (2 to 64 nodes along each axis, or 1)", parse };

fn parse(rest: &str) -> Option<Products> {
    let nodes = rest.split('x').map(|nodes| nodes.parse().ok().and_then(hats)).collect::<Option<Vec<_>>>()?;
    Some(Products::All(nodes.try_into().ok()?))
}

/// The functions of an axis of 1 to 64 nodes; one node is the same all along it.
pub(super) fn hats(nodes: usize) -> Option<Vec<AxisFunction>> {
    match nodes {
        1 => Some(vec![AxisFunction::One]),
        2..=64 => Some((0..nodes).map(|node| AxisFunction::Hat { node, nodes }).collect()),
        _ => None,
    }
}
