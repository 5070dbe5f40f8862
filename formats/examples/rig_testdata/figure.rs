//! A figure 1.8 tall that stands on z = 0 and looks along x, of six rigid parts; each lies about the joint that it turns about.

use crate::surface::{Round, Surface};
use relight_core::vectors::difference;

/// Height of the joints above the floor.
pub(crate) const HIPS: f64 = 0.92;
pub(crate) const SHOULDERS: f64 = 1.42;

/// Half the distance between the joints.
pub(crate) const HIPS_ASIDE: f64 = 0.1;
pub(crate) const SHOULDERS_ASIDE: f64 = 0.25;

/// Name, joint, and the surface about the joint.
pub(crate) fn parts() -> Vec<(&'static str, [f64; 3], Surface)> {
    let torso = Surface::around([8, 8, 8], Round::Box, [0.0, 0.0, 1.19], [0.12, 0.2, 0.31]);
    let neck = Surface::limb([4, 4, 4], [[-0.01, 0.0, 1.42], [0.01, 0.0, 1.64]], [0.06, 0.055]);
    let skull = Surface::around([6, 6, 8], Round::Ellipsoid, [0.01, 0.0, 1.67], [0.1, 0.085, 0.13]);
    let mut parts =
        vec![("torso", [0.0, 0.0, HIPS], torso), ("head", [0.0, 0.0, 1.5], Surface::joined([neck, skull]))];
    for (name, side) in [("arm_left", 1.0), ("arm_right", -1.0)] {
        let at = |x: f64, aside: f64, z: f64| [x, side * aside, z];
        let upper = Surface::limb([6, 6, 6], [at(0.0, 0.25, 1.47), at(-0.01, 0.28, 1.12)], [0.058, 0.045]);
        let lower = Surface::limb([6, 6, 6], [at(-0.01, 0.28, 1.15), at(0.04, 0.29, 0.84)], [0.045, 0.032]);
        let hand = Surface::around([4, 4, 4], Round::Ellipsoid, at(0.05, 0.29, 0.79), [0.045, 0.022, 0.085]);
        parts.push((name, at(0.0, SHOULDERS_ASIDE, SHOULDERS), Surface::joined([upper, lower, hand])));
    }
    for (name, side) in [("leg_left", 1.0), ("leg_right", -1.0)] {
        let at = |x: f64, z: f64| [x, side * HIPS_ASIDE, z];
        let thigh = Surface::limb([6, 6, 6], [at(0.0, 0.99), at(0.0, 0.47)], [0.092, 0.064]);
        let shin = Surface::limb([6, 6, 6], [at(0.0, 0.52), at(-0.01, 0.04)], [0.06, 0.04]);
        let foot = Surface::around([6, 4, 4], Round::Box, at(0.05, 0.045), [0.13, 0.048, 0.045]);
        parts.push((name, at(0.0, HIPS), Surface::joined([thigh, shin, foot])));
    }
    for (_, joint, surface) in &mut parts {
        surface.positions.iter_mut().for_each(|position| *position = difference(*position, *joint));
    }
    parts
}
