//! Draws packed maps on the GPU by the shader that `relight-shader` writes, and hands the pixels back.
//!
//! [`GpuMaps`] holds an asset as textures and draws it under a light; [`Difference`] compares the
//! picture with the reference relighter's, [`DecodingBound`] says how far it may be off where the
//! GPU decodes blocks itself, and [`decoding_differences`] what that decoding is worth.
//! [`GpuWindow`] shows pictures. [`RigUnderLights`] evaluates an irradiance rig.
//!
//! Pictures are floats to the bit: they are drawn as their bits into integer textures, which every
//! adapter has, OpenGL included. Errors of the device come back as [`GpuError`], never as a panic.
//!
//! ```
//! use relight_gpu::{Backend, Gpu, GpuError};
//! match Gpu::open(Backend::Any) {
//!     Ok(gpu) => assert!(!gpu.name().is_empty()),
//!     Err(GpuError::NoAdapter { .. }) => {} // then `relight verify` exits with 6
//!     Err(error) => panic!("{error}"),
//! }
//! ```

mod bound;
mod decoding;
mod difference;
mod error;
mod gpu;
mod maps;
mod picture;
mod program;
mod rig;
mod rig_bound;
mod texels;
mod texture_format;
mod upload;
mod window;

pub use bound::{DecodingBound, decoding_tolerance};
pub use decoding::{DecodingDifference, decoding_differences};
pub use difference::{Difference, WorstSample};
pub use error::GpuError;
pub use gpu::{Backend, Gpu};
pub use maps::{GpuMaps, TextureMode};
pub use picture::GpuPicture;
pub use rig::{RigUnderLights, SphereSight};
pub use rig_bound::RigBound;
pub use texels::maps_of_level;
pub use window::{GpuWindow, Showing};
