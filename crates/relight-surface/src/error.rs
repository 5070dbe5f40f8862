//! Why a surface can't be drawn.

use std::fmt;

/// Why a surface can't be drawn.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum SurfaceError {
    /// A mesh without triangles.
    NoTriangles,
    /// An attribute that has not one value a vertex.
    AttributeCount {
        /// Which.
        name: &'static str,
        /// How many it has.
        count: usize,
        /// How many there should be.
        vertices: usize,
    },
    /// A triangle of a vertex that is not there.
    Index {
        /// Which triangle, from 0.
        triangle: usize,
        /// Its vertex.
        index: u32,
        /// How many there are.
        vertices: usize,
    },
    /// A coordinate that is NaN or infinite.
    NotFinite {
        /// Of which attribute.
        name: &'static str,
        /// Of which vertex, from 0.
        vertex: usize,
    },
    /// An attribute that is needed and absent.
    Missing {
        /// Which.
        name: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// More vertices than indices can name.
    TooManyVertices {
        /// How many.
        vertices: usize,
    },
    /// A camera that triangles can't be drawn with.
    PanoramicCamera,
    /// Samples a pixel's side outside 1 to 16.
    Supersampling {
        /// What was asked for.
        samples: usize,
    },
}

impl fmt::Display for SurfaceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoTriangles => write!(f, "the mesh has no triangle; give one with at least 1"),
            Self::AttributeCount { name, count, vertices } => write!(
                f,
                "the mesh has {count} {name} for {vertices} vertices; it needs one each or none, export it again"
            ),
            Self::Index { triangle, index, vertices } => write!(
                f,
                "triangle {triangle} names vertex {index} of {vertices} (from 0); export the mesh again"
            ),
            Self::NotFinite { name, vertex } => write!(
                f,
                "the {name} of vertex {vertex} (from 0) are not finite numbers; export the mesh again"
            ),
            Self::Missing { name, remedy } => write!(f, "the mesh has no {name}; {remedy}"),
            Self::TooManyVertices { vertices } => {
                write!(f, "the mesh has {vertices} vertices where {} are the most; split it", u32::MAX)
            }
            Self::PanoramicCamera => {
                write!(f, "meshes are not drawn as panoramas; give a perspective or orthographic camera")
            }
            Self::Supersampling { samples } => {
                write!(
                    f,
                    "{samples} samples along a pixel's side are outside 1 to 16; give a number of those"
                )
            }
        }
    }
}

impl std::error::Error for SurfaceError {}
