//! Where a capture has no light.

use super::{Cap, fibonacci_in};
use crate::Direction;
use std::f64::consts::FRAC_PI_2;

/// A part of the upper hemisphere without lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hole {
    /// Its middle.
    pub centre: Direction,
    /// Distance from there to the nearest light, radians.
    pub radius: f64,
}

/// The largest hole of the upper hemisphere (z >= 0), found on 8,192 evenly spread points, so to
/// about 1 degree; `None` without lights.
pub fn largest_hole(directions: &[Direction]) -> Option<Hole> {
    if directions.is_empty() {
        return None;
    }
    let hemisphere = Cap { axis: Direction::OUT, radius: FRAC_PI_2 };
    let distance = |p: Direction| directions.iter().map(|d| p.angle_to(*d)).fold(f64::INFINITY, f64::min);
    fibonacci_in(hemisphere, 8192).into_iter().map(|centre| Hole { centre, radius: distance(centre) }).reduce(
        |largest, hole| {
            if hole.radius > largest.radius { hole } else { largest }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_quarter_is_the_hole() {
        let hemisphere = Cap { axis: Direction::OUT, radius: FRAC_PI_2 };
        let lights: Vec<_> =
            fibonacci_in(hemisphere, 300).into_iter().filter(|d| d.x() < 0.3 || d.y() < 0.3).collect();
        let hole = largest_hole(&lights).unwrap();
        assert!(hole.centre.x() > 0.4 && hole.centre.y() > 0.4, "{hole:?}");
        assert!(hole.radius > 0.4, "{hole:?}");
    }
}
