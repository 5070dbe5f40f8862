//! Irradiance rigs: moving meshes lit to match, from one small matrix a mesh.
//!
//! A rig is a few vectors of spherical harmonics of irradiance and a model that blends them over the mesh. They come from
//! the lights as seen from samples of the mesh's own surface, by one matrix that is made once ([`Rig`]). What a rig
//! gets wrong is tabulated against distance, so that a plan can say for each light whether it goes through the rig or is
//! evaluated exactly.
//!
//! Source: Yuan, Nowrouzezahrai, Sloan, *Irradiance Rigs*; stable forms and corrections of MATH.md section 1.4.
//! Positions are in the units of the mesh, radiance in that of the scene: a white diffuser that reflects 1 is white.

mod auto;
pub mod convention;
mod error;
mod errors;
mod fit;
mod light;
mod lighting;
mod model;
mod operator;
mod pixels;
mod placement;
mod plan;
mod rig;
mod shading;
mod surface;
mod window;
mod zh3;

pub use auto::{Choice, LightFamily, cheapest};
pub use error::RigError;
pub use errors::{DISTANCES, Envelope, directions, error_table};
pub use fit::{Fitting, Ground, SAMPLES};
pub use light::{
    CutDiscs, Light, MOST_BANDS, Probe, Projector, Source, SphereTable, SurfaceRows, TableAxes,
    add_reflectance, cosine_lobe,
};
pub use lighting::reflection;
pub use model::{AxisFunction, MODELS, MOST_PARAMETERS, Model, ModelFamily, Products};
pub use operator::least_squares;
pub use pixels::{Pixels, Reflected};
pub use placement::Placement;
pub use plan::{LightPlan, PicturePlan, PlacedPart, Plan, Rule, plan};
pub use rig::{ErrorTable, Frame, Quantity, Rig, RigPart, Sample, SurfacePoint};
pub use shading::{RigRows, ShadedRig};
pub use surface::Surface;
pub use window::{Bands, Ringing, Window};
