//! The GPU against the reference relighter, on any adapter; software counts.
//!
//! Without an adapter the tests say that they skip, unless RELIGHT_REQUIRE_GPU is 1.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod agreement;
mod assets;
mod faults;
