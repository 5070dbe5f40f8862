//! Where relit pictures are seen: a perspective view out of a panorama, a relit lightmap on a mesh, and
//! relighting maps in the tangent space of a mesh, drawn by a small rasteriser.
//!
//! Pictures go in and come out in linear light; which lights they are under is decided before
//! ([`relight_core::relighter`]), except in tangent space, where each point of the mesh sees a light
//! from a direction of its own ([`MeshLight`]). All functions give the same bits with any number of threads.

mod dilation;
mod draw;
mod error;
mod lightmap;
mod mesh;
mod panorama;
mod panorama_lookup;
mod rasterizer;
mod tangent_frame;
mod tangent_space;
mod tangents;

pub use dilation::dilate;
pub use draw::DrawSettings;
pub use error::SurfaceError;
pub use lightmap::{Albedo, draw_lightmapped};
pub use mesh::Mesh;
pub use panorama::{Filter, PanoramaView, view_of_panorama};
pub use rasterizer::{Fragment, Fragments, chart_coverage, rasterize};
pub use tangent_frame::TangentFrame;
pub use tangent_space::{DROP_OFF, MeshLight, draw_tangent_space, drop_off};
