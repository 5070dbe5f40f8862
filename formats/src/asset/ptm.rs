//! `.ptm`: what it holds, and the writer of PTM_1.2 (RGB and LRGB).
//!
//! Source: FORMATS.md of this project. value = (byte - bias) x scale in 0..255 units, one scale and
//! bias a function, rows bottom-up.

use super::planar::{
    UNIT, check_base_colors, codes_of, coefficients, plane_ranges, range_of, shared, space_refusal,
};
use super::{
    AssetHeader, AssetWriter, Created, WriteSettings, assert_shape, check_complete, check_finite,
    plane_quantizers, ptm_jpeg,
};
use crate::{FormatError, OutputFile};
use relight_core::CoefficientRange;
use relight_core::{Basis, CoefficientSpan, Layout, Model};
use relight_texture::{PackReport, PlaneErrors, Quantizer, StoringErrors};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Functions of a `.ptm`: u^2, v^2, uv, u, v, 1, the order of our own degree 2.
pub(super) const FUNCTIONS: usize = 6;

/// Largest bias that is written: where a plane hardly varies around a value far from 0, steps of
/// 1/32768 of that value are fine enough, and every reader's integers hold it.
const LARGEST_BIAS: f64 = 32768.0;

/// Why a `.ptm` can't hold a model.
pub(super) fn refusal(model: &Model) -> Option<String> {
    let (family, count) = (model.basis.family().name, model.basis.count());
    if !matches!(model.basis, Basis::Ptm(_)) || count != FUNCTIONS {
        return Some(format!(
            "ptm holds basis ptm with {FUNCTIONS} functions, not {family} with {count}; fit --basis ptm, \
             or write .ktx2 or .exr"
        ));
    }
    space_refusal("ptm", model)
}

/// How the coefficients of a map become those of a `.ptm`.
pub(super) struct PtmCoding {
    /// One per function.
    scale_bias: Vec<(f32, i32)>,
    /// One per function.
    quantizers: Vec<Quantizer>,
}

impl PtmCoding {
    /// The coding of `header`'s planes, whose ranges are those of their quantizers in the packing.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] for planes that are not finite and base colours outside 0..1.
    pub(super) fn of(path: &Path, header: &AssetHeader) -> Result<Self, FormatError> {
        check_finite(path, header)?;
        let planes_per_map = header.model.layout.planes_per_map();
        let ranges = plane_ranges(header);
        let (coefficients, base) = ranges.split_at(FUNCTIONS * planes_per_map);
        check_base_colors(path, base)?;
        let of_planes = plane_quantizers(header);
        let maps = coefficients.chunks(planes_per_map).zip(of_planes.chunks(planes_per_map));
        let scale_bias: Vec<_> = maps
            .map(|(ranges, own)| {
                shared(own).and_then(whole_bias).unwrap_or_else(|| scale_bias_of(range_of(ranges)))
            })
            .collect();
        let quantizers =
            scale_bias.iter().map(|&(scale, bias)| quantizer_of(scale, f64::from(bias))).collect();
        Ok(Self { scale_bias, quantizers })
    }

    /// The header of a file of `form`, up to and with the biases.
    pub(super) fn head(&self, header: &AssetHeader, form: &str) -> String {
        let layout = if header.model.layout == Layout::Lrgb { "LRGB" } else { "RGB" };
        let joined = |words: Vec<String>| words.join(" ");
        format!(
            "PTM_1.2\nPTM_FORMAT_{form}{layout}\n{}\n{}\n{}\n{}\n",
            header.width,
            header.height,
            joined(self.scale_bias.iter().map(|(scale, _)| scale.to_string()).collect()),
            joined(self.scale_bias.iter().map(|(_, bias)| bias.to_string()).collect()),
        )
    }

    /// The quantizer of plane `role` of `Model::roles`.
    pub(super) fn quantizer(&self, layout: Layout, role: usize) -> Quantizer {
        let function = role / layout.planes_per_map();
        self.quantizers.get(function).copied().unwrap_or(UNIT)
    }
}

struct PtmWriter {
    header: AssetHeader,
    coding: PtmCoding,
    /// Where the coefficients begin in the file.
    offset: u64,
    written: AtomicUsize,
    errors: StoringErrors,
    file: OutputFile,
}

/// Starts a `.ptm` asset; see [`super::AssetFormat::create`].
///
/// The range of a plane is that of its quantizer in the packing.
pub(super) fn create(path: &Path, header: AssetHeader, settings: &WriteSettings) -> Created {
    let coding = PtmCoding::of(path, &header)?;
    if let Some(quality) = settings.jpeg_quality {
        return ptm_jpeg::create(path, header, coding, quality, settings.memory_limit);
    }
    let head = coding.head(&header, "");
    let file = OutputFile::create(path)?;
    file.write_at(0, head.as_bytes())?;
    let offset = head.len() as u64;
    let (written, errors) = (AtomicUsize::new(0), StoringErrors::new(&header.model));
    Ok(Box::new(PtmWriter { header, coding, offset, written, errors, file }))
}

/// Scale and bias of a function whose coefficients lie in `range`, such that their codes are 0..255
/// after the bias was rounded to an integer, which is why 254 steps span the range.
fn scale_bias_of(range: CoefficientRange) -> (f32, i32) {
    let (min, max) = (f64::from(range.min) * 255.0, f64::from(range.max) * 255.0);
    let largest = min.abs().max(max.abs());
    let scale = ((max - min) / 254.0).max(largest / LARGEST_BIAS) as f32;
    if !scale.is_finite() || scale < f32::MIN_POSITIVE {
        return (1.0, 0);
    }
    (scale, (-min / f64::from(scale)).round() as i32)
}

/// Scale and bias of a quantizer whose bias is whole already, as those of another `.ptm` are: its codes stay
/// what they are.
fn whole_bias(quantizer: Quantizer) -> Option<(f32, i32)> {
    let bias = (-f64::from(quantizer.bias) * 255.0 / f64::from(quantizer.scale)).round();
    let is_whole = bias.abs() <= LARGEST_BIAS && quantizer_of(quantizer.scale, bias) == quantizer;
    (is_whole && quantizer.scale >= f32::MIN_POSITIVE).then_some((quantizer.scale, bias as i32))
}

/// coefficient = scale' x q + bias' of a file's scale and bias: with q = byte / 255 and the model's
/// units 255 times smaller than the file's, scale' is the file's own.
pub(super) fn quantizer_of(scale: f32, bias: f64) -> Quantizer {
    Quantizer { scale, bias: (-bias * f64::from(scale) / 255.0) as f32 }
}

impl PtmWriter {
    /// Writes `count` pixels, those of `span` from its pixel `start` on, which lie in one row, and
    /// adds what rounding them costs to the `errors` of their planes.
    fn write_run(
        &self,
        span: &CoefficientSpan<'_>,
        start: usize,
        count: usize,
        bytes: &mut Vec<u8>,
        errors: &mut [PlaneErrors],
    ) -> Result<(), FormatError> {
        let AssetHeader { width, height, model, .. } = &self.header;
        let (x, y) = ((span.first + start) % width, (span.first + start) / width);
        let pixel = ((height - 1 - y) * width + x) as u64;
        let block = (width * height * FUNCTIONS) as u64;
        let (channels, pixels) = (model.layout.planes_per_map(), start..start + count);
        bytes.resize(count * FUNCTIONS, 0);
        for channel in 0..channels {
            for (j, quantizer) in self.coding.quantizers.iter().enumerate() {
                let role = j * channels + channel;
                let row = coefficients(span, model, role, pixels.clone());
                let codes = codes_of(quantizer, row, span.first + start, &mut errors[role]);
                bytes[j..].iter_mut().step_by(FUNCTIONS).zip(codes).for_each(|(byte, code)| *byte = code);
            }
            let place = self.offset + channel as u64 * block + pixel * FUNCTIONS as u64;
            self.file.write_at(place, bytes)?;
        }
        if model.layout == Layout::Lrgb {
            bytes.resize(count * 3, 0);
            for channel in 0..3 {
                let role = FUNCTIONS + channel;
                let row = coefficients(span, model, role, pixels.clone());
                let codes = codes_of(&UNIT, row, span.first + start, &mut errors[role]);
                bytes[channel..].iter_mut().step_by(3).zip(codes).for_each(|(byte, code)| *byte = code);
            }
            self.file.write_at(self.offset + block + pixel * 3, bytes)?;
        }
        Ok(())
    }
}

impl AssetWriter for PtmWriter {
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError> {
        assert_shape(&self.header, span);
        let width = self.header.width;
        let (mut start, mut bytes) = (0, Vec::new());
        let mut errors = vec![PlaneErrors::default(); self.header.model.plane_count()];
        while start < span.pixels {
            let left_in_row = width - (span.first + start) % width;
            let count = left_in_row.min(span.pixels - start);
            self.write_run(span, start, count, &mut bytes, &mut errors)?;
            start += count;
        }
        self.errors.add(span.first, errors);
        self.written.fetch_add(span.pixels, Ordering::Relaxed);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<PackReport, FormatError> {
        check_complete(self.file.path(), &self.header, self.written.load(Ordering::Relaxed))?;
        let Self { header, errors, file, .. } = *self;
        file.finish()?;
        Ok(errors.report(header.width * header.height))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_coefficient_is_clipped_and_each_comes_back_within_half_a_step() {
        let ranges = [(0.0, 1.0), (-0.7, 0.31), (0.4, 0.5), (-3.0, -2.9), (0.5, 0.5), (0.3, 0.300_001)];
        for (min, max) in ranges {
            let (scale, bias) = scale_bias_of(CoefficientRange { min, max });
            assert!((-33000..=33000).contains(&bias), "{min}..{max}: bias {bias}");
            let quantizer = quantizer_of(scale, f64::from(bias));
            for i in 0..=1000 {
                let c = (min + (max - min) * (i as f32 / 1000.0)).min(max);
                let byte = quantizer.code(c);
                let back = (f64::from(byte) - f64::from(bias)) * f64::from(scale) / 255.0;
                let error = (back - f64::from(c)).abs();
                assert!(error <= f64::from(scale) / 255.0 * 0.51, "{c} came back as {back}");
            }
        }
        assert_eq!(scale_bias_of(CoefficientRange { min: 0.0, max: 0.0 }), (1.0, 0));
        assert_eq!(scale_bias_of(CoefficientRange::EMPTY), (1.0, 0));
    }
}
