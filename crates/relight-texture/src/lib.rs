//! Quantisation of coefficient planes: 8-bit with scale and bias, half, float.

mod quantize;

pub use quantize::{Precision, Quantizer};
