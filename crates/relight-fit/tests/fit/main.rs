//! The fit as its users see it: pictures in, coefficients out.
//!
//! One program for all files: they share the pictures of `pictures.rs`.

mod determinism;
mod hard_lights;
mod hard_pictures;
mod leave_one_out;
mod pictures;
mod recovery;
