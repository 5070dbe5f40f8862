//! Quantisation of coefficient planes and their packing into textures: scale and bias, halves,
//! blocks, mips.

mod block;
mod choice;
mod cost;
pub mod dither;
pub mod mips;
mod packing;
mod quantize;
mod range;

pub use block::BlockFormat;
pub use choice::{Budget, Candidate, ChoiceError, choose_formats};
pub use cost::{error_ceilings, light_energy};
pub use packing::{
    ArrayPlan, LayerPlan, PackedMaps, Packing, TexelDomain, TexelFormat, Wrap, full_levels, level_size,
    planes_of_layers,
};
pub use quantize::{Precision, Quantizer};
pub use range::{NotFinite, RangeChoice, RangeRule, choose_range};
