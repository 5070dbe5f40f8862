//! Normals, tangents and meshes of several parts.

use relight_surface::{Mesh, SurfaceError, TangentFrame};

/// A strip along x of two squares that share the edge x = 0, in the plane through the x axis that rises by
/// `slope`; u grows towards that edge on both sides.
fn mirrored(slope: f32) -> Mesh {
    let column = |x: f32, u: f32| [([x, 0.0, 0.0], [u, 1.0]), ([x, 1.0, slope], [u, 0.0])];
    let vertices: Vec<_> = [column(-1.0, 0.0), column(0.0, 1.0), column(1.0, 0.0)].concat();
    let square = |a: u32| [[a, a + 2, a + 3], [a, a + 3, a + 1]];
    Mesh {
        positions: vertices.iter().map(|v| v.0).collect(),
        uv: vertices.iter().map(|v| v.1).collect(),
        triangles: [square(0), square(2)].concat(),
        ..Mesh::default()
    }
}

fn near<const N: usize>(a: [f32; N], b: [f32; N]) -> bool {
    (0..N).all(|i| (a[i] - b[i]).abs() < 1e-6)
}

#[test]
fn mirrored_coordinates_have_the_other_handedness_and_shared_vertices_are_doubled() {
    let mut mesh = mirrored(0.75);
    let normal = [0.0, -0.6, 0.8];
    mesh.normals = vec![normal; 6];
    let done = mesh.completed().unwrap();
    assert_eq!(done.positions.len(), 8);
    for (triangle, corners) in done.triangles.iter().enumerate() {
        let (along, handedness) = if triangle < 2 { (1.0, 1.0) } else { (-1.0, -1.0) };
        for &vertex in corners {
            let vertex = vertex as usize;
            assert!(
                near(done.tangents[vertex], [along, 0.0, 0.0, handedness]),
                "{triangle}: {:?}",
                done.tangents[vertex]
            );
            assert_eq!(done.normals[vertex], normal);
            // The top of the picture is up the slope on both sides.
            let [x, y, z, h] = done.tangents[vertex].map(f64::from);
            let frame = TangentFrame::new(normal.map(f64::from), [x, y, z], h);
            assert!(near(frame.bitangent.map(|c| c as f32), [0.0, 0.8, 0.6]), "{frame:?}");
        }
    }
    // Positions and coordinates of each corner are what they were.
    let before = mirrored(0.75);
    for (a, b) in before.triangles.iter().flatten().zip(done.triangles.iter().flatten()) {
        assert_eq!(before.positions[*a as usize], done.positions[*b as usize]);
        assert_eq!(before.uv[*a as usize], done.uv[*b as usize]);
    }
}

#[test]
fn winding_does_not_matter_where_normals_are_given() {
    let mut mesh = mirrored(0.0);
    mesh.normals = vec![[0.0, 0.0, 1.0]; 6];
    let expected = mesh.clone().completed().unwrap();
    mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(0, 2));
    assert_eq!(mesh.completed().unwrap().tangents, expected.tangents);
}

#[test]
fn missing_normals_are_the_triangles_own() {
    let mut mesh = mirrored(0.75);
    // A fold, tangents that can't be believed, and a triangle without area.
    mesh.positions[4][2] = 1.0;
    mesh.tangents = vec![[9.0; 4]; 6];
    mesh.triangles.push([0, 1, 1]);
    let done = mesh.completed().unwrap();
    assert_eq!(done.positions.len(), 15);
    assert!((0..6).all(|v| near(done.normals[v], [0.0, -0.6, 0.8])));
    assert!((0..6).all(|v| near(done.tangents[v], [1.0, 0.0, 0.0, 1.0])));
    assert!(!near(done.normals[6], [0.0, -0.6, 0.8]));
    assert_eq!(done.normals[12], [0.0, 0.0, 1.0]);
}

#[test]
fn coordinates_that_say_nothing_leave_a_frame_around_the_normal() {
    for uv in [
        vec![],
        vec![[0.5, 0.5]; 6],
        // All on a line, up to rounding.
        (0..6).map(|i| [0.1 * i as f32, 0.3 * i as f32]).collect(),
    ] {
        let mut mesh = mirrored(0.75);
        mesh.uv = uv;
        mesh.normals = vec![[0.0, -0.6, 0.8]; 6];
        let done = mesh.completed().unwrap();
        let [x, y, z] =
            TangentFrame::around([0.0, f64::from(-0.6f32), f64::from(0.8f32)]).tangent.map(|c| c as f32);
        assert_eq!(done.positions.len(), 6);
        for tangent in &done.tangents {
            assert!(near(*tangent, [x, y, z, 1.0]), "{tangent:?}");
        }
    }
    // Beside a triangle that says something, a degenerate one is overruled.
    let mut mesh = mirrored(0.0);
    mesh.normals = vec![[0.0, 0.0, 1.0]; 6];
    mesh.triangles.push([0, 1, 0]);
    let done = mesh.completed().unwrap();
    assert!(near(done.tangents[0], [1.0, 0.0, 0.0, 1.0]));
}

#[test]
fn parts_are_joined_with_the_coordinates_that_they_have() {
    let mut first = mirrored(0.0);
    first.normals = vec![[0.0, 0.0, 1.0]; 6];
    let mut second = first.clone();
    second.uv2 = second.uv.iter().map(|[u, v]| [0.5 * u, 0.25 * v]).collect();
    let mut third = second.clone();
    third.uv.clear();
    let empty = Mesh { triangles: vec![], ..first.clone() };
    let joined = Mesh::joined(vec![first.clone(), empty, second.clone(), third]).unwrap();
    assert_eq!(joined.triangles.len(), 12);
    assert_eq!(joined.triangles[4], first.clone().completed().unwrap().triangles[0].map(|v| v + 8));
    let corner = joined.triangles[6][0] as usize;
    let [u, v] = joined.uv[corner];
    assert_eq!(joined.uv2[corner], [0.5 * u, 0.25 * v]);
    let corner = joined.triangles[0][1] as usize;
    assert_eq!(joined.uv2[corner], joined.uv[corner]);
    let corner = joined.triangles[9][0] as usize;
    assert_eq!(joined.uv[corner], [0.0; 2]);
    assert!(joined.uv2[corner] != [0.0; 2]);
    assert_eq!(Mesh::joined(vec![]), Err(SurfaceError::NoTriangles));
}
