//! Why there is no such rig.

use std::fmt;

/// Why there is no such rig.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum RigError {
    /// A model's text that no family understands.
    Model {
        /// What was given.
        text: String,
        /// What would do.
        forms: String,
    },
    /// More vectors of harmonics than a rig may have.
    TooManyParameters {
        /// What the model has.
        parameters: usize,
        /// The most.
        most: usize,
    },
    /// A mesh without any point to light.
    NoSurface,
    /// A number of samples outside its range.
    Samples {
        /// What was given.
        samples: usize,
        /// The least.
        least: usize,
        /// The most.
        most: usize,
    },
}

impl fmt::Display for RigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Model { text, forms } => write!(f, "'{text}' is no rig model; give {forms}"),
            Self::TooManyParameters { parameters, most } => {
                write!(f, "the model has {parameters} vectors of harmonics; give one of at most {most}")
            }
            Self::NoSurface => write!(f, "the mesh has no vertices; a rig needs a surface to fit"),
            Self::Samples { samples, least, most } => {
                write!(f, "{samples} surface samples; give {least} to {most}")
            }
        }
    }
}

impl std::error::Error for RigError {}
