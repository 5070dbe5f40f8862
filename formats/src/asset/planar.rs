//! Formats that hold planes one by one: their packing.

use super::{AssetHeader, Details, plane_quantizers};
use crate::FormatError;
use relight_core::{CoefficientRange, RelightingMaps, Texels};
use relight_texture::{ArrayPlan, LayerPlan, PackedMaps, Packing, Precision, Quantizer, TexelFormat, Wrap};
use std::path::Path;

/// An array of a layer a plane, as textures that come from such a format have.
pub(super) fn packing(precision: Precision, quantizers: impl Iterator<Item = Quantizer>) -> Packing {
    let layer = |(plane, quantizer)| LayerPlan { planes: vec![plane], quantizers: vec![quantizer] };
    let layers = quantizers.enumerate().map(layer).collect();
    let format = TexelFormat::Plain { precision, channels: 1 };
    Packing { arrays: vec![ArrayPlan { format, layers }], levels: 1, wrap: Wrap::Clamp }
}

/// The precision of a packing for such a format.
pub(super) fn precision(packing: &Packing) -> Precision {
    packing.formats().next().map_or(Precision::F32, TexelFormat::decoded_precision)
}

/// The range of each plane that its quantizer in the packing spans.
pub(super) fn plane_ranges(header: &AssetHeader) -> Vec<CoefficientRange> {
    let range = |q: Quantizer| CoefficientRange { min: q.bias, max: q.bias + q.scale };
    plane_quantizers(header).into_iter().map(range).collect()
}

/// The range that holds all of `ranges`.
pub(super) fn range_of(ranges: &[CoefficientRange]) -> CoefficientRange {
    ranges.iter().fold(CoefficientRange::EMPTY, |all, &range| all.union(range))
}

/// The quantizer that all of `quantizers` are, where they are one.
pub(super) fn shared(quantizers: &[Quantizer]) -> Option<Quantizer> {
    let (first, rest) = quantizers.split_first()?;
    rest.iter().all(|quantizer| quantizer == first).then_some(*first)
}

/// Refuses base colours that bytes 0 to 255 for 0..1 can't hold; `ranges` are those of their planes.
pub(super) fn check_base_colors(path: &Path, ranges: &[CoefficientRange]) -> Result<(), FormatError> {
    let CoefficientRange { min, max } = range_of(ranges);
    // A thousandth beyond is rounding; more would be clipped unsaid.
    if max > 1.001 || min < -0.001 {
        let problem = format!("base colours {min}..{max} leave the 0..1 of its bytes; write .ktx2");
        return Err(FormatError::invalid(path, problem));
    }
    Ok(())
}

/// Reads maps as a GPU takes them; see [`super::read_packed`].
pub(super) fn read_packed(
    path: &Path,
    memory_limit: u64,
    summarize: fn(&Path) -> Result<(AssetHeader, Details), FormatError>,
    read: fn(&Path, u64) -> Result<RelightingMaps, FormatError>,
) -> Result<PackedMaps, FormatError> {
    // Maps and texels are in memory at once.
    let maps = read(path, memory_limit / 2)?;
    let (AssetHeader { width, height, model, packing }, _) = summarize(path)?;
    let bytes: u64 = maps.planes.iter().map(|plane| plane.texels.bytes()).sum();
    let mut level = Vec::with_capacity(bytes as usize);
    for plane in maps.planes {
        match plane.texels {
            Texels::U8(codes) => level.extend(codes),
            Texels::F16(halves) => level.extend(halves.iter().flat_map(|half| half.to_le_bytes())),
            Texels::F32(floats) => level.extend(floats.iter().flat_map(|float| float.to_le_bytes())),
        }
    }
    Ok(PackedMaps { width, height, model, packing, texels: vec![vec![level]] })
}
