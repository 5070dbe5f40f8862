//! Which directions a capture knows, and what becomes of light from the others.

use crate::scene::HorizonRule;
use relight_core::sphere::Cap;
use relight_core::vectors::{difference, dot, frame_around, scaled, unit};
use relight_core::{Basis, Direction, Model};
use std::f64::consts::{FRAC_PI_2, PI};

/// Angle within which light from beyond the capture's rim fades to nothing.
const FADE: f64 = 10.0 * PI / 180.0;

/// A cap of lights wider than this is the whole sphere.
const WHOLE: f64 = 150.0 * PI / 180.0;

/// The directions that a capture knows: what a [`HorizonRule`] means for an asset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Horizon {
    /// What holds the capture's lights.
    pub cap: Cap,
    /// What becomes of others.
    pub rule: HorizonRule,
}

/// A direction as a basis is to take it, and the factor of its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taken {
    /// Within the capture's directions, unless the rule says to extrapolate.
    pub direction: Direction,
    /// 0 to 1.
    pub factor: f64,
}

impl Horizon {
    /// The horizon of an asset: the smallest cap that holds its lights, at least the hemisphere about its
    /// axis where the capture is a dome (all lights above its plane), and the whole sphere where they
    /// reach beyond 150 degrees. Without lights: the hemisphere of the picture's plane.
    ///
    /// A dome is taken to know everything down to its plane: its lowest lights usually stand a few degrees
    /// above it.
    pub fn of(model: &Model, rule: HorizonRule) -> Self {
        let hemisphere = Cap { axis: Direction::OUT, radius: FRAC_PI_2 };
        let cap = match (&model.basis, Cap::enclosing(&model.lights)) {
            (Basis::Hsh(_), _) | (_, None) => hemisphere,
            (_, Some(cap)) if cap.radius > WHOLE => Cap { axis: cap.axis, radius: PI },
            (_, Some(cap)) if model.lights.iter().all(|light| light.z() >= 0.0) && cap.radius > 1.0 => {
                hemisphere
            }
            (_, Some(cap)) => cap,
        };
        Self { cap, rule }
    }

    /// Whether all directions are taken as they are.
    pub fn is_everywhere(&self) -> bool {
        match self.rule {
            HorizonRule::Extrapolate => true,
            HorizonRule::Fade => self.cap.radius >= PI,
            HorizonRule::DropOff { .. } => false,
        }
    }

    /// How light from `direction` is taken.
    pub fn take(&self, direction: Direction) -> Taken {
        let axis = self.cap.axis;
        match self.rule {
            HorizonRule::Extrapolate => Taken { direction, factor: 1.0 },
            HorizonRule::DropOff { width } => {
                let height = dot(axis.components(), direction.components());
                Taken { direction, factor: (height / width).clamp(0.0, 1.0) }
            }
            HorizonRule::Fade => {
                let angle = axis.angle_to(direction);
                if angle <= self.cap.radius {
                    return Taken { direction, factor: 1.0 };
                }
                let factor = (1.0 - (angle - self.cap.radius) / FADE).max(0.0);
                Taken { direction: at_angle(axis, direction, self.cap.radius), factor }
            }
        }
    }
}

/// The direction at `angle` from `axis` on the great circle towards `direction`; opposite to the axis any
/// circle does.
fn at_angle(axis: Direction, direction: Direction, angle: f64) -> Direction {
    let [a, d] = [axis, direction].map(Direction::components);
    let across = difference(d, scaled(a, dot(a, d)));
    let across = unit(across).unwrap_or_else(|| frame_around(a)[0]);
    let (sin, cos) = libm::sincos(angle);
    let turned = [0, 1, 2].map(|i| cos * a[i] + sin * across[i]);
    Direction::new(turned[0], turned[1], turned[2]).unwrap_or(axis)
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_core::{Design, Family, Layout, LightSet, Space};

    fn model(lights: Vec<Direction>) -> Model {
        let basis = Family::by_name("ptm").unwrap().build(&Design::new(6, &LightSet::default())).unwrap();
        Model { basis, layout: Layout::Rgb, space: Space::Linear, lights, figures: None, provenance: None }
    }

    fn at(azimuth: f64, elevation: f64) -> Direction {
        Direction::from_azimuth_elevation(azimuth.to_radians(), elevation.to_radians()).unwrap()
    }

    #[test]
    fn light_from_below_a_dome_is_the_rims_and_fades() {
        let dome: Vec<_> = (0..40).map(|i| at(9.0 * f64::from(i), 4.0 + f64::from(i % 8) * 10.0)).collect();
        let horizon = Horizon::of(&model(dome), HorizonRule::Fade);
        assert!(!horizon.is_everywhere());
        for (elevation, factor) in
            [(30.0, 1.0), (1.0, 1.0), (0.0, 1.0), (-2.5, 0.75), (-9.0, 0.1), (-10.0, 0.0), (-90.0, 0.0)]
        {
            let taken = horizon.take(at(200.0, elevation));
            assert!((taken.factor - factor).abs() < 1e-9, "{elevation}: {taken:?}");
            let expected = at(200.0, f64::max(elevation, 0.0));
            assert!(
                elevation == -90.0 || taken.direction.angle_to(expected) < 1e-9,
                "{elevation}: {taken:?}"
            );
        }
    }

    #[test]
    fn a_capture_from_all_around_has_no_horizon() {
        let sphere = relight_core::sphere::fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, 60);
        let horizon = Horizon::of(&model(sphere), HorizonRule::Fade);
        assert!(horizon.is_everywhere());
        let below = at(10.0, -60.0);
        assert_eq!(horizon.take(below), Taken { direction: below, factor: 1.0 });
    }

    #[test]
    fn drop_off_is_a_ramp_of_the_height() {
        let horizon = Horizon::of(&model(Vec::new()), HorizonRule::DropOff { width: 0.5 });
        for (elevation, factor) in [(90.0, 1.0), (30.0, 1.0), (0.0, 0.0), (-40.0, 0.0)] {
            assert!((horizon.take(at(0.0, elevation)).factor - factor).abs() < 1e-12);
        }
        assert!((horizon.take(at(0.0, 14.477_512_185_929_923)).factor - 0.5).abs() < 1e-12);
    }
}
