//! Tangents from texture coordinates.

use crate::mesh::at;
use crate::{Mesh, TangentFrame};
use relight_core::vectors::{cross, difference, dot, length, scaled, unit, wide};

/// Coordinates whose triangle is thinner than this part of its sides' product have no direction: they are f32.
const THINNEST: f64 = 1e-6;

/// Where u grows on a triangle.
#[derive(Clone, Copy)]
struct TriangleTangent {
    /// As long as the triangle is large, so that slivers hardly count.
    along_u: [f64; 3],
    is_mirrored: bool,
}

/// `mesh`, whose normals are there, with tangents.
///
/// A vertex' tangent is the mean, by area, of those of its triangles that are mirrored alike; a vertex of both
/// kinds is doubled. Source: Lengyel, *Foundations of Game Engine Development* 2, 7.5, with the split that
/// MikkTSpace makes.
pub(crate) fn with_tangents(mut mesh: Mesh) -> Mesh {
    let of_triangles: Vec<_> = mesh.triangles.iter().map(|&triangle| tangent_of(&mesh, triangle)).collect();
    let vertices = mesh.positions.len();
    // Sums of unmirrored triangles, then of mirrored ones; `None` where a vertex has none.
    let mut sums = vec![[None; 2]; vertices];
    for (triangle, tangent) in mesh.triangles.iter().zip(&of_triangles) {
        let Some(tangent) = tangent else { continue };
        for &vertex in triangle {
            let sum = sums[vertex as usize][usize::from(tangent.is_mirrored)].get_or_insert([0.0; 3]);
            *sum = [0, 1, 2].map(|i| sum[i] + tangent.along_u[i]);
        }
    }
    let mut copied = Vec::new();
    let mut copy_of = vec![None; vertices];
    for (vertex, sums) in sums.iter().enumerate() {
        if sums.iter().all(Option::is_some) {
            copy_of[vertex] = Some((vertices + copied.len()) as u32);
            copied.push(vertex as u32);
        }
    }
    let frame_of = |vertex: usize, side: usize| {
        let handedness = if side == 1 { -1.0 } else { 1.0 };
        let frame =
            TangentFrame::new(wide(mesh.normals[vertex]), sums[vertex][side].unwrap_or([0.0; 3]), handedness);
        let [x, y, z] = frame.tangent;
        let is_mirrored = dot(cross(frame.normal, frame.tangent), frame.bitangent) < 0.0;
        [x as f32, y as f32, z as f32, if is_mirrored { -1.0 } else { 1.0 }]
    };
    let own = (0..vertices).map(|vertex| frame_of(vertex, usize::from(sums[vertex][0].is_none())));
    let tangents = own.chain(copied.iter().map(|&vertex| frame_of(vertex as usize, 1))).collect();
    for (triangle, tangent) in mesh.triangles.iter_mut().zip(&of_triangles) {
        if tangent.is_some_and(|tangent| tangent.is_mirrored) {
            *triangle = triangle.map(|vertex| copy_of[vertex as usize].unwrap_or(vertex));
        }
    }
    mesh.tangents = tangents;
    mesh.positions.extend(at(&mesh.positions, &copied));
    mesh.normals.extend(at(&mesh.normals, &copied));
    mesh.uv.extend(at(&mesh.uv, &copied));
    mesh.uv2.extend(at(&mesh.uv2, &copied));
    mesh
}

/// `None` where the triangle or its coordinates have no area.
fn tangent_of(mesh: &Mesh, triangle: [u32; 3]) -> Option<TriangleTangent> {
    if mesh.uv.is_empty() {
        return None;
    }
    let [a, b, c] = triangle.map(|vertex| wide(mesh.positions[vertex as usize]));
    let [ta, tb, tc] = triangle.map(|vertex| mesh.uv[vertex as usize].map(f64::from));
    let (e1, e2) = (difference(b, a), difference(c, a));
    // Upwards in the picture, against v.
    let (d1, d2) = ([tb[0] - ta[0], ta[1] - tb[1]], [tc[0] - ta[0], ta[1] - tc[1]]);
    let determinant = d1[0] * d2[1] - d1[1] * d2[0];
    let sides = |d: [f64; 2]| (d[0] * d[0] + d[1] * d[1]).sqrt();
    if determinant.is_nan() || determinant.abs() <= THINNEST * sides(d1) * sides(d2) {
        return None;
    }
    let combined = |f: f64, g: f64| [0, 1, 2].map(|i| (f * e1[i] + g * e2[i]) / determinant);
    let (along_u, upwards) = (combined(d2[1], -d1[1]), combined(-d2[0], d1[0]));
    let face = cross(e1, e2);
    // Told from the shading normals' side of the triangle: files wind triangles either way.
    let shading = triangle.map(|vertex| wide(mesh.normals[vertex as usize]));
    let shading = [0, 1, 2].map(|i| shading[0][i] + shading[1][i] + shading[2][i]);
    let side = if dot(face, shading) < 0.0 { -1.0 } else { 1.0 };
    let is_mirrored = side * dot(cross(face, along_u), upwards) < 0.0;
    Some(TriangleTangent { along_u: scaled(unit(along_u)?, length(face)), is_mirrored })
        .filter(|tangent| dot(tangent.along_u, tangent.along_u) > 0.0)
}
