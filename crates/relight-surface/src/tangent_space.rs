//! Relighting maps in the tangent space of a mesh.

use crate::draw::{drawn, interpolated};
use crate::rasterizer::Fragment;
use crate::{DrawSettings, Mesh, SurfaceError, TangentFrame};
use relight_core::relighter::{DirectionalLight, Picture};
use relight_core::texture_lookup::{Taps, bilinear_taps};
use relight_core::vectors::{cross, difference, dot, length, scaled, wide};
use relight_core::{
    Camera, Direction, PlaneRole, Projection, RelightingMap, RelightingMaps, Space, Texels, linear_from_srgb,
};

/// How far below the horizon light reaches, as the sine of that angle.
pub const DROP_OFF: f64 = 0.1;

/// A light on a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeshLight {
    /// From infinitely far, in the world's axes; (1, 1, 1) is the capture's own light.
    Directional(DirectionalLight),
    /// From a point, falling off with the square of the distance.
    Point {
        /// In the world's axes.
        position: [f64; 3],
        /// Linear R, G, B at distance 1.
        color: [f32; 3],
        /// Nearer than this, above 0, it is as bright as there; at 0 distance it has no direction and lights nothing.
        least_distance: f64,
    },
}

/// How much of a light remains whose cosine with the normal is `cosine`: all above the horizon, nothing from
/// [`DROP_OFF`] below it, smoothstep between.
///
/// Source: the 1-D texture of Gelb and Malzbender, *Image-Based Lighting for Games*, HPL-2004-225, listing 1, which
/// leaves its values open. Ours changes nothing above the horizon, where the map knows the surface's own shading.
pub fn drop_off(cosine: f64) -> f64 {
    let t = (1.0 + cosine / DROP_OFF).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// `mesh` with `maps` in its tangent space as `camera` sees it: linear light, R, G, B.
///
/// At each sample every light is turned into the frame of tangent, bitangent and normal, the basis
/// evaluated there, and the coefficients, read bilinearly at the texture coordinates, summed: interpolating
/// coefficients is interpolating pictures, because the sum is linear. A light below the horizon is taken from the
/// horizon and fades by [`drop_off`]. Triangles seen from behind have their normal turned round. Encoded maps are decoded
/// before lights add up; negative light is kept. Source: as [`drop_off`], with any basis in the place of the polynomial.
///
/// # Errors
/// [`SurfaceError`] for a mesh that is at fault or lacks coordinates, normals or tangents
/// ([`Mesh::completed`] makes those), a panoramic camera and samples out of range.
///
/// # Panics
/// When a plane has not as many texels as the size of the maps says.
pub fn draw_tangent_space(
    mesh: &Mesh,
    camera: &Camera,
    maps: &RelightingMaps,
    lights: &[MeshLight],
    settings: &DrawSettings,
) -> Result<Picture, SurfaceError> {
    let coordinates = mesh.texture_coordinates()?;
    for (name, count) in [("normals", mesh.normals.len()), ("tangents", mesh.tangents.len())] {
        if count == 0 {
            return Err(SurfaceError::Missing { name, remedy: "complete it first" });
        }
    }
    let roles = maps.model.roles();
    let scratch =
        || Scratch { coefficients: vec![0.0; roles.len()], functions: vec![0.0; maps.model.basis.count()] };
    drawn(mesh, camera, settings, scratch, |fragment, scratch| {
        let corners = mesh.triangles[fragment.triangle as usize];
        let point = interpolated(&mesh.positions, corners, fragment);
        let frame = frame_at(mesh, camera, corners, fragment, point);
        let place = interpolated(coordinates, corners, fragment);
        let taps = bilinear_taps(maps.width, maps.height, settings.wrap, place);
        for (coefficient, plane) in scratch.coefficients.iter_mut().zip(&maps.planes) {
            *coefficient = coefficient_between(plane, &taps);
        }
        let mut total = [0.0; 3];
        for light in lights {
            let Some((direction, color)) = incident(light, point) else { continue };
            let local = frame.coordinates(direction);
            let remaining = drop_off(local[2]) as f32;
            let Some(above) = above_horizon(local).filter(|_| remaining > 0.0) else { continue };
            let relit = relit(maps, &roles, scratch, above);
            for channel in 0..3 {
                total[channel] += color[channel] * remaining * relit[channel];
            }
        }
        total
    })
}

/// The frame of a sample, its normal on the side that is seen.
fn frame_at(
    mesh: &Mesh,
    camera: &Camera,
    corners: [u32; 3],
    fragment: &Fragment,
    point: [f64; 3],
) -> TangentFrame {
    let normal = interpolated(&mesh.normals, corners, fragment);
    let [x, y, z, handedness] = interpolated(&mesh.tangents, corners, fragment);
    let frame = TangentFrame::new(normal, [x, y, z], handedness);
    let [a, b, c] = corners.map(|vertex| wide(mesh.positions[vertex as usize]));
    let face = cross(difference(b, a), difference(c, a));
    let from_eye = match camera.projection {
        Projection::Orthographic { .. } => camera.forward,
        _ => difference(point, camera.eye),
    };
    // By the face, on the normals' side: shading normals alone would turn at silhouettes.
    if dot(face, frame.normal) * dot(face, from_eye) > 0.0 {
        return TangentFrame { normal: scaled(frame.normal, -1.0), ..frame };
    }
    frame
}

/// Unit vector from `point` to the light and its colour there; `None` at the light itself.
fn incident(light: &MeshLight, point: [f64; 3]) -> Option<([f64; 3], [f32; 3])> {
    match *light {
        MeshLight::Directional(DirectionalLight { direction, color }) => {
            Some((direction.components(), color))
        }
        MeshLight::Point { position, color, least_distance } => {
            let [x, y, z] = difference(position, point);
            let direction = Direction::new(x, y, z).ok()?;
            let distance = length([x, y, z]).max(least_distance);
            let factor = (1.0 / (distance * distance)) as f32;
            Some((direction.components(), color.map(|c| c * factor)))
        }
    }
}

/// A direction of a frame, from the horizon where it is below; `None` straight below.
fn above_horizon([x, y, z]: [f64; 3]) -> Option<Direction> {
    Direction::new(x, y, z.max(0.0)).ok()
}

/// What a sample needs of its own: a value a plane, and one a function of light.
struct Scratch {
    coefficients: Vec<f32>,
    functions: Vec<f64>,
}

/// A plane's coefficient between its texels: codes are blended and then scaled, as samplers do it.
fn coefficient_between(plane: &RelightingMap, taps: &Taps) -> f32 {
    let blended = match &plane.texels {
        Texels::U8(codes) => blended(taps, |texel| f32::from(codes[texel])) / 255.0,
        Texels::F16(codes) => blended(taps, |texel| codes[texel].to_f32()),
        Texels::F32(codes) => blended(taps, |texel| codes[texel]),
    };
    plane.scale * blended + plane.bias
}

fn blended(taps: &Taps, code: impl Fn(usize) -> f32) -> f32 {
    let value = |tap: usize| taps.weights[tap] * code(taps.texels[tap]);
    value(0) + value(1) + value(2) + value(3)
}

/// R, G, B in linear light under a light of `direction`; grey maps have the same in all.
fn relit(
    maps: &RelightingMaps,
    roles: &[PlaneRole],
    scratch: &mut Scratch,
    direction: Direction,
) -> [f32; 3] {
    let Scratch { coefficients, functions } = scratch;
    maps.model.basis.evaluate(direction, functions);
    let mean = |function: Option<u16>| function.map_or(0.0, |f| functions[usize::from(f)] as f32);
    let (mut sums, mut factors) = (maps.model.mean_functions().map(mean), [1.0f32; 3]);
    for (role, &coefficient) in roles.iter().zip(coefficients.iter()) {
        match *role {
            PlaneRole::Coefficient { functions: by_channel } => {
                for (sum, function) in sums.iter_mut().zip(by_channel) {
                    *sum += function.map_or(0.0, |f| functions[usize::from(f)] as f32 * coefficient);
                }
            }
            PlaneRole::BaseColor { channel } => factors[usize::from(channel)] = coefficient,
        }
    }
    if maps.model.channels() == 1 {
        sums = [sums[0]; 3];
    }
    [0, 1, 2].map(|channel| {
        let value = sums[channel] * factors[channel];
        match maps.model.space {
            Space::Encoded => linear_from_srgb(value),
            Space::Linear => value,
        }
    })
}
