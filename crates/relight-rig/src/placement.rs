//! Where a part stands in its scene.

use relight_core::vectors::dot;

/// A rigid motion from a mesh's axes to those of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rows of a rotation matrix: orthonormal, determinant 1.
    pub rotation: [[f64; 3]; 3],
    /// Where the mesh's origin stands.
    pub translation: [f64; 3],
}

impl Placement {
    /// The mesh where its file has it.
    pub const IDENTITY: Self =
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation: [0.0; 3] };

    /// A point of the mesh in the scene.
    pub fn point(&self, point: [f64; 3]) -> [f64; 3] {
        let turned = self.direction(point);
        [0, 1, 2].map(|i| turned[i] + self.translation[i])
    }

    /// A direction of the mesh in the scene.
    pub fn direction(&self, direction: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|row| dot(row, direction))
    }

    /// A direction of the scene in the mesh.
    pub fn direction_in_mesh(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let rows = &self.rotation;
        [0, 1, 2].map(|i| rows[0][i] * x + rows[1][i] * y + rows[2][i] * z)
    }
}
