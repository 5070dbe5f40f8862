//! The only code that knows the bytes of files: pictures and light files in, assets out and in.

mod error;

pub use error::FormatError;
