//! Rebinning and fitting: from a stack of pictures to coefficients of a basis at every pixel.
//!
//! One small matrix, found once by singular values in f64, turns the values of a pixel under all
//! lights into its coefficients; the pictures are rebinned tile by tile so that each is read once.

pub mod calibration;
mod continuation;
mod decomposition;
mod error;
mod exposure;
mod height;
mod interpolation;
mod learned;
mod least_squares;
mod leave_one_out;
mod median;
mod misfit;
mod near;
mod normals;
mod photometric_stereo;
mod poisson;
mod principal;
mod rebin;
mod refit;
mod relit_stack;
mod robust;
mod row_products;
mod sample;
mod singular_values;
mod usable;

pub use decomposition::{Decomposition, LightWeights, RANK_TOLERANCE};
pub use error::FitError;
pub use exposure::{ExposureTrial, exposure_factors, exposure_trial};
pub use height::{height_bytes, heights_from_normals};
pub use learned::{LearnedDesign, LearnedFit, learned_bytes};
pub use least_squares::{LeastSquares, Ridge};
pub use leave_one_out::{LeaveOneOut, mean_psnr};
pub use median::median;
pub use misfit::{Misfit, misfits};
pub use near::{
    AT_SURFACE, LevelledStack, MOST_OFF, NearLamps, NearSolutions, NearSurface, Vignetting, near_bytes,
    near_least_squares,
};
pub use normals::{NormalError, NormalMap, normal_error, normal_map, normal_map_bytes};
pub use photometric_stereo::{COPLANAR, NormalMethod, PhotometricStereo, SurfaceNormal};
pub use rebin::{
    PixelFit, SPAN, coefficient_distributions, coefficient_sample, fit_map, for_each_span,
    for_each_span_within, span_bytes,
};
pub use refit::{PlaneStack, Refit};
pub use relit_stack::RelitStack;
pub use robust::RobustFit;
pub use sample::{ChannelSample, Sample};
pub use usable::{LIGHTS_PER_FUNCTION, Usability, WORST_CONDITION, largest_usable, usability};
