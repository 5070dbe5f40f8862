//! Rigs as they are kept: per rigid part of a mesh where it is lit from, how, and how wrong that is.

use crate::Model;

/// A rig: what it takes to light a moving mesh by a few vectors of harmonics.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Bands of the harmonics, 1 to 7: l = 0 .. bands - 1, bands^2 functions. 3 hold 99 % of diffuse reflection.
    pub bands: usize,
    /// The mesh's rigid parts, at least one.
    pub parts: Vec<RigPart>,
}

/// A rigid part of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct RigPart {
    /// The part's name in the mesh's file; empty for the whole mesh.
    pub name: String,
    /// How its lighting varies.
    pub model: Model,
    /// Its box and sphere, in the mesh's axes.
    pub frame: Frame,
    /// Where lights are seen from, in the mesh's axes.
    pub samples: Vec<Sample>,
    /// parameters x samples, row-major: what makes the parameters of what the samples see.
    pub operator: Vec<f64>,
    /// Points all over the surface, in the mesh's axes: where errors are measured.
    pub surface: Vec<SurfacePoint>,
    /// How wrong the rig is, by distance of a light.
    pub errors: ErrorTable,
}

/// The box and the sphere around a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The middle of the box.
    pub centre: [f64; 3],
    /// Half of the box's edges; those without extent count as 1 where something is divided by them.
    pub half_extent: [f64; 3],
    /// Largest distance of a vertex from the middle, above 0.
    pub radius: f64,
}

/// A place where the lights are looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// In the mesh's axes.
    pub position: [f64; 3],
    /// What is taken of the harmonics there.
    pub quantity: Quantity,
}

/// What is taken of the harmonics at a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// They themselves.
    Value,
    /// Their slope along an axis of the mesh (0, 1, 2), times half the box's edge.
    Slope(usize),
}

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where it is.
    pub position: [f64; 3],
    /// Unit vector out of the surface.
    pub normal: [f64; 3],
}

/// Largest errors over a part's surface and all directions of a small sphere light, in reflected radiance of a white diffuser
/// (irradiance / pi), for a light of radiance 1 and of the frame's radius: they scale with radiance x (radius of the light /
/// radius of the frame)^2.
///
/// Source: *Irradiance Rigs*, section 3.1 and figure 5; the scale is MATH.md's, not the paper's N(r).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ErrorTable {
    /// Distances of the light from the frame's middle in radii of the frame, rising, above 1.
    pub distances: Vec<f64>,
    /// Of the rig against harmonics projected at each point; 0 for a rig that is nothing but that.
    pub rig: Vec<f64>,
    /// Of the rig against exact irradiance.
    pub total: Vec<f64>,
}

impl Frame {
    /// Coordinates in the box, -1 to 1 along each axis.
    pub fn coordinates(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| {
            let half = if self.half_extent[i] > 0.0 { self.half_extent[i] } else { 1.0 };
            (point[i] - self.centre[i]) / half
        })
    }
}
