//! Relighting maps on meshes against the relighter.

use crate::{Noise, same_with_any_threads};
use relight_core::relighter::{DirectionalLight, Picture, relight, relight_linear};
use relight_core::{
    Basis, Camera, CpuLevel, Design, Direction, Family, Layout, LightSet, Model, Projection, RelightingMap,
    RelightingMaps, Space, Texels, Wrap,
};
use relight_surface::{DROP_OFF, DrawSettings, Mesh, MeshLight, SurfaceError, draw_tangent_space, drop_off};

const WIDTH: usize = 12;
const HEIGHT: usize = 10;
const PLAIN: DrawSettings = DrawSettings { supersampling: 1, background: [0.0; 3], wrap: Wrap::Clamp };

/// An asset without two equal coefficients, light at every direction above the horizon.
fn asset(layout: Layout, space: Space, family: &str, count: usize) -> RelightingMaps {
    let lights = LightSet::from_directions(
        (0..30).map(|i| direction(f64::from(i) * 2.4, 0.05 * f64::from(i))).collect(),
    );
    let basis: Basis = Family::by_name(family).unwrap().build(&Design::new(count, &lights)).unwrap();
    let model = Model { basis, layout, space, lights: Vec::new(), figures: None, provenance: None };
    let mut noise = Noise(3);
    let constant =
        if layout == Layout::Rgb { 3 * (count - 1)..3 * count } else { count - 1..model.plane_count() };
    let planes = (0..model.plane_count()).map(|plane| RelightingMap {
        scale: 0.3,
        // The constant term of the polynomial keeps pixels above 0.
        bias: if constant.contains(&plane) { 0.9 } else { -0.15 },
        texels: Texels::F32((0..WIDTH * HEIGHT).map(|_| noise.next() as f32).collect()),
    });
    RelightingMaps { width: WIDTH, height: HEIGHT, planes: planes.collect(), model }
}

fn direction(azimuth: f64, elevation: f64) -> Direction {
    Direction::from_azimuth_elevation(azimuth, elevation).unwrap()
}

fn white(direction: Direction) -> DirectionalLight {
    DirectionalLight { direction, color: [1.0; 3] }
}

/// Axes of a world that is turned against the picture.
const RIGHT: [f64; 3] = [0.8, 0.0, -0.6];
const TOP: [f64; 3] = [0.36, 0.8, 0.48];
const OUT: [f64; 3] = [0.48, -0.6, 0.64];

fn combined([x, y, z]: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| x * RIGHT[i] + y * TOP[i] + z * OUT[i])
}

/// The asset on a rectangle of a pixel a unit; `mirror` lets u grow to the left.
fn board(mirror: bool) -> Mesh {
    let (w, h) = (WIDTH as f64, HEIGHT as f64);
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
    let u = |x: f64| if mirror { 1.0 - x / w } else { x / w };
    Mesh {
        positions: corners.map(|[x, y]| combined([x, y, 0.0]).map(|c| c as f32)).to_vec(),
        normals: vec![OUT.map(|c| c as f32); 4],
        uv: corners.map(|[x, y]| [u(x) as f32, (1.0 - y / h) as f32]).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
    .completed()
    .unwrap()
}

/// Sees the board's pixels one to one, from its front or from behind.
fn camera(side: f64) -> Camera {
    let middle = [0.5 * WIDTH as f64, 0.5 * HEIGHT as f64];
    let eye = combined([middle[0], middle[1], 7.0 * side]);
    let projection = Projection::Orthographic { width: WIDTH as f64 };
    Camera::new(projection, (WIDTH, HEIGHT), eye, combined([middle[0], middle[1], 0.0]), TOP).unwrap()
}

/// `light` of the board's axes, in those of the world.
fn in_world(light: DirectionalLight) -> MeshLight {
    let [x, y, z] = combined(light.direction.components());
    MeshLight::Directional(DirectionalLight { direction: Direction::new(x, y, z).unwrap(), ..light })
}

/// R, G, B from one channel or three, from left to right or the other way.
fn rgb(picture: &Picture, flipped: bool) -> Vec<f32> {
    let c = picture.channels;
    let pixel = |i: usize| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        let x = if flipped { WIDTH - 1 - x } else { x };
        let samples = &picture.samples[c * (y * WIDTH + x)..][..c];
        [0, 1, 2].map(|channel: usize| samples[channel.min(c - 1)])
    };
    (0..WIDTH * HEIGHT).flat_map(pixel).collect()
}

#[track_caller]
fn assert_near(found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "sample {i}: {a} where {b} was expected");
    }
}

#[test]
fn a_board_seen_from_the_front_is_the_relit_picture() {
    let lights = [
        DirectionalLight { direction: direction(0.7, 0.9), color: [1.0, 0.5, 0.2] },
        DirectionalLight { direction: direction(-2.0, 0.4), color: [0.3, 0.6, 1.1] },
    ];
    for (family, count) in [("ptm", 6), ("sh", 4)] {
        for layout in [Layout::Rgb, Layout::Lrgb, Layout::Grey] {
            for space in [Space::Linear, Space::Encoded] {
                let maps = asset(layout, space, family, count);
                let expected = relight_linear(&maps, &lights, CpuLevel::BASELINE);
                let found = same_with_any_threads(|| {
                    draw_tangent_space(&board(false), &camera(1.0), &maps, &lights.map(in_world), &PLAIN)
                        .unwrap()
                });
                assert_near(&found.samples, &rgb(&expected, false), 2e-5);
            }
        }
    }
}

#[test]
fn a_mirrored_board_under_the_mirrored_light_is_the_mirrored_picture() {
    let maps = asset(Layout::Rgb, Space::Linear, "ptm", 10);
    for (azimuth, elevation) in [(0.3, 0.5), (2.5, 0.2), (-1.0, 1.2)] {
        let light = direction(azimuth, elevation);
        let [x, y, z] = light.components();
        let relit = relight(&maps, light, CpuLevel::BASELINE);
        let mirrored = white(Direction::new(-x, y, z).unwrap());
        let found =
            draw_tangent_space(&board(true), &camera(1.0), &maps, &[in_world(mirrored)], &PLAIN).unwrap();
        assert_near(&found.samples, &rgb(&relit, true), 2e-5);
        let wrong =
            draw_tangent_space(&board(true), &camera(1.0), &maps, &[in_world(white(light))], &PLAIN).unwrap();
        assert!(wrong.samples.iter().zip(rgb(&relit, true)).any(|(a, b)| (a - b).abs() > 0.02));
    }
}

#[test]
fn a_board_seen_from_behind_is_lit_from_behind() {
    let maps = asset(Layout::Rgb, Space::Linear, "ptm", 6);
    let light = direction(0.4, 0.6);
    let [x, y, z] = light.components();
    let behind = [in_world(white(Direction::new(x, y, -z).unwrap()))];
    let found = draw_tangent_space(&board(false), &camera(-1.0), &maps, &behind, &PLAIN).unwrap();
    assert_near(&found.samples, &rgb(&relight(&maps, light, CpuLevel::BASELINE), true), 2e-5);
    let in_front = [in_world(white(light))];
    let dark = draw_tangent_space(&board(false), &camera(-1.0), &maps, &in_front, &PLAIN).unwrap();
    assert!(dark.samples.iter().all(|v| *v == 0.0));
}

#[test]
fn light_below_the_horizon_fades_from_the_value_at_the_horizon() {
    let maps = asset(Layout::Grey, Space::Linear, "ptm", 6);
    let horizon = relight(&maps, direction(1.1, 0.0), CpuLevel::BASELINE);
    for (elevation, factor) in
        [(0.0, 1.0), (-0.5 * DROP_OFF, 0.5), (-DROP_OFF, 0.0), (-0.5, 0.0), (-1.0, 0.0)]
    {
        let light = in_world(white(direction(1.1, libm::asin(elevation))));
        let found = draw_tangent_space(&board(false), &camera(1.0), &maps, &[light], &PLAIN).unwrap();
        let expected: Vec<f32> = rgb(&horizon, false).iter().map(|v| v * factor).collect();
        assert_near(&found.samples, &expected, 2e-5);
    }
    assert_eq!([1.0, 1e-9, 0.0].map(drop_off), [1.0; 3]);
    assert_eq!([-DROP_OFF, -1.0].map(drop_off), [0.0; 2]);
    let steps: Vec<f64> = (0..=100).map(|i| drop_off(-DROP_OFF * f64::from(i) / 100.0)).collect();
    assert!(steps.windows(2).all(|pair| pair[1] < pair[0] && pair[0] - pair[1] < 0.016));
}

#[test]
fn point_lights_fall_off_with_the_square_of_the_distance_and_turn_with_the_place() {
    let maps = asset(Layout::Rgb, Space::Linear, "ptm", 6);
    let (place, color) = ([3.5, 4.5, 2.5], [3.0f32, 5.0, 7.0]);
    let light = MeshLight::Point { position: combined(place), color, least_distance: 1e-3 };
    let found = draw_tangent_space(&board(false), &camera(1.0), &maps, &[light], &PLAIN).unwrap();
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let to = [place[0] - x as f64 - 0.5, place[1] - (HEIGHT - y) as f64 + 0.5, place[2]];
            let square = to.iter().map(|c| c * c).sum::<f64>();
            let relit = relight(&maps, Direction::new(to[0], to[1], to[2]).unwrap(), CpuLevel::BASELINE);
            for (c, color) in color.iter().enumerate() {
                let at = 3 * (y * WIDTH + x) + c;
                let expected = relit.samples[at] * color / square as f32;
                assert!((found.samples[at] - expected).abs() < 1e-4 * expected.max(1.0), "{x} {y} {c}");
            }
        }
    }
    // Nearer than the least distance it is no brighter; a pixel further it is beyond it.
    let near = MeshLight::Point { position: combined([3.5, 4.5, 0.25]), color, least_distance: 0.5 };
    let found = draw_tangent_space(&board(false), &camera(1.0), &maps, &[near], &PLAIN).unwrap();
    for (x, to, square) in [(3, [0.0, 0.0, 0.25], 0.25), (4, [-1.0, 0.0, 0.25], 1.0625)] {
        let relit = relight(&maps, Direction::new(to[0], to[1], to[2]).unwrap(), CpuLevel::BASELINE);
        let at = 3 * (5 * WIDTH + x);
        assert!((found.samples[at] - relit.samples[at] * color[0] / square).abs() < 1e-4, "{x}");
    }
    // In the surface itself: on a pixel's centre it has no direction there, and all else sees it at the horizon.
    let inside = MeshLight::Point { position: combined([3.5, 4.5, 0.0]), color, least_distance: 0.5 };
    let found = draw_tangent_space(&board(false), &camera(1.0), &maps, &[inside], &PLAIN).unwrap();
    assert!(found.samples.iter().all(|v| v.is_finite()));
    let far = MeshLight::Point { position: combined([3.0, 1e6, 1e6]), color: [2e12; 3], least_distance: 0.5 };
    let found = draw_tangent_space(&board(false), &camera(1.0), &maps, &[far], &PLAIN).unwrap();
    let at_infinity = relight(
        &maps,
        direction(std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_4),
        CpuLevel::BASELINE,
    );
    assert_near(&found.samples, &rgb(&at_infinity, false), 1e-4);
}

#[test]
fn degenerate_tangents_and_normals_are_no_nan_and_missing_ones_are_named() {
    let maps = asset(Layout::Rgb, Space::Linear, "ptm", 6);
    let light = [in_world(white(direction(0.0, 0.8)))];
    for tangent in [[0.0; 4], [OUT[0] as f32, OUT[1] as f32, OUT[2] as f32, 1.0], [1e-30, 0.0, 0.0, -1.0]] {
        let mut mesh = board(false);
        mesh.tangents = vec![tangent; 4];
        mesh.normals[2] = [0.0; 3];
        let found = draw_tangent_space(&mesh, &camera(1.0), &maps, &light, &PLAIN).unwrap();
        assert!(found.samples.iter().all(|v| v.is_finite()) && found.samples.iter().any(|v| *v > 0.1));
    }
    let bare = Mesh { tangents: vec![], ..board(false) };
    let refused = draw_tangent_space(&bare, &camera(1.0), &maps, &light, &PLAIN);
    assert!(matches!(refused, Err(SurfaceError::Missing { name: "tangents", .. })));
}
