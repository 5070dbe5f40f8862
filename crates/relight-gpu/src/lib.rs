//! Draws packed maps on the GPU and hands the pixels back.

mod bound;
mod decoding;
mod difference;
mod error;
mod gpu;
mod maps;
mod picture;
mod program;
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
pub use texels::maps_of_level;
pub use window::{GpuWindow, Showing};
