//! The mesh that a rig is of.

use crate::failure::{Exit, Failure};
use relight_formats::{MeshKey, RigFile, read_mesh_parts};
use relight_rig::Surface;
use relight_surface::Mesh;
use std::path::Path;

/// A mesh's rigid parts, by name.
pub(super) struct PartMeshes {
    pub(super) parts: Vec<(String, Mesh)>,
}

impl PartMeshes {
    /// Reads all parts, or all of them as one without a name.
    pub(super) fn read(path: &Path, are_apart: bool, memory: u64) -> Result<Self, Failure> {
        let parts = read_mesh_parts(path, memory)?;
        if are_apart {
            return Ok(Self { parts });
        }
        let mut whole = Mesh::default();
        for (_, part) in parts {
            let first = whole.positions.len() as u32;
            whole.positions.extend(part.positions);
            whole.normals.extend(part.normals);
            whole.triangles.extend(part.triangles.iter().map(|corners| corners.map(|vertex| first + vertex)));
        }
        Ok(Self { parts: vec![(String::new(), whole)] })
    }

    /// The parts that a rig was made of.
    ///
    /// # Errors
    /// [`Exit::BadInput`] where it is another mesh.
    pub(super) fn of_rig(path: &Path, rig: &RigFile, rig_path: &Path, memory: u64) -> Result<Self, Failure> {
        let are_apart = rig.rig.parts.len() > 1 || rig.rig.parts.iter().any(|part| !part.name.is_empty());
        let meshes = Self::read(path, are_apart, memory)?;
        if meshes.key(path)?.key != rig.mesh.key {
            let words = format!(
                "{} was baked from another mesh ('{}', {} triangles) than {} ({} triangles); bake it again or give that mesh",
                rig_path.display(),
                rig.mesh.name,
                rig.mesh.triangles,
                path.display(),
                meshes.triangles()
            );
            return Err(Failure::new(Exit::BadInput, words));
        }
        Ok(meshes)
    }

    /// What tells the mesh from others.
    pub(super) fn key(&self, path: &Path) -> Result<MeshKey, Failure> {
        Ok(MeshKey::of(path, self.triangles())?)
    }

    pub(super) fn triangles(&self) -> usize {
        self.parts.iter().map(|(_, mesh)| mesh.triangles.len()).sum()
    }
}

/// A mesh as rigs take it.
pub(super) fn surface_of(mesh: &Mesh) -> Surface<'_> {
    Surface { positions: &mesh.positions, normals: &mesh.normals, triangles: &mesh.triangles }
}
