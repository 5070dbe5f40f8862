//! How wrong a rig is, by the distance of a light.
//!
//! The paper's criterion, the error at the surface point nearest to the light, is not monotone: harmonics of three bands
//! overshoot facing irradiance by a sixteenth, which cancels the error of the rig at 33.5 radii (constant) and 6.78 radii
//! (gradient). Here the largest error over the whole surface counts, and of that the largest at this distance or any
//! beyond it.

use crate::lighting::reflection;
use crate::{ErrorTable, Frame, Light, Placement, RigPart, Source, SurfacePoint};
use rayon::prelude::*;
use relight_core::Direction;
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::vectors::scaled;
use std::f64::consts::PI;

/// Distances of tables, in radii of the frame.
pub const DISTANCES: [f64; 22] = [
    1.1, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 24.0, 32.0, 48.0,
    64.0, 96.0, 128.0,
];

/// Radius of a table's light in radii of the frame. Errors of larger lights are smaller for the same radiance times radius
/// squared, by a twentieth at most from here to .8.
const LIGHT_RADIUS: f64 = 0.01;

/// Directions of a table's light: along axes, edges and corners of the box, where lattices differ most, and all around.
pub fn directions() -> Vec<[f64; 3]> {
    let mut directions = Vec::new();
    for i in 0..27 {
        let v = [i % 3, i / 3 % 3, i / 9].map(|c| f64::from(c) - 1.0);
        directions.extend(Direction::new(v[0], v[1], v[2]).map(Direction::components));
    }
    directions.extend(
        fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, 38).into_iter().map(Direction::components),
    );
    directions
}

/// The largest errors of a small sphere light from `directions` at `distances` (radii of the frame, above 1) over the part's
/// surface points.
pub fn error_table(part: &RigPart, bands: usize, directions: &[[f64; 3]], distances: &[f64]) -> ErrorTable {
    let errors = distances.iter().map(|&distance| {
        Yardstick::new(&part.frame, &part.surface, bands, directions, distance).largest_errors(part)
    });
    let (rig, total) = errors.map(|[rig, total]| (rig, total)).unzip();
    ErrorTable { distances: distances.to_vec(), rig, total }
}

/// What parts of one frame and surface are measured by: small lights at a distance and what they give to points, whatever the model.
pub(crate) struct Yardstick<'a> {
    bands: usize,
    surface: &'a [SurfacePoint],
    /// By surface point: what each coefficient reflects.
    reflections: Vec<Vec<f64>>,
    lights: Vec<MeasuredLight>,
}

struct MeasuredLight {
    light: Light,
    /// By surface point: reflected radiance of harmonics there, and exactly.
    reflected: Vec<[f64; 2]>,
}

impl<'a> Yardstick<'a> {
    /// Lights in `directions` at `distance` radii of the frame.
    pub(crate) fn new(
        frame: &Frame,
        surface: &'a [SurfacePoint],
        bands: usize,
        directions: &[[f64; 3]],
        distance: f64,
    ) -> Self {
        let of_point = |point: &SurfacePoint| {
            let mut weights = vec![0.0; bands * bands];
            reflection(point.normal, &mut weights);
            weights
        };
        let reflections: Vec<Vec<f64>> = surface.iter().map(of_point).collect();
        let of_direction = |&direction: &[f64; 3]| {
            let offset = scaled(direction, distance * frame.radius);
            let light = Light {
                name: String::new(),
                source: Source::Sphere {
                    centre: [0, 1, 2].map(|i| frame.centre[i] + offset[i]),
                    radius: LIGHT_RADIUS * frame.radius,
                },
                color: [LIGHT_RADIUS.powi(-2); 3],
            };
            let mut seen = vec![[0.0; 3]; bands * bands];
            let reflected = surface.iter().zip(&reflections).map(|(point, weights)| {
                seen.fill([0.0; 3]);
                light.add_projection(point.position, bands, &mut seen);
                let harmonics = weights.iter().zip(&seen).map(|(weight, value)| weight * value[0]).sum();
                [harmonics, light.irradiance(point.position, point.normal)[0] / PI]
            });
            MeasuredLight { reflected: reflected.collect(), light }
        };
        let lights = directions.par_iter().map(of_direction).collect();
        Self { bands, surface, reflections, lights }
    }

    /// Of the rig against harmonics at each point, and against exact irradiance.
    pub(crate) fn largest_errors(&self, part: &RigPart) -> [f64; 2] {
        let parameters = part.model.parameters().len();
        let of_point = |point: &SurfacePoint| {
            let mut weights = vec![0.0; parameters];
            part.model.weights(part.frame.coordinates(point.position), &mut weights);
            weights
        };
        let weights: Vec<Vec<f64>> = self.surface.iter().map(of_point).collect();
        let of_light = |measured: &MeasuredLight| {
            let coefficients = part.coefficients(&[(&measured.light, 1.0)], &Placement::IDENTITY, self.bands);
            let mut largest = [0.0f64; 2];
            for ((weights, reflection), reflected) in
                weights.iter().zip(&self.reflections).zip(&measured.reflected)
            {
                let mut rig = 0.0;
                for (weight, values) in weights.iter().zip(coefficients.chunks_exact(reflection.len())) {
                    // Most nodes of a lattice are far from the point.
                    if *weight == 0.0 {
                        continue;
                    }
                    for (reflection, value) in reflection.iter().zip(values) {
                        rig += weight * reflection * value[0];
                    }
                }
                largest = [0, 1].map(|i| largest[i].max((rig - reflected[i]).abs()));
            }
            largest
        };
        let errors: Vec<[f64; 2]> = self.lights.par_iter().map(of_light).collect();
        errors.iter().fold([0.0; 2], |largest, errors| [0, 1].map(|i| largest[i].max(errors[i])))
    }
}

/// A table's largest total error at a distance or any beyond it: it falls all the way, so that an error is reached at one distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Envelope {
    /// Distances and errors, in the units of [`ErrorTable`]; at least one, errors falling or level.
    entries: Vec<(f64, f64)>,
}

impl Envelope {
    /// The envelope of a table's total errors; `None` for an empty one.
    pub fn new(table: &ErrorTable) -> Option<Self> {
        let mut entries: Vec<_> = table.distances.iter().copied().zip(table.total.iter().copied()).collect();
        for i in (1..entries.len()).rev() {
            entries[i - 1].1 = entries[i - 1].1.max(entries[i].1);
        }
        (!entries.is_empty()).then_some(Self { entries })
    }

    /// The error at `distance` (radii of the frame) per unit of strength; infinite closer than the table begins, falling with the
    /// distance's square beyond its end.
    pub fn error(&self, distance: f64) -> f64 {
        let above = self.entries.partition_point(|entry| entry.0 <= distance);
        match (above.checked_sub(1), self.entries.get(above)) {
            (None, _) => f64::INFINITY,
            (Some(last), None) => {
                let (end, error) = self.entries[last];
                error * (end / distance) * (end / distance)
            }
            (Some(near), Some(&(far, least))) => between(distance, self.entries[near], (far, least)),
        }
    }

    /// The least distance (radii of the frame) from which on a light of this strength errs by no more than `error`.
    ///
    /// Source: *Irradiance Rigs*, section 3.1: bisection to bracket, interpolation between entries; on an envelope, which has no
    /// false zeros.
    pub fn distance(&self, strength: f64, error: f64) -> f64 {
        let wanted = error / strength;
        let within = self.entries.partition_point(|entry| entry.1 > wanted);
        match (within.checked_sub(1), self.entries.get(within)) {
            (None, _) => self.entries[0].0,
            (Some(last), None) => {
                let (end, least) = self.entries[last];
                end * (least / wanted).sqrt()
            }
            (Some(near), Some(&(far, least))) => {
                between(wanted, flipped(self.entries[near]), flipped((far, least)))
            }
        }
    }
}

fn flipped((a, b): (f64, f64)) -> (f64, f64) {
    (b, a)
}

/// Straight between two entries in logarithms of both coordinates, as powers are; their far end where logarithms fail.
fn between(at: f64, (x0, y0): (f64, f64), (x1, y1): (f64, f64)) -> f64 {
    let share = libm::log(at / x0) / libm::log(x1 / x0);
    let value = libm::exp((1.0 - share) * libm::log(y0) + share * libm::log(y1));
    if value.is_finite() { value } else { y0.max(y1) }
}
