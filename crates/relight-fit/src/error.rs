//! What can go wrong in a fit.

use relight_core::{BasisError, Layout, StackError};
use std::fmt;

/// Why a fit was not made.
#[derive(Debug)]
#[non_exhaustive]
pub enum FitError {
    /// No light at all.
    NoLights,
    /// A ridge outside 0..1, or NaN.
    Ridge {
        /// The value.
        ridge: f64,
    },
    /// LRGB was asked for pictures of one channel.
    GreyHasNoColor,
    /// A mean PSNR that is not to be had.
    OutOfReach {
        /// What was asked for, in dB.
        target: f64,
        /// So many planes ..
        planes: usize,
        /// .. reach this.
        best: f64,
    },
    /// Fewer than 3 lights can't tell a normal.
    TooFewForNormals {
        /// How many there are.
        lights: usize,
    },
    /// Lights in one plane leave a normal's part across it open.
    CoplanarLights {
        /// How many there are.
        lights: usize,
    },
    /// Planes of one layout that are no linear function of those of another.
    Layouts {
        /// What the planes are.
        from: Layout,
        /// What they were to become.
        to: Layout,
    },
    /// A near lamp in the middle of the surface, or at no finite place.
    LampInTheMiddle {
        /// Index of the light.
        light: usize,
    },
    /// Positions of which none is on a surface.
    NoSurface,
    /// Functions that can't be stored.
    Basis(BasisError),
    /// The pictures could not be read back.
    Stack(StackError),
}

impl fmt::Display for FitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoLights => write!(f, "a fit needs at least 1 light; the light set has 0"),
            Self::Ridge { ridge } => {
                write!(f, "ridge {ridge} is outside 0..1; give a value in that range or 'auto'")
            }
            Self::GreyHasNoColor => {
                write!(f, "the pictures are grey, so there is no base colour to store; use --color rgb")
            }
            Self::OutOfReach { target, planes, best } => write!(
                f,
                "{planes} planes reach {best:.2} dB on lights predicted from the others, not {target}; allow more \
                 planes or lower --target-psnr"
            ),
            Self::TooFewForNormals { lights } => {
                write!(f, "normals need at least 3 lights; the light set has {lights}, so take more pictures")
            }
            Self::CoplanarLights { lights } => {
                write!(
                    f,
                    "the {lights} lights lie in one plane through the surface, which leaves normals open; add a picture lit from outside it"
                )
            }
            Self::Layouts { from, to } => write!(
                f,
                "planes of layout {from:?} don't become planes of layout {to:?} by sums; bake the pictures, or keep the \
                 layout"
            ),
            Self::LampInTheMiddle { light } => write!(
                f,
                "lamp {light} (from 0) stands in the middle of the surface, or nowhere; give where it was, from there"
            ),
            Self::NoSurface => {
                write!(f, "no pixel has a surface, so lamps are near to nothing; give positions with points")
            }
            Self::Basis(error) => write!(f, "{error}"),
            Self::Stack(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for FitError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Stack(error) => error.source(),
            _ => None,
        }
    }
}

impl From<StackError> for FitError {
    fn from(error: StackError) -> Self {
        Self::Stack(error)
    }
}
