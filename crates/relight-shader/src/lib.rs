//! Shader source that lights a packed asset, for engines to include: the basis as functions of the
//! light's direction, the scale and bias of every layer, and the sum over the layers.
//!
//! [`shader`] writes WGSL, GLSL (ES 3.00 and 3.30 upwards) or HLSL (shader model 5 upwards). All three
//! come from one description of the functions, and nothing in them imposes a binding: textures and
//! samplers are parameters.
//!
//! | function | what it gives |
//! |---|---|
//! | `relight_basis` | the functions of light at a unit direction, in the order of [`Basis::evaluate`](relight_core::Basis::evaluate) |
//! | `relight_layer_weights` | the weight of each layer's channels from those; [`layer_weights`] is the same on the CPU |
//! | `relight_weights` | both in one |
//!
//! Learned functions are a table, which `relight_basis` and `relight_weights` take as one more array texture.
//!
//! | function | what it gives |
//! |---|---|
//! | `relight_shade` | the color at a texel of a level |
//! | `relight_sample`, `relight_sample_level` | the same through a sampler |
//! | `relight_to_linear`, `relight_to_encoded` | the color in linear light, or sRGB-encoded |
//! | `relight_point_light` | direction and attenuation of a light at a place |
//! | `.._pass`, `.._finish` | with [`ShaderOptions::maps_per_pass`]: the sum of some layers, and base colour times the whole sum |
//!
//! [`rig_shader`] writes the source that lights a moving mesh by its irradiance rig instead.
//!
//! ```
//! use relight_core::{Design, Family, Layout, LightSet, Model, Space};
//! use relight_shader::{Language, ShaderOptions, shader};
//! use relight_texture::{ArrayPlan, BlockFormat, LayerPlan, Packing, Quantizer, TexelFormat, Wrap, planes_of_layers};
//! let basis = Family::by_name("ptm").unwrap().build(&Design::new(6, &LightSet::default()))?;
//! let model = Model { basis, layout: Layout::Rgb, space: Space::Encoded, lights: vec![], figures: None, provenance: None };
//! let format = TexelFormat::Block(BlockFormat::Bc7);
//! let quantizer = Quantizer { scale: 2.0, bias: -1.0 };
//! let layers = planes_of_layers(&model, format)
//!     .into_iter()
//!     .map(|planes| LayerPlan { quantizers: vec![quantizer; planes.len()], planes })
//!     .collect();
//! let packing = Packing { arrays: vec![ArrayPlan { format, layers }], levels: 1, wrap: Wrap::Clamp };
//! let options = ShaderOptions { language: Language::Wgsl, maps_per_pass: None };
//! let source = shader(&model, &packing, 640, 480, &options);
//! assert!(source.contains("fn relight_weights(l: vec3f) -> array<vec4f, RELIGHT_LAYERS>"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod basis;
mod header;
mod language;
mod layers;
mod light;
mod literal;
mod rig;
mod rig_sphere;
mod source;
mod sum;

pub use language::Language;
pub use rig::{RigShaderOptions, rig_shader};

use layers::{Layer, Layers, Shared};
use relight_core::Model;
use relight_texture::Packing;
use source::Source;

/// What [`shader`] writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShaderOptions {
    /// In which language.
    pub language: Language,
    /// Also the functions that sum so many layers at a time, for several passes with additive
    /// blending; 0 counts as 1.
    pub maps_per_pass: Option<usize>,
}

/// The source that lights an asset of `model` whose planes lie as `packing` says, level 0 of
/// `width` x `height` texels.
///
/// Depends on nothing but its arguments; the crate's page lists its functions.
///
/// # Panics
/// Where a layer names a plane that the model lacks, has more than four planes or fewer quantizers
/// than planes, mixes coefficients and base colour, or where a scale or bias is not finite.
pub fn shader(
    model: &Model,
    packing: &Packing,
    width: usize,
    height: usize,
    options: &ShaderOptions,
) -> String {
    let layers = Layers::new(model, packing);
    let mut source = Source::new(options.language);
    header::comment(&mut source, model, packing, &layers, (width, height));
    header::constants(&mut source, model, packing, &layers, (width, height));
    basis::write(&mut source, &model.basis);
    layers::tables(&mut source, &layers);
    layers::weights(&mut source, &layers);
    sum::write(&mut source, model, &layers, options.maps_per_pass);
    light::transfer(&mut source, model.space);
    light::point_light(&mut source);
    source.into_text()
}

/// What `relight_layer_weights` gives for the functions of light `basis`, as
/// [`Basis::evaluate`](relight_core::Basis::evaluate) writes them: for each layer, over all arrays in
/// turn, the weight of each channel. Of shared planes, for each channel of each layer its weight in red,
/// green and blue, and at the end the mean.
///
/// # Panics
/// As [`shader`], and where `basis` is shorter than the model's basis.
pub fn layer_weights(model: &Model, packing: &Packing, basis: &[f64]) -> Vec<[f32; 4]> {
    let layers = Layers::new(model, packing);
    let Some(Shared { planes, steps }) = layers.shared else {
        let of_layer = |layer: Layer| layer.functions.map(|function| basis[function] as f32);
        return layers.layers.into_iter().map(of_layer).collect();
    };
    let rgb = |first: usize| {
        let [r, g, b] = steps.map(|step| basis[first + step] as f32);
        [r, g, b, 0.0]
    };
    let channels = layers.layers.iter().flat_map(|layer| &layer.functions[..planes]);
    channels.map(|&function| rgb(function)).chain([rgb(0)]).collect()
}

/// How many weights a light has, and the name of the constant that says so in the source.
///
/// # Panics
/// As [`shader`].
pub fn weight_count(model: &Model, packing: &Packing) -> (usize, &'static str) {
    Layers::new(model, packing).weights()
}
