//! The planes of an asset one by one: their names, bytes and quantizers.

use super::AssetHeader;
use crate::FormatError;
use relight_core::{Layout, Model};
use relight_texture::{Quantizer, TexelFormat};
use std::path::Path;

/// Bytes that the planes of such an asset take in memory; saturates.
pub(super) fn plane_bytes(width: usize, height: usize, model: &Model, format: TexelFormat) -> u64 {
    let texel_bytes = (model.plane_count() * format.decoded_precision().bytes()) as u64;
    (width as u64).saturating_mul(height as u64).saturating_mul(texel_bytes)
}

/// What each plane is called in messages and in EXR files, in the order of [`Model::roles`]:
/// `b03_uv.R`, `b03_uv.Y`, `base.R`.
pub fn plane_names(model: &Model) -> Vec<String> {
    let layer = |j: usize| {
        let label = model.map_label(j);
        let word: String = label
            .chars()
            .map(|c| match c {
                '-' => 'n',
                c if c.is_ascii_alphanumeric() => c,
                _ => '_',
            })
            .collect();
        format!("b{j:02}_{word}")
    };
    let maps = 0..model.maps();
    let colored = |layer: String| ["R", "G", "B"].map(|channel| format!("{layer}.{channel}"));
    match model.layout {
        Layout::Rgb => maps.flat_map(|j| colored(layer(j))).collect(),
        Layout::Grey | Layout::Shared => maps.map(|j| layer(j) + ".Y").collect(),
        Layout::Lrgb => maps.map(|j| layer(j) + ".Y").chain(colored("base".to_owned())).collect(),
    }
}

/// The quantizer of each plane, in the order of [`Model::roles`].
///
/// # Panics
/// When a plane is in no layer.
pub(super) fn plane_quantizers(header: &AssetHeader) -> Vec<Quantizer> {
    let mut quantizers = vec![None; header.model.plane_count()];
    for layer in header.packing.arrays.iter().flat_map(|array| &array.layers) {
        for (&plane, &quantizer) in layer.planes.iter().zip(&layer.quantizers) {
            quantizers[plane] = Some(quantizer);
        }
    }
    quantizers.into_iter().map(|quantizer| quantizer.expect("every plane lies in a layer")).collect()
}

/// Refuses quantizers that are not finite.
pub(super) fn check_finite(path: &Path, header: &AssetHeader) -> Result<(), FormatError> {
    let finite = |q: &Quantizer| q.scale.is_finite() && q.bias.is_finite();
    match plane_quantizers(header).iter().position(|q| !finite(q)) {
        None => Ok(()),
        Some(plane) => {
            let name = &plane_names(&header.model)[plane];
            let problem = format!("the coefficients of plane {name} are not finite; raise the ridge");
            Err(FormatError::invalid(path, problem))
        }
    }
}
