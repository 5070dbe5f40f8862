//! Meshes: glTF 2.0 (`.gltf`, `.glb`) and Wavefront OBJ, told by their first bytes.
//!
//! All triangles of a file become one mesh in the axes of its scene. Materials, pictures, skins and animations are
//! not looked at.

mod data_uri;
mod gltf;
mod obj;

use crate::FormatError;
use crate::error::check_memory;
use crate::machine::bytes_of;
use relight_surface::{Mesh, SurfaceError};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Bytes that a corner of a triangle may take on its way to the finished mesh: as read, with vertices of its
/// own and with sums of tangents.
const BYTES_OF_CORNER: u64 = 400;

/// Reads a mesh with normals and tangents, made where the file has none ([`Mesh::completed`]).
///
/// `memory_limit` bounds file and mesh together, in bytes. Buffers beside a `.gltf` are read too, from its own
/// folder or folders in it.
///
/// # Errors
/// [`FormatError::Io`] when a file can't be read, [`FormatError::Invalid`] when it is damaged or holds no triangle,
/// [`FormatError::Unsupported`] for extensions that it can't be read without, [`FormatError::TooLarge`].
pub fn read_mesh(path: &Path, memory_limit: u64) -> Result<Mesh, FormatError> {
    let bytes = bytes_of(path, memory_limit)?;
    let is_gltf = bytes.starts_with(b"glTF") || bytes.trim_ascii_start().starts_with(b"{");
    let remaining = memory_limit.saturating_sub(bytes.len() as u64);
    let read =
        || if is_gltf { gltf::read(&bytes, path, remaining) } else { obj::read(&bytes, path, remaining) };
    // Damaged numbers make the parsers panic where they trust them; nothing outlives the closure.
    let parts = catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        Err(FormatError::invalid(path, "damaged mesh: its reader gave up; export it again"))
    })?;
    Mesh::joined(parts).map_err(|error| of_surface(path, &error))
}

fn of_surface(path: &Path, error: &SurfaceError) -> FormatError {
    FormatError::invalid(path, error.to_string())
}
