//! Wavefront OBJ.

use super::{BYTES_OF_CORNER, check_memory};
use crate::FormatError;
use relight_surface::Mesh;
use std::path::Path;

const OPTIONS: tobj::LoadOptions =
    tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };

/// The objects of a file, polygons as fans of triangles.
pub(super) fn read(bytes: &[u8], path: &Path, memory_limit: u64) -> Result<Vec<Mesh>, FormatError> {
    if bytes.contains(&0) {
        let problem =
            "it is neither glTF nor the text of an OBJ file; export the mesh as .glb, .gltf or .obj";
        return Err(FormatError::unsupported(path, problem));
    }
    // A corner takes two bytes of text at least and gives three corners of triangles at most.
    check_memory((bytes.len() as u64).saturating_mul(3 * BYTES_OF_CORNER / 2), memory_limit, path)?;
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut &*bytes, &OPTIONS, no_materials).map_err(|error| {
        FormatError::invalid(path, format!("damaged OBJ: {error}; export the mesh again"))
    })?;
    Ok(models.into_iter().map(|model| part(model.mesh)).collect())
}

fn part(mesh: tobj::Mesh) -> Mesh {
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
