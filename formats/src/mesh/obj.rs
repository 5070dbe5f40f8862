//! Wavefront OBJ.

use super::{BYTES_OF_CORNER, Elements, Piece, check_memory};
use crate::FormatError;
use relight_surface::Mesh;
use std::path::Path;

const OPTIONS: tobj::LoadOptions =
    tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };

/// The objects of a file, polygons as fans of triangles; or all its vertices as points.
pub(super) fn read(
    bytes: &[u8],
    path: &Path,
    memory_limit: u64,
    elements: Elements,
) -> Result<Vec<Piece>, FormatError> {
    if bytes.contains(&0) || !has_vertex(bytes) {
        let problem = "it is neither glTF nor the text of an OBJ file with vertices (v X Y Z); export the mesh as .glb, .gltf or .obj";
        return Err(FormatError::unsupported(path, problem));
    }
    // A corner takes two bytes of text at least and gives three corners of triangles at most.
    check_memory((bytes.len() as u64).saturating_mul(3 * BYTES_OF_CORNER / 2), memory_limit, path)?;
    if elements == Elements::Points {
        return points(bytes, path);
    }
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut &*bytes, &OPTIONS, no_materials).map_err(|error| {
        FormatError::invalid(path, format!("damaged OBJ: {error}; export the mesh again"))
    })?;
    Ok(models.into_iter().map(|model| Piece { part: model.name, mesh: mesh_of(model.mesh) }).collect())
}

/// Whether a line begins as a vertex; other texts, such as job files, have none.
fn has_vertex(bytes: &[u8]) -> bool {
    bytes.split(|byte| *byte == b'\n').any(|line| {
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_whitespace();
        words.next() == Some("v") && words.next().is_some_and(|number| number.parse::<f32>().is_ok())
    })
}

fn mesh_of(mesh: tobj::Mesh) -> Mesh {
    let threes = |values: &[f32]| values.as_chunks::<3>().0.to_vec();
    Mesh {
        positions: threes(&mesh.positions),
        normals: threes(&mesh.normals),
        tangents: Vec::new(),
        // OBJ counts v from the bottom.
        uv: mesh.texcoords.as_chunks::<2>().0.iter().map(|[u, v]| [*u, 1.0 - v]).collect(),
        uv2: Vec::new(),
        triangles: mesh.indices.as_chunks::<3>().0.to_vec(),
    }
}

/// Every vertex by the object or group in which it stands; without normals. The crate reads no points.
fn points(bytes: &[u8], path: &Path) -> Result<Vec<Piece>, FormatError> {
    let mut pieces: Vec<Piece> = Vec::new();
    let mut part = String::new();
    for line in bytes.split(|byte| *byte == b'\n') {
        let line = String::from_utf8_lossy(line);
        let (word, rest) = line.trim().split_once(char::is_whitespace).unwrap_or_default();
        if let "o" | "g" = word {
            part = rest.trim().to_owned();
        }
        if word != "v" {
            continue;
        }
        let mut numbers = rest.split_whitespace().map(|number| number.parse().ok());
        let position = [numbers.next(), numbers.next(), numbers.next()].map(Option::flatten);
        let [Some(x), Some(y), Some(z)] = position else {
            return Err(FormatError::invalid(
                path,
                "damaged OBJ: a vertex has no 3 numbers; export the mesh again",
            ));
        };
        if pieces.last().is_none_or(|piece| piece.part != part) {
            pieces.push(Piece { part: part.clone(), mesh: Mesh::default() });
        }
        if let Some(Piece { mesh, .. }) = pieces.last_mut() {
            mesh.triangles.push([mesh.positions.len() as u32; 3]);
            mesh.positions.push([x, y, z]);
        }
    }
    Ok(pieces)
}
