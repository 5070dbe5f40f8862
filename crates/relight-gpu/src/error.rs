//! Why a GPU does not draw.

use crate::Backend;
use std::fmt;

/// Why a GPU does not draw.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter behind that backend.
    NoAdapter {
        /// What was asked for.
        backend: Backend,
        /// Whether it had to draw into a window.
        window: bool,
    },
    /// A picture that is larger than the adapter's textures.
    TooLarge {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// The adapter's largest width and height.
        limit: usize,
    },
    /// More textures in one shader than the adapter has.
    TooManyTextures {
        /// How many the asset needs.
        textures: usize,
        /// How many the adapter has.
        limit: usize,
    },
    /// The GPU's memory is full.
    OutOfMemory,
    /// The device went away: reset, unplugged, or its driver failed.
    Lost {
        /// What the driver said.
        reason: String,
    },
    /// The window can't be drawn into.
    Window {
        /// What the system said.
        reason: String,
    },
    /// The driver refused what wgpu's rules allow, or we broke those rules.
    Refused {
        /// What wgpu said.
        reason: String,
    },
}

impl fmt::Display for GpuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoAdapter { backend, window } => {
                let which = match backend {
                    Backend::Any => "no GPU adapter".to_owned(),
                    backend => format!("no adapter of backend {}", backend.name()),
                };
                let purpose = if *window { " for windows" } else { "" };
                write!(
                    f,
                    "this machine has {which}{purpose}; install its driver, or a software one \
                     (Debian: libvulkan1 and mesa-vulkan-drivers)"
                )
            }
            Self::TooLarge { width, height, limit } => {
                write!(
                    f,
                    "a picture of {width} x {height} exceeds this adapter's textures of {limit} x {limit}"
                )
            }
            Self::TooManyTextures { textures, limit } => {
                write!(f, "the asset needs {textures} textures at once, this adapter has {limit}")
            }
            Self::OutOfMemory => write!(f, "the GPU's memory is full; take a smaller asset"),
            Self::Lost { reason } => write!(f, "the GPU was lost while drawing ({reason}); try again"),
            Self::Window { reason } => write!(f, "the window can't be drawn into: {reason}"),
            Self::Refused { reason } => write!(f, "the GPU's driver refused to draw: {reason}"),
        }
    }
}

impl std::error::Error for GpuError {}
