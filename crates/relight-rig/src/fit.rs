//! From a mesh to its rig.

use crate::errors::{DISTANCES, directions, error_table};
use crate::operator::least_squares;
use crate::{
    AxisFunction, ErrorTable, Frame, Model, Quantity, RigError, RigPart, Sample, Surface, SurfacePoint,
};

/// Samples of a rig.
pub const SAMPLES: std::ops::RangeInclusive<usize> = 1..=1024;

/// Points at which errors are measured.
const SURFACE_POINTS: usize = 512;

/// What decides where points lie on a surface; any number.
const SEED: u64 = 7;

/// Where a rig looks at the lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fitting {
    /// From the samples of its surface, by least squares.
    Surface,
    /// From the middle of the mesh and the nodes of its lattice, with slopes where the model has them: without looking at the
    /// surface. What least squares is compared with.
    Nodes,
}

/// What a rig is made for: a part's surface and where it is looked at. Several models can be fitted to it.
#[derive(Clone, Debug)]
pub struct Ground {
    /// The part's name.
    pub name: String,
    /// Box and sphere.
    pub frame: Frame,
    /// Where least squares looks at the lights.
    pub samples: Vec<SurfacePoint>,
    /// Where errors are measured.
    pub surface: Vec<SurfacePoint>,
}

impl Ground {
    /// Spreads `samples` samples and the points of errors over a surface.
    ///
    /// # Errors
    /// [`RigError::NoSurface`] without vertices, [`RigError::Samples`] outside [`SAMPLES`].
    pub fn new(name: &str, surface: &Surface<'_>, samples: usize) -> Result<Self, RigError> {
        if !SAMPLES.contains(&samples) {
            return Err(RigError::Samples { samples, least: *SAMPLES.start(), most: *SAMPLES.end() });
        }
        Ok(Self {
            name: name.to_owned(),
            frame: surface.frame()?,
            samples: surface.spread(samples, SEED)?,
            surface: surface.spread(SURFACE_POINTS, SEED + 1)?,
        })
    }

    /// The part with `model` and its errors at all [`DISTANCES`].
    pub fn part(&self, model: &Model, fitting: Fitting, bands: usize) -> RigPart {
        let mut part = self.without_errors(model, fitting);
        part.errors = error_table(&part, bands, &directions(), &DISTANCES);
        part
    }

    /// The part with `model`, its errors not looked at.
    pub fn without_errors(&self, model: &Model, fitting: Fitting) -> RigPart {
        let (samples, operator) = match fitting {
            Fitting::Surface => {
                let coordinates: Vec<_> =
                    self.samples.iter().map(|s| self.frame.coordinates(s.position)).collect();
                let value = |s: &SurfacePoint| Sample { position: s.position, quantity: Quantity::Value };
                (self.samples.iter().map(value).collect(), least_squares(model, &coordinates))
            }
            Fitting::Nodes => nodes(model, &self.frame),
        };
        RigPart {
            name: self.name.clone(),
            model: model.clone(),
            frame: self.frame,
            samples,
            operator,
            surface: self.surface.clone(),
            errors: ErrorTable::default(),
        }
    }
}

/// A sample a parameter where its functions stand, and the operator that takes each as it is. Parameters that are slopes along
/// two axes at once are 0: the gradient does not tell them.
fn nodes(model: &Model, frame: &Frame) -> (Vec<Sample>, Vec<f64>) {
    let mut samples = Vec::new();
    let mut columns = Vec::new();
    for (parameter, product) in model.parameters().iter().enumerate() {
        let slopes: Vec<usize> = (0..3).filter(|&axis| product[axis] == AxisFunction::Coordinate).collect();
        let quantity = match slopes[..] {
            [] => Quantity::Value,
            [axis] => Quantity::Slope(axis),
            _ => continue,
        };
        let position = [0, 1, 2].map(|axis| {
            let coordinate = match product[axis] {
                AxisFunction::Hat { node, nodes } => 2.0 * node as f64 / (nodes - 1) as f64 - 1.0,
                AxisFunction::One | AxisFunction::Coordinate => 0.0,
            };
            frame.centre[axis] + coordinate * frame.half_extent[axis]
        });
        samples.push(Sample { position, quantity });
        columns.push(parameter);
    }
    let mut operator = vec![0.0; model.parameters().len() * samples.len()];
    for (sample, &parameter) in columns.iter().enumerate() {
        operator[parameter * samples.len() + sample] = 1.0;
    }
    (samples, operator)
}
