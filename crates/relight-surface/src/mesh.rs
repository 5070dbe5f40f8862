//! Triangles with what is needed to put pictures on them.

use crate::SurfaceError;
use crate::tangents::with_tangents;
use relight_core::vectors::{cross, difference, unit, wide};

/// A mesh of triangles in the axes of its world.
///
/// Attributes have one value a vertex, or none where the mesh lacks them. Texture coordinates are those of
/// glTF: (0, 0) is the upper left corner of the picture, (1, 1) the lower right one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Where the vertices are.
    pub positions: Vec<[f32; 3]>,
    /// Out of the surface, unit length.
    pub normals: Vec<[f32; 3]>,
    /// Where u grows, unit length, and the handedness, 1 or -1: the top of the picture is towards
    /// handedness x normal x tangent.
    pub tangents: Vec<[f32; 4]>,
    /// Coordinates in textures.
    pub uv: Vec<[f32; 2]>,
    /// Coordinates in the lightmap, where they are others.
    pub uv2: Vec<[f32; 2]>,
    /// Three vertices each; either side may be seen.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Fails unless every triangle's vertices are there with all attributes that the mesh has, in finite
    /// numbers.
    ///
    /// # Errors
    /// [`SurfaceError`] that names the first fault.
    pub fn check(&self) -> Result<(), SurfaceError> {
        let vertices = self.positions.len();
        if self.triangles.is_empty() {
            return Err(SurfaceError::NoTriangles);
        }
        if vertices > u32::MAX as usize {
            return Err(SurfaceError::TooManyVertices { vertices });
        }
        check_attribute("positions", &self.positions, vertices)?;
        check_attribute("normals", &self.normals, vertices)?;
        check_attribute("tangents", &self.tangents, vertices)?;
        check_attribute("texture coordinates", &self.uv, vertices)?;
        check_attribute("lightmap coordinates", &self.uv2, vertices)?;
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&index| index as usize >= vertices) {
                return Err(SurfaceError::Index { triangle, index, vertices });
            }
        }
        Ok(())
    }

    /// The mesh with the normals and tangents that it lacks.
    ///
    /// Missing normals are those of the triangles, which then share no vertex, and tangents are
    /// not believed without normals, both as glTF demands. Missing tangents follow the texture coordinates;
    /// vertices that mirrored and unmirrored triangles share are doubled, and where the coordinates
    /// say nothing the frame is [`TangentFrame::around`](crate::TangentFrame::around) the normal.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn completed(self) -> Result<Self, SurfaceError> {
        self.check()?;
        let mesh = if self.normals.is_empty() { self.with_flat_normals() } else { self };
        let mesh = if mesh.tangents.is_empty() { with_tangents(mesh) } else { mesh };
        mesh.check()?;
        Ok(mesh)
    }

    /// All triangles of `parts` in one mesh, each part [`Self::completed`]; parts without triangles are left out.
    ///
    /// Where only some parts have texture coordinates, the others' are 0; where only some have lightmap
    /// coordinates, the others' are their texture coordinates.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn joined(parts: Vec<Self>) -> Result<Self, SurfaceError> {
        let parts = parts.into_iter().filter(|part| !part.triangles.is_empty()).map(Self::completed);
        let parts = parts.collect::<Result<Vec<_>, _>>()?;
        let has_uv = parts.iter().any(|part| !part.uv.is_empty());
        let has_uv2 = parts.iter().any(|part| !part.uv2.is_empty());
        let mut whole = Self::default();
        for mut part in parts {
            let (first, vertices) = (whole.positions.len(), part.positions.len());
            if first + vertices > u32::MAX as usize {
                return Err(SurfaceError::TooManyVertices { vertices: first + vertices });
            }
            if has_uv {
                part.uv.resize(vertices, [0.0; 2]);
            }
            if has_uv2 && part.uv2.is_empty() {
                part.uv2 = part.uv.clone();
                part.uv2.resize(vertices, [0.0; 2]);
            }
            whole.positions.extend(part.positions);
            whole.normals.extend(part.normals);
            whole.tangents.extend(part.tangents);
            whole.uv.extend(part.uv);
            whole.uv2.extend(part.uv2);
            let moved = |triangle: [u32; 3]| triangle.map(|vertex| first as u32 + vertex);
            whole.triangles.extend(part.triangles.into_iter().map(moved));
        }
        whole.check()?;
        Ok(whole)
    }

    /// Every triangle with vertices of its own, whose normal is the triangle's.
    fn with_flat_normals(self) -> Self {
        let corners: Vec<u32> = self.triangles.iter().flatten().copied().collect();
        let normals = self.triangles.iter().flat_map(|&triangle| {
            let [a, b, c] = triangle.map(|vertex| wide(self.positions[vertex as usize]));
            let normal = unit(cross(difference(b, a), difference(c, a)));
            // Triangles without area are not drawn.
            [normal.unwrap_or([0.0, 0.0, 1.0]).map(|c| c as f32); 3]
        });
        Self {
            normals: normals.collect(),
            tangents: Vec::new(),
            positions: at(&self.positions, &corners),
            uv: at(&self.uv, &corners),
            uv2: at(&self.uv2, &corners),
            triangles: (0..self.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        }
    }

    /// The coordinates in a lightmap: the second set where there is one.
    ///
    /// # Errors
    /// [`SurfaceError::Missing`] where there is none at all.
    pub fn lightmap_coordinates(&self) -> Result<&[[f32; 2]], SurfaceError> {
        if self.uv2.is_empty() { self.texture_coordinates() } else { Ok(&self.uv2) }
    }

    /// The coordinates in textures.
    ///
    /// # Errors
    /// [`SurfaceError::Missing`] where there are none.
    pub fn texture_coordinates(&self) -> Result<&[[f32; 2]], SurfaceError> {
        let remedy = "unwrap it and export it with texture coordinates";
        if self.uv.is_empty() {
            return Err(SurfaceError::Missing { name: "texture coordinates", remedy });
        }
        Ok(&self.uv)
    }
}

/// The values of an attribute at `vertices`; none where there are none.
pub(crate) fn at<T: Copy>(values: &[T], vertices: &[u32]) -> Vec<T> {
    if values.is_empty() {
        return Vec::new();
    }
    vertices.iter().map(|&vertex| values[vertex as usize]).collect()
}

fn check_attribute<const N: usize>(
    name: &'static str,
    values: &[[f32; N]],
    vertices: usize,
) -> Result<(), SurfaceError> {
    if !values.is_empty() && values.len() != vertices {
        return Err(SurfaceError::AttributeCount { name, count: values.len(), vertices });
    }
    match values.iter().position(|value| value.iter().any(|c| !c.is_finite())) {
        Some(vertex) => Err(SurfaceError::NotFinite { name, vertex }),
        None => Ok(()),
    }
}
