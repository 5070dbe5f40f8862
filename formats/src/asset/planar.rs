//! Formats that hold planes one by one: their packing.

use super::{AssetHeader, Details, plane_quantizers};
use crate::FormatError;
use relight_core::{CoefficientRange, CoefficientSpan, Model, RelightingMaps, Space, Texels};
use relight_texture::{
    ArrayPlan, LayerPlan, PackedMaps, Packing, PlaneErrors, Precision, Quantizer, TexelFormat, Wrap,
};
use std::ops::Range;
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

/// Why `format`, which holds fits in encoded space alone, can't hold a model of another.
pub(super) fn space_refusal(format: &str, model: &Model) -> Option<String> {
    (model.space != Space::Encoded).then(|| {
        format!(
            "{format} holds fits in encoded space, not linear; fit in encoded space, or write .ktx2 or .exr"
        )
    })
}

/// Refuses a file in which only `found` bytes follow its header, where pixels take `pixel_bytes` each.
pub(super) fn check_pixels(
    path: &Path,
    (width, height): (usize, usize),
    pixel_bytes: u64,
    found: u64,
) -> Result<(), FormatError> {
    let pixels = (width as u64).checked_mul(height as u64);
    if pixels.and_then(|pixels| pixels.checked_mul(pixel_bytes)).is_none_or(|expected| expected > found) {
        let problem =
            format!("is cut short: {width} x {height} pixels of {pixel_bytes} bytes in {found} bytes");
        return Err(FormatError::invalid(path, problem));
    }
    Ok(())
}

/// Codes of base colours: 255 is 1.
pub(super) const UNIT: Quantizer = Quantizer { scale: 1.0, bias: 0.0 };

/// The coefficients of plane `role` of `Model::roles` at `pixels` of `span`.
pub(crate) fn coefficients<'a>(
    span: &CoefficientSpan<'a>,
    model: &Model,
    role: usize,
    pixels: Range<usize>,
) -> impl Iterator<Item = &'a f32> + Clone {
    let stride = model.layout.planes_per_map();
    let (values, stride, channel) = match role.checked_sub(model.maps() * stride) {
        Some(channel) => (span.base_color, 3, channel),
        None => (&span.maps[role / stride * span.pixels * stride..], stride, role % stride),
    };
    values[pixels.start * stride..pixels.end * stride][channel..].iter().step_by(stride)
}

/// The codes of a plane's coefficients; `errors` has what rounding costs added, from pixel `first` of the picture on.
pub(super) fn codes_of<'a>(
    quantizer: &Quantizer,
    coefficients: impl Iterator<Item = &'a f32> + Clone,
    first: usize,
    errors: &mut PlaneErrors,
) -> Vec<u8> {
    let codes: Vec<u8> = coefficients.clone().map(|&c| quantizer.code(c)).collect();
    let given_back = codes.iter().map(|&code| quantizer.scale * (f32::from(code) / 255.0) + quantizer.bias);
    errors.add(first, given_back.zip(coefficients).map(|(back, c)| back - c));
    codes
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
    let mut level = Vec::with_capacity(maps.texel_bytes() as usize);
    for plane in maps.planes {
        match plane.texels {
            Texels::U8(codes) => level.extend(codes),
            Texels::F16(halves) => level.extend(halves.iter().flat_map(|half| half.to_le_bytes())),
            Texels::F32(floats) => level.extend(floats.iter().flat_map(|float| float.to_le_bytes())),
        }
    }
    Ok(PackedMaps { width, height, model, packing, texels: vec![vec![level]] })
}
