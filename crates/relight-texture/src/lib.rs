//! Quantisation of coefficient planes and their packing into textures: scale and bias, halves,
//! blocks, mips.

mod block;
mod choice;
mod cost;
mod dither;
mod feedback;
mod functions;
mod loops;
pub mod mips;
mod pack;
mod packing;
mod positions;
mod quantize;
mod range;
mod storing;
mod texels;

pub use block::{BlockCoding, BlockFormat, Encoder, Quality, decode_blocks, decode_channel, encode_blocks};
pub use choice::{Budget, Candidate, ChoiceError, choose_formats};
pub use cost::{error_ceilings, light_energy};
pub use functions::function_texels;
pub use pack::{Coding, Packer, Put, TexelPlace, held_bytes, span_pixels, working_bytes};
pub use packing::{
    ArrayPlan, LayerPlan, PackedMaps, Packing, TexelDomain, TexelFormat, full_levels, level_size, needs_rows,
    planes_of_layers,
};
pub use positions::PositionPlan;
pub use quantize::{Precision, Quantizer};
pub use range::{NotFinite, RangeChoice, RangeRule, choose_range};
pub use relight_core::Wrap;
pub use storing::{PackReport, PlaneErrors, StoringErrors};
