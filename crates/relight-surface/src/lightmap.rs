//! Variable lightmaps: a relit texture times the surface's own colour.

use crate::draw::{drawn, interpolated};
use crate::{DrawSettings, Mesh, SurfaceError};
use relight_core::relighter::Picture;
use relight_core::texture_lookup::{bilinear_taps, color_at};
use relight_core::{Camera, Wrap};

/// The surface's own colour, in linear light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Albedo<'a> {
    /// The same everywhere.
    Constant([f32; 3]),
    /// A texture at the mesh's texture coordinates.
    Texture(&'a Picture),
}

/// `mesh` under its lightmap as `camera` sees it: linear light, R, G, B.
///
/// `relit` is the lightmap under the lights of the moment, in linear light, read bilinearly at the mesh's
/// second coordinates (its first where it has one set) and ending at its edges; have its charts carried beyond their
/// edges by [`crate::dilate`], or seams show. Source: Wong et al., *Lighting Precomputation Using the
/// Relighting Map*, "The Variable Lightmap".
///
/// # Errors
/// [`SurfaceError`] for a mesh that is at fault or lacks coordinates, a panoramic camera and samples out of range.
///
/// # Panics
/// When a picture has not as many samples as its size says.
pub fn draw_lightmapped(
    mesh: &Mesh,
    camera: &Camera,
    relit: &Picture,
    albedo: Albedo<'_>,
    settings: &DrawSettings,
) -> Result<Picture, SurfaceError> {
    let lightmap_coordinates = mesh.lightmap_coordinates()?;
    let texture_coordinates = match albedo {
        Albedo::Constant(_) => lightmap_coordinates,
        Albedo::Texture(_) => mesh.texture_coordinates()?,
    };
    drawn(
        mesh,
        camera,
        settings,
        || (),
        |fragment, ()| {
            let corners = mesh.triangles[fragment.triangle as usize];
            let read = |picture: &Picture, wrap, coordinates| {
                let place = interpolated(coordinates, corners, fragment);
                color_at(picture, &bilinear_taps(picture.width, picture.height, wrap, place))
            };
            let light = read(relit, Wrap::Clamp, lightmap_coordinates);
            let own = match albedo {
                Albedo::Constant(color) => color,
                Albedo::Texture(picture) => read(picture, settings.wrap, texture_coordinates),
            };
            [0, 1, 2].map(|c| light[c] * own[c])
        },
    )
}
