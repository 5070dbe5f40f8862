//! Pixels against rays.

use crate::{Noise, same_with_any_threads};
use relight_core::{Camera, Projection};
use relight_surface::{Fragment, Mesh, SurfaceError, chart_coverage, rasterize};

fn camera(projection: Projection, eye: [f64; 3], target: [f64; 3]) -> Camera {
    Camera::new(projection, (61, 47), eye, target, [0.0, 0.1, 1.0]).unwrap()
}

fn mesh_of(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { positions, triangles, ..Mesh::default() }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn point_of(mesh: &Mesh, fragment: &Fragment) -> [f64; 3] {
    let corners =
        mesh.triangles[fragment.triangle as usize].map(|v| mesh.positions[v as usize].map(f64::from));
    [0, 1, 2].map(|i| (0..3).map(|k| f64::from(fragment.weights[k]) * corners[k][i]).sum())
}

/// Moeller and Trumbore: distance along the ray and the least barycentric coordinate.
fn hit(mesh: &Mesh, triangle: usize, origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, f64)> {
    let [a, b, c] = mesh.triangles[triangle].map(|v| mesh.positions[v as usize].map(f64::from));
    let (e1, e2) = (minus(b, a), minus(c, a));
    let p = cross(direction, e2);
    let determinant = dot(e1, p);
    if determinant == 0.0 {
        return None;
    }
    let s = minus(origin, a);
    let u = dot(s, p) / determinant;
    let q = cross(s, e1);
    let v = dot(direction, q) / determinant;
    Some((dot(e2, q) / determinant, u.min(v).min(1.0 - u - v)))
}

#[test]
fn every_pixel_sees_the_nearest_triangle_that_its_ray_meets() {
    let mut noise = Noise(41);
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..160u32 {
        let middle = [0; 3].map(|_| 6.0 * noise.next() - 3.0);
        // Some reach far behind the eye, some have no area.
        let size = if i % 8 == 0 { 12.0 } else { 1.5 };
        let corner = |noise: &mut Noise| middle.map(|c| (c + size * (noise.next() - 0.5)) as f32);
        let (a, b, c) = (corner(&mut noise), corner(&mut noise), corner(&mut noise));
        let thin = [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
        positions.extend(if i % 20 == 19 { [a, b, thin] } else { [a, b, c] });
        triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        if i % 20 == 18 {
            triangles.push([3 * i, 3 * i + 1, 3 * i]);
        }
    }
    let mesh = mesh_of(positions, triangles);
    let perspective = Projection::Perspective { fov_x: 1.2 };
    let cameras = [
        camera(perspective, [0.3, -4.0, 0.5], [0.0; 3]),
        // In the midst of them.
        camera(perspective, [0.2, 0.1, -0.3], [1.0, 0.4, 0.2]),
        camera(Projection::Perspective { fov_x: 3.1 }, [0.0, -1.0, 0.4], [0.1, 0.0, 0.0]),
        camera(Projection::Orthographic { width: 5.0 }, [-0.4, 0.3, 0.1], [0.5, 1.0, 0.0]),
    ];
    let mut seen = 0;
    for camera in cameras {
        let fragments = same_with_any_threads(|| rasterize(&mesh, &camera).unwrap());
        for (i, fragment) in fragments.fragments.iter().enumerate() {
            let (x, y) = ((i % 61) as f64 + 0.5, (i / 61) as f64 + 0.5);
            let ray = camera.ray(x, y);
            let ahead = (0..mesh.triangles.len()).filter_map(|triangle| {
                let (distance, inner) = hit(&mesh, triangle, ray.origin, ray.direction)?;
                (distance > 0.0 && inner >= -1e-9).then_some((distance, inner, triangle))
            });
            let mut ahead: Vec<_> = ahead.collect();
            ahead.sort_by(|a, b| a.0.total_cmp(&b.0));
            // A ray on an edge may count either way.
            if ahead.iter().any(|(_, inner, _)| *inner < 1e-9) {
                continue;
            }
            let expected = ahead.first().map_or(Fragment::NOTHING, |nearest| nearest.2 as u32);
            assert_eq!(fragment.triangle, expected, "pixel {x} {y} of {camera:?}");
            if fragment.triangle != Fragment::NOTHING {
                seen += 1;
                let point = point_of(&mesh, fragment);
                let along = minus(point, ray.origin);
                let beside = minus(along, ray.direction.map(|c| c * dot(along, ray.direction)));
                // The weights are f32.
                assert!(dot(beside, beside).sqrt() < 2e-6, "pixel {x} {y} of {camera:?}");
            }
        }
    }
    assert!(seen > 4000, "{seen}");
}

#[test]
fn a_floor_that_reaches_behind_the_eye_ends_at_the_horizon() {
    let far = 1e6;
    let mesh = mesh_of(
        vec![[-far, -far, 0.0], [far, -far, 0.0], [far, far, 0.0], [-far, far, 0.0]],
        vec![[0, 1, 2], [0, 2, 3]],
    );
    let camera = camera(Projection::Perspective { fov_x: 1.5 }, [0.0, 0.0, 1.5], [0.3, 5.0, 1.3]);
    let fragments = rasterize(&mesh, &camera).unwrap();
    for (i, fragment) in fragments.fragments.iter().enumerate() {
        let ray = camera.ray((i % 61) as f64 + 0.5, (i / 61) as f64 + 0.5);
        let is_floor = ray.direction[2] < -1e-5;
        assert_eq!(fragment.triangle != Fragment::NOTHING, is_floor, "pixel {i}");
    }
}

#[test]
fn triangles_with_shared_edges_cover_every_pixel_once() {
    // Corners on pixel centres, on their corners and anywhere; every split and winding.
    for seed in 0..40 {
        let mut noise = Noise(1000 + seed);
        let place = |noise: &mut Noise, at: usize| match seed % 3 {
            0 => at as f32 * 4.0,
            1 => at as f32 * 4.0 + 0.5 + (noise.next() * 3.0).floor() as f32,
            _ => at as f32 * 4.0 + (noise.next() * 2.0) as f32,
        };
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for j in 0..6 {
            for i in 0..7 {
                positions.push([place(&mut noise, i), place(&mut noise, j), 0.2 * noise.next() as f32]);
            }
        }
        for j in 0..5 {
            for i in 0..6 {
                let [a, b, c, d] = [0, 1, 8, 7].map(|step| (7 * j + i + step) as u32);
                let halves = if noise.next() < 0.5 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                triangles
                    .extend(halves.map(|[p, q, r]| if noise.next() < 0.5 { [q, p, r] } else { [p, q, r] }));
            }
        }
        let mesh = mesh_of(positions, triangles);
        for projection in [Projection::Orthographic { width: 32.0 }, Projection::Perspective { fov_x: 1.0 }] {
            let mut camera =
                Camera::new(projection, (32, 30), [12.0, 10.0, 30.0], [12.0, 10.0, 0.0], [0.0, 1.0, 0.0])
                    .unwrap();
            if seed % 2 == 1 && matches!(projection, Projection::Perspective { .. }) {
                camera =
                    Camera::new(projection, (32, 30), [10.0, 2.0, 14.0], [12.0, 10.0, 0.0], [0.0, 1.0, 0.0])
                        .unwrap();
            }
            let mut count = vec![0; 32 * 30];
            for triangle in &mesh.triangles {
                let one = mesh_of(mesh.positions.clone(), vec![*triangle]);
                for (count, fragment) in count.iter_mut().zip(&rasterize(&one, &camera).unwrap().fragments) {
                    *count += usize::from(fragment.triangle == 0);
                }
            }
            let whole = rasterize(&mesh, &camera).unwrap();
            let mut covered = 0;
            for (i, (count, fragment)) in count.iter().zip(&whole.fragments).enumerate() {
                let ray = camera.ray((i % 32) as f64 + 0.5, (i / 32) as f64 + 0.5);
                // Seen well inside the outline, at the height of the grid's middle.
                let distance = (0.1 - ray.origin[2]) / ray.direction[2];
                let [x, y] = [0, 1].map(|k| ray.origin[k] + distance * ray.direction[k]);
                let is_inside = (2.9..23.1).contains(&x) && (2.9..19.1).contains(&y);
                assert!(*count <= 1 || !is_inside, "seed {seed}: pixel {i} is drawn {count} times");
                assert!(*count >= 1 || !is_inside, "seed {seed}: pixel {i} is missed");
                assert_eq!(*count > 0, fragment.triangle != Fragment::NOTHING);
                covered += usize::from(is_inside);
            }
            assert!(covered > 100, "{covered}");
        }
    }
}

#[test]
fn of_equally_near_triangles_the_first_is_seen_from_both_sides() {
    let square = vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let mesh = mesh_of(square, vec![[0, 2, 1], [0, 2, 1], [0, 2, 3], [0, 2, 3]]);
    for height in [3.0, -3.0] {
        let camera = Camera::new(
            Projection::Orthographic { width: 1.9 },
            (20, 20),
            [0.0, 0.0, height],
            [0.0; 3],
            [0.0, 1.0, 0.0],
        )
        .unwrap();
        let fragments = rasterize(&mesh, &camera).unwrap().fragments;
        assert!(fragments.iter().all(|f| f.triangle == 0 || f.triangle == 2), "from {height}");
        assert!((0..=2).step_by(2).all(|t| fragments.iter().any(|f| f.triangle == t)));
    }
}

#[test]
fn charts_cover_the_texels_whose_centres_they_hold() {
    // Texels 1 to 4 of 10 in x, 2 to 5 of 8 in y, and a triangle without area.
    let uv2 = vec![[0.1, 0.25], [0.4, 0.25], [0.4, 0.625], [0.1, 0.625]];
    let mut mesh = mesh_of(vec![[0.0; 3]; 4], vec![[0, 1, 2], [0, 3, 2], [0, 1, 1]]);
    assert!(matches!(chart_coverage(&mesh, 10, 8), Err(SurfaceError::Missing { .. })));
    mesh.uv = vec![[9.0, -3.0]; 4];
    mesh.uv2 = uv2;
    let covered = chart_coverage(&mesh, 10, 8).unwrap();
    for (i, covered) in covered.iter().enumerate() {
        assert_eq!(*covered, (1..4).contains(&(i % 10)) && (2..5).contains(&(i / 10)), "texel {i}");
    }
    // Edges through centres: those at the left and the upper edge belong to the chart. In sixteenths, which are exact.
    mesh.uv2 = [[1.5, 2.5], [4.5, 2.5], [4.5, 5.5], [1.5, 5.5]].map(|place| place.map(|c| c / 16.0)).to_vec();
    for (i, covered) in chart_coverage(&mesh, 16, 16).unwrap().iter().enumerate() {
        assert_eq!(*covered, (1..4).contains(&(i % 16)) && (2..5).contains(&(i / 16)), "texel {i}");
    }
}

#[test]
fn meshes_at_fault_and_panoramic_cameras_are_refused() {
    let camera = camera(Projection::Perspective { fov_x: 1.0 }, [0.0, -3.0, 0.0], [0.0; 3]);
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let refused = |mesh: &Mesh| rasterize(mesh, &camera).unwrap_err().to_string();
    assert!(refused(&mesh_of(corners.clone(), vec![])).contains("no triangle"));
    assert!(
        refused(&mesh_of(corners.clone(), vec![[0, 1, 2], [2, 1, 3]]))
            .contains("triangle 1 names vertex 3 of 3")
    );
    let mut uneven = mesh_of(corners.clone(), vec![[0, 1, 2]]);
    uneven.uv = vec![[0.0; 2]; 2];
    assert!(refused(&uneven).contains("2 texture coordinates for 3 vertices"));
    uneven.uv = vec![[0.0, 0.0], [0.0, f32::NAN], [0.0, 0.0]];
    assert!(refused(&uneven).contains("texture coordinates of vertex 1"));
    let panorama = Camera { projection: Projection::Equirectangular { latitude: 1.0 }, ..camera };
    let mesh = mesh_of(corners, vec![[0, 1, 2]]);
    assert_eq!(rasterize(&mesh, &panorama), Err(SurfaceError::PanoramicCamera));
}
