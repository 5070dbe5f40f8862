//! Quantisation of coefficient planes and their packing into textures: scale and bias, halves,
//! blocks, mips.

mod block;
mod packing;
mod quantize;

pub use block::{BlockCoding, BlockFormat, Encoder, Quality, decode_blocks, decode_channel, encode_blocks};
pub use packing::{
    ArrayPlan, LayerPlan, PackedMaps, Packing, TexelDomain, TexelFormat, Wrap, full_levels, level_size,
    planes_of_layers,
};
pub use quantize::{Precision, Quantizer};
