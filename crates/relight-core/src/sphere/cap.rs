//! Spherical caps: the part of the sphere that lights cover.

use crate::Direction;
use crate::vectors::{difference, dot, frame_around, length, scaled, unit};

/// All directions within `radius` of `axis`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cap {
    /// The middle.
    pub axis: Direction,
    /// Radians, 0..pi.
    pub radius: f64,
}

impl Cap {
    /// Whether `direction` lies inside or on the rim.
    pub fn contains(self, direction: Direction) -> bool {
        self.axis.angle_to(direction) <= self.radius
    }

    /// The direction itself where it lies inside, else the nearest one on the rim.
    pub fn nearest(self, direction: Direction) -> Direction {
        if self.contains(direction) {
            return direction;
        }
        let (axis, d) = (self.axis.components(), direction.components());
        let along = dot(d, axis);
        // Straight behind, all of the rim is as near: the frame's first vector decides.
        let across = difference(d, scaled(axis, along));
        let across = if length(across) > 1e-9 { unit(across) } else { None };
        let across = across.unwrap_or_else(|| frame_around(axis)[0]);
        let (sine, cosine) = libm::sincos(self.radius);
        let turned = [0, 1, 2].map(|i| cosine * axis[i] + sine * across[i]);
        Direction::new(turned[0], turned[1], turned[2]).unwrap_or(self.axis)
    }

    /// The smallest cap around `directions`, to about 0.1 degree; `None` when there are none.
    ///
    /// The axis walks towards the outermost direction in ever smaller steps.
    /// Source: Badoiu, Clarkson, *Smaller core-sets for balls*, 2003, on the chord metric.
    pub fn enclosing(directions: &[Direction]) -> Option<Self> {
        let first = *directions.first()?;
        let sum = directions.iter().fold([0.0; 3], |s, d| {
            let c = d.components();
            [s[0] + c[0], s[1] + c[1], s[2] + c[2]]
        });
        // Lights all around have no mean direction: any axis does, the cap is the sphere.
        let mut middle = Direction::new(sum[0], sum[1], sum[2]).unwrap_or(first).components();
        let outermost = |middle: [f64; 3]| {
            let chord = |d: &Direction| {
                let c = d.components();
                (0..3).map(|i| (c[i] - middle[i]) * (c[i] - middle[i])).sum::<f64>()
            };
            directions.iter().fold((first, -1.0), |best, d| {
                let distance = chord(d);
                if distance > best.1 { (*d, distance) } else { best }
            })
        };
        for step in 1..=1000 {
            let target = outermost(middle).0.components();
            for i in 0..3 {
                middle[i] += (target[i] - middle[i]) / f64::from(step + 1);
            }
        }
        let axis = Direction::new(middle[0], middle[1], middle[2]).unwrap_or(first);
        let radius = directions.iter().fold(0.0f64, |r, d| r.max(axis.angle_to(*d)));
        Some(Self { axis, radius })
    }

    /// Turns a direction given relative to the pole (0, 0, 1) so that the pole becomes the axis.
    ///
    /// Source: as of [`frame_around`].
    pub fn from_pole(self, direction: Direction) -> Direction {
        let axis = self.axis.components();
        let [tangent, bitangent] = frame_around(axis);
        let [u, v, w] = direction.components();
        let turned = [0, 1, 2].map(|i| u * tangent[i] + v * bitangent[i] + w * axis[i]);
        Direction::new(turned[0], turned[1], turned[2]).unwrap_or(self.axis)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::fibonacci_in;

    #[test]
    fn a_cap_of_points_is_found_again() {
        for (axis, radius) in [([0.0, 0.0, 1.0], 1.4), ([0.5, -0.2, 0.7], 0.6), ([-0.1, 0.9, -0.4], 1.0)] {
            let cap = Cap { axis: Direction::new(axis[0], axis[1], axis[2]).unwrap(), radius };
            let points = fibonacci_in(cap, 400);
            assert!(points.iter().all(|p| cap.contains(*p)));
            let found = Cap::enclosing(&points).unwrap();
            assert!(found.axis.angle_to(cap.axis) < 0.03, "{}", found.axis.angle_to(cap.axis));
            assert!((found.radius - radius).abs() < 0.03, "{} {radius}", found.radius);
        }
    }

    #[test]
    fn two_lights_lie_on_the_rim_and_one_is_its_own_cap() {
        let a = Direction::new(0.6, 0.0, 0.8).unwrap();
        let b = Direction::new(-0.6, 0.0, 0.8).unwrap();
        let cap = Cap::enclosing(&[a, b]).unwrap();
        assert!((cap.radius - libm::asin(0.6)).abs() < 2e-3);
        assert!(Cap::enclosing(&[a]).unwrap().radius < 1e-12);
        assert_eq!(Cap::enclosing(&[]), None);
    }
}
