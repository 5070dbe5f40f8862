//! What `relight_shader` writes: accepted by compilers, right in its numbers, the same as before.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

mod compiles;
mod golden;
mod gpu;
mod lopsided;
mod numbers;
mod rig;
