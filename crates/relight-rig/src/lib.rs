//! Irradiance rigs: moving meshes lit to match, from one small matrix a mesh.
//!
//! A rig is a few vectors of spherical harmonics of irradiance and a model that blends them over the mesh. They come from
//! the lights as seen from samples of the mesh's own surface, by one matrix that is made once ([`Rig`]). What a rig
//! gets wrong is tabulated against distance, so that a plan can say for each light whether it goes through the rig or is
//! evaluated exactly.
//!
//! Source: Yuan, Nowrouzezahrai, Sloan, *Irradiance Rigs*; stable forms and corrections of MATH.md section 1.4.
//! Positions are in the units of the mesh, radiance in that of the scene: a white diffuser that reflects 1 is white.

pub mod convention;
mod error;
mod light;
mod model;
mod placement;
mod rig;
mod zh3;

pub use error::RigError;
pub use light::{Light, Probe, Source};
pub use model::{AxisFunction, MODELS, MOST_PARAMETERS, Model, ModelFamily};
pub use placement::Placement;
pub use rig::{ErrorTable, Frame, Quantity, Rig, RigPart, Sample, SurfacePoint};
