//! Meshes: glTF 2.0 (`.gltf`, `.glb`) and Wavefront OBJ, told by their first bytes.
//!
//! All triangles of a file become one mesh in the axes of its scene, or one mesh a rigid part. Materials, pictures, skins and animations are
//! not looked at.

mod data_uri;
mod gltf;
mod obj;

use crate::FormatError;
use crate::error::check_memory;
use crate::machine::bytes_of;
use relight_surface::{Mesh, SurfaceError};
use std::collections::HashMap;
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
    let pieces = pieces_of(path, memory_limit, Elements::Triangles)?;
    let meshes = pieces.into_iter().map(|piece| piece.mesh).collect();
    Mesh::joined(meshes).map_err(|error| of_surface(path, &error))
}

/// Reads a mesh's rigid parts by their names, each as [`read_mesh`] would read it alone, in the axes of the scene.
///
/// In glTF every node with a mesh is a part: it has the node's name, or else its mesh's, or else `node N`; names that
/// come twice are numbered. In OBJ all faces of an object's or group's name are one. Parts without triangles
/// are left out, but a file without any has its points in their place, each a triangle without area.
///
/// # Errors
/// As of [`read_mesh`]; [`FormatError::Invalid`] when there are neither triangles nor points.
pub fn read_mesh_parts(path: &Path, memory_limit: u64) -> Result<Vec<(String, Mesh)>, FormatError> {
    let mut pieces = pieces_of(path, memory_limit, Elements::Triangles)?;
    if pieces.iter().all(|piece| piece.mesh.triangles.is_empty()) {
        pieces = pieces_of(path, memory_limit, Elements::Points)?;
    }
    let mut names = HashMap::new();
    let mut parts: Vec<(String, Vec<Mesh>)> = Vec::new();
    for Piece { part, mesh } in pieces.into_iter().filter(|piece| !piece.mesh.triangles.is_empty()) {
        let index = *names.entry(part.clone()).or_insert(parts.len());
        if index == parts.len() {
            parts.push((part, Vec::new()));
        }
        parts[index].1.push(mesh);
    }
    if parts.is_empty() {
        return Err(FormatError::invalid(
            path,
            "the mesh has no triangle and no point; give one with at least 1",
        ));
    }
    let joined = |(name, meshes)| Ok((name, Mesh::joined(meshes).map_err(|error| of_surface(path, &error))?));
    parts.into_iter().map(joined).collect()
}

/// What a part's surface is made of.
#[derive(Clone, Copy, PartialEq)]
enum Elements {
    Triangles,
    /// Each as a triangle without area.
    Points,
}

/// What belongs to a part and has attributes of its own.
struct Piece {
    part: String,
    mesh: Mesh,
}

fn pieces_of(path: &Path, memory_limit: u64, elements: Elements) -> Result<Vec<Piece>, FormatError> {
    let bytes = bytes_of(path, memory_limit)?;
    let is_gltf = bytes.starts_with(b"glTF") || bytes.trim_ascii_start().starts_with(b"{");
    let remaining = memory_limit.saturating_sub(bytes.len() as u64);
    let read = || match is_gltf {
        true => gltf::read(&bytes, path, remaining, elements),
        false => obj::read(&bytes, path, remaining, elements),
    };
    // Damaged numbers make the parsers panic where they trust them; nothing outlives the closure.
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        Err(FormatError::invalid(path, "damaged mesh: its reader gave up; export it again"))
    })
}

fn of_surface(path: &Path, error: &SurfaceError) -> FormatError {
    FormatError::invalid(path, error.to_string())
}
