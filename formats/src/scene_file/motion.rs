//! Rigid motions of objects and their parts.

use super::record::MotionKey;
use relight_core::vectors::difference;
use relight_lights::between_keys;
use relight_rig::Placement;

/// Largest coordinate and angle: beyond, sums have no digits left.
const LARGEST: f64 = 1e9;

/// A motion as its file has it.
#[derive(Clone, Debug, Default)]
pub(super) struct KeyedMotion {
    /// Where no key says otherwise.
    pub(super) rest: Pose,
    /// By rising time.
    pub(super) keys: Vec<MotionKey>,
}

/// Where something stands: turned about `pivot`, then moved by `position`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pose {
    pub(super) position: [f64; 3],
    /// About the fixed axes x, then y, then z.
    pub(super) rotation_deg: [f64; 3],
    pub(super) pivot: [f64; 3],
}

impl KeyedMotion {
    pub(super) fn at(&self, time: f64) -> Placement {
        let value = |field: fn(&MotionKey) -> Option<[f64; 3]>| {
            let keys: Vec<_> = self.keys.iter().filter_map(|key| Some((key.time, field(key)?))).collect();
            between_keys(&keys, time)
        };
        let pose = Pose {
            position: value(|key| key.position).unwrap_or(self.rest.position),
            rotation_deg: value(|key| key.rotation_deg).unwrap_or(self.rest.rotation_deg),
            pivot: value(|key| key.pivot).unwrap_or(self.rest.pivot),
        };
        pose.placement()
    }

    /// The first number that is out of range.
    pub(super) fn check(&self) -> Result<(), String> {
        let Pose { position, rotation_deg, pivot } = self.rest;
        let keyed = self.keys.iter().flat_map(|key| [key.position, key.rotation_deg, key.pivot]);
        let numbers = [position, rotation_deg, pivot].into_iter().chain(keyed.flatten()).flatten();
        match numbers.into_iter().find(|number| !(-LARGEST..=LARGEST).contains(number)) {
            Some(number) => Err(format!("a motion's number is {number}; give {:e} to {LARGEST:e}", -LARGEST)),
            None => Ok(()),
        }
    }
}

impl Pose {
    fn placement(self) -> Placement {
        let turns = self.rotation_deg.map(|degrees| {
            // Whole turns first: large angles have fewer digits in radians.
            let angle = (degrees % 360.0).to_radians();
            (libm::sin(angle), libm::cos(angle))
        });
        let [(sx, cx), (sy, cy), (sz, cz)] = turns;
        let x = [[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]];
        let y = [[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]];
        let z = [[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]];
        let turned = Placement { rotation: product(&z, &product(&y, &x)), translation: [0.0; 3] };
        let beside = difference(self.pivot, turned.point(self.pivot));
        Placement { translation: [0, 1, 2].map(|i| beside[i] + self.position[i]), ..turned }
    }
}

/// What `inner` and then `outer` does.
pub(super) fn one_after_another(outer: &Placement, inner: &Placement) -> Placement {
    Placement {
        rotation: product(&outer.rotation, &inner.rotation),
        translation: outer.point(inner.translation),
    }
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    a.map(|row| [0, 1, 2].map(|j| row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]))
}
