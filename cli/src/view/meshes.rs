//! Meshes under relit lightmaps and tangent-space textures.

use super::{ViewArguments, three_of};
use crate::failure::{Exit, Failure};
use crate::light_options::numbers_of;
use crate::options::{Machine, WrapChoice};
use clap::{Args, ValueEnum};
use relight_core::relighter::{DirectionalLight, Picture};
use relight_core::{Camera, Projection};
use relight_formats::{linear_picture, read_mesh};
use relight_surface::{
    Albedo, DrawSettings, Mesh, MeshLight, SurfaceError, chart_coverage, dilate, draw_lightmapped,
    draw_tangent_space,
};
use std::path::PathBuf;

/// Point lights are as bright as at this distance when they are nearer, in units of the mesh.
const LEAST_DISTANCE: f64 = 1e-3;

/// The mesh and how it is seen.
#[derive(Args, Debug)]
#[group(id = "mesh_options")]
#[command(next_help_heading = "Meshes")]
pub(super) struct MeshOptions {
    /// Draw the asset on this mesh: .glb, .gltf or .obj
    #[arg(long, value_name = "FILE", requires_all = ["eye", "target"])]
    mesh: Option<PathBuf>,
    /// Where the camera stands, in the axes of the mesh
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_of, requires = "mesh")]
    eye: Option<[f64; 3]>,
    /// What it looks at
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_of, requires = "mesh")]
    target: Option<[f64; 3]>,
    /// What is up in the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_of, default_value = "0,1,0")]
    up: [f64; 3],
    /// Angle between the picture's left and right edge in degrees
    #[arg(long, value_name = "DEG", default_value = "45")]
    fov: f64,
    /// Draw without perspective, so many units of the mesh wide
    #[arg(long, value_name = "UNITS", conflicts_with = "fov", requires = "mesh")]
    width: Option<f64>,
    /// world: the asset is a lightmap at the second texture coordinates, lights in its own axes;
    /// tangent: it is a texture at the first ones, lights in the axes of the mesh
    #[arg(long, value_name = "SPACE", value_enum, default_value = "world")]
    space: SpaceChoice,
    /// The surface's own colour, a picture at the first texture coordinates (lightmaps)
    #[arg(long, value_name = "FILE", requires = "mesh")]
    albedo: Option<PathBuf>,
    /// Texels by which a lightmap's charts are carried beyond their edges
    #[arg(long, value_name = "TEXELS", default_value = "4", value_parser = clap::value_parser!(u16).range(0..=1024))]
    dilate: u16,
    /// A light at a point of the mesh's axes, its linear colour that at distance 1, falling off with the square
    /// (--space tangent)
    #[arg(long, value_name = "X,Y,Z[,R,G,B]", allow_hyphen_values = true, value_parser = point_of, requires = "mesh")]
    point: Vec<([f64; 3], [f32; 3])>,
    /// What lies beyond the edge of textures
    #[arg(long, value_name = "MODE", value_enum, default_value = "repeat")]
    wrap: WrapChoice,
    /// Samples along a pixel's side
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u8).range(1..=16))]
    samples: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SpaceChoice {
    World,
    Tangent,
}

fn point_of(text: &str) -> Result<([f64; 3], [f32; 3]), String> {
    let (numbers, color) = numbers_of(text, 3)?;
    let position = [numbers[0], numbers[1], numbers[2]];
    if position.iter().any(|c| !c.is_finite()) {
        return Err(format!("'{text}' is no place; give finite numbers"));
    }
    Ok((position, color))
}

impl MeshOptions {
    /// Whether it has lights of its own.
    pub(super) fn has_lights(&self) -> bool {
        !self.point.is_empty()
    }

    /// Samples of a pixel; 1 without a mesh.
    pub(super) fn samples_of_pixel(&self) -> usize {
        if self.mesh.is_some() { usize::from(self.samples) * usize::from(self.samples) } else { 1 }
    }

    /// The files that it reads.
    pub(super) fn inputs(&self) -> impl Iterator<Item = &PathBuf> {
        self.mesh.iter().chain(&self.albedo)
    }

    /// Refuses options that belong to the other space.
    pub(super) fn check(&self, has_scene: bool) -> Result<(), Failure> {
        match self.space {
            SpaceChoice::Tangent if has_scene => Err(Failure::usage(
                "--scene lights a panorama or a lightmap; with --space tangent give --light, --angles or --point",
            )),
            SpaceChoice::World if self.has_lights() => Err(Failure::usage(
                "--point needs --space tangent; a lightmap's lights are --light, --angles or --scene",
            )),
            SpaceChoice::Tangent if self.albedo.is_some() => Err(Failure::usage(
                "--albedo is for lightmaps; with --space tangent the asset has the colour, leave it out",
            )),
            _ => Ok(()),
        }
    }

    /// The mesh as it is seen, in linear light.
    pub(super) fn picture(
        &self,
        view: &ViewArguments,
        lights: &[DirectionalLight],
        machine: &Machine,
    ) -> Result<Picture, Failure> {
        let camera = self.camera(view.size)?;
        let Some(path) = &self.mesh else {
            return Err(Failure::usage("nothing to look at; give --view or --mesh"));
        };
        let mesh = read_mesh(path, machine.memory)?;
        let of_mesh =
            |error: SurfaceError| Failure::new(Exit::BadInput, format!("{}: {error}", path.display()));
        let settings = DrawSettings {
            supersampling: usize::from(self.samples),
            background: view.background,
            wrap: self.wrap.mode(),
        };
        match self.space {
            SpaceChoice::World => {
                let relit = view.relit(lights, machine)?;
                let albedo = self.albedo.as_deref();
                let albedo =
                    albedo.map(|path| linear_picture(path, machine.level, machine.memory)).transpose()?;
                self.lightmapped(&mesh, &camera, &relit, albedo.as_ref(), &settings).map_err(of_mesh)
            }
            SpaceChoice::Tangent => {
                let maps = view.maps(machine)?;
                let points = self.point.iter().map(|&(position, color)| MeshLight::Point {
                    position,
                    color,
                    least_distance: LEAST_DISTANCE,
                });
                let lights: Vec<_> =
                    lights.iter().copied().map(MeshLight::Directional).chain(points).collect();
                draw_tangent_space(&mesh, &camera, &maps, &lights, &settings).map_err(of_mesh)
            }
        }
    }

    fn lightmapped(
        &self,
        mesh: &Mesh,
        camera: &Camera,
        relit: &Picture,
        albedo: Option<&Picture>,
        settings: &DrawSettings,
    ) -> Result<Picture, SurfaceError> {
        let coverage = chart_coverage(mesh, relit.width, relit.height)?;
        let relit = dilate(relit, &coverage, usize::from(self.dilate));
        let albedo = albedo.map_or(Albedo::Constant([1.0; 3]), Albedo::Texture);
        draw_lightmapped(mesh, camera, &relit, albedo, settings)
    }

    fn camera(&self, size: (usize, usize)) -> Result<Camera, Failure> {
        let projection = match self.width {
            Some(width) => Projection::Orthographic { width },
            None => Projection::Perspective { fov_x: self.fov.to_radians() },
        };
        let (Some(eye), Some(target)) = (self.eye, self.target) else {
            return Err(Failure::usage("a mesh needs --eye and --target"));
        };
        Ok(Camera::new(projection, size, eye, target, self.up)?)
    }
}
