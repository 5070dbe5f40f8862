//! What a relightable picture is: light directions, the bases that are functions of them, the
//! maps of coefficients, and the slow-but-obvious relighter that judges every faster one.
//!
//! ```
//! use relight_core::{Basis, Direction, Family, Design, LightSet};
//! let lights = LightSet::from_directions(vec![Direction::new(0.0, 0.0, 1.0)?]);
//! let basis = Family::by_name("ptm").unwrap().build(&Design::new(6, &lights))?;
//! let mut weights = vec![0.0; basis.count()];
//! basis.evaluate(Direction::new(0.6, 0.0, 0.8)?, &mut weights);
//! assert!((weights[0] - 0.36).abs() < 1e-15); // u^2
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod basis;
mod camera;
mod cpu;
mod direction;
mod distribution;
mod light_set;
pub mod maps;
pub mod metrics;
mod model;
mod position_map;
mod provenance;
mod random;
pub mod relighter;
mod spare;
pub mod sphere;
mod stack;
pub mod texture_lookup;
mod transfer;
mod unit_values;
pub mod vectors;
pub mod weighted_sums;
mod wrap;

pub use basis::{Basis, BasisError, Design, Family};
pub use camera::{Camera, CameraError, Projection, Ray, Seen};
pub use cpu::{CpuLevel, UnsupportedCpuLevel, Vectorized};
pub use direction::{Direction, DirectionError};
pub use distribution::{Bucket, CoefficientCounter, CoefficientDistribution, CoefficientSample};
pub use light_set::{Light, LightSet};
pub use maps::{CoefficientMap, CoefficientRange, CoefficientSpan, RelightingMap, RelightingMaps, Texels};
pub use model::{FitFigures, Layout, Model, PlaneRole, Space};
pub use position_map::{DepthError, DepthKind, DepthMap, NO_SURFACE, PointKind, PositionMap, SKY};
pub use provenance::{PictureRecord, Provenance};
pub use random::SplitMix64;
pub use spare::Spare;
pub use stack::{Stack, StackError, StackRows};
pub use transfer::{LUMINANCE, linear_from_srgb, luminance, srgb_from_linear};
pub use unit_values::unit_values_from_codes;
pub use wrap::Wrap;
