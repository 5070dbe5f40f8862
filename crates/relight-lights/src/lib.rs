//! Scenes of lights: what each of them does to every pixel of an asset, which of them a picture needs,
//! and how exactly.
//!
//! A [`Scene`] is planned for an asset's model ([`Plan`]) and then drawn ([`relight_scene`]). Light that has one
//! direction everywhere becomes one weight a plane; light from a point has a direction of its own at every
//! pixel, which its [`PositionMap`](relight_core::PositionMap) gives, and the basis is evaluated there by one
//! of the [`Path`]s.

mod bound;
mod cube_map;
mod elementary;
mod environment;
mod harmonics;
mod horizon;
mod lamps;
mod path;
mod plan;
mod relight;
mod rows;
mod scene;
mod square_table;
mod strip;
mod table;
mod uniform;

pub use environment::{Environment, EnvironmentError};
pub use horizon::{Horizon, Taken};
pub use lamps::AT_THE_SURFACE;
pub use path::{Accuracy, Directions, Evaluator, NoSuchPath, Path};
pub use plan::{Plan, UniformPass};
pub use relight::{LightReport, Report, Settings, relight_scene};
pub use scene::{Attenuation, Gobo, HorizonRule, Lamp, Light, LightError, Scene, Spot, between_keys};
