//! The fit as its users see it: pictures in, coefficients out.
//!
//! One program for all files: they share the pictures of `pictures.rs`.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

mod calibration;
mod determinism;
mod exposure;
mod hard_lights;
mod hard_pictures;
mod learned;
mod leave_one_out;
mod near;
mod normals;
mod pictures;
mod recovery;
mod refit;
