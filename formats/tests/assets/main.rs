//! Assets through files: round trips, other readers, golden bytes, mangled bytes.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod dds;
mod files;
mod ktx2;
mod lopsided;
mod mangled;
mod planar;
mod position_files;
mod positions;
mod ptm_forms;
mod refusals;
mod round_trips;
mod rti;
mod web;
mod web_tiles;
