//! `.rti`: what it holds, and the writer of HSH1.2 (RGB and LRGB).
//!
//! Source: FORMATS.md of this project. value = byte / 255 x scale + bias in 0..1 units, one scale and bias a
//! term, rows top-down, all terms of a channel side by side. The terms are our hemispherical harmonics in
//! our order.

use super::planar::{
    UNIT, check_base_colors, codes_of, coefficients, plane_ranges, range_of, shared, space_refusal,
};
use super::{
    AssetHeader, AssetWriter, Created, assert_shape, check_complete, check_finite, plane_quantizers,
};
use crate::{FormatError, OutputFile};
use relight_core::{Basis, CoefficientSpan, Layout, Model};
use relight_texture::{PackReport, PlaneErrors, Quantizer, StoringErrors};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Numbers of terms of a file.
pub(super) const TERMS: [usize; 3] = [4, 9, 16];

/// The word for each layout.
pub(super) const BASIS_TYPES: [(i64, Layout); 2] = [(1, Layout::Lrgb), (2, Layout::Rgb)];

/// Why an `.rti` can't hold a model.
pub(super) fn refusal(model: &Model) -> Option<String> {
    let (family, count) = (model.basis.family().name, model.basis.count());
    if !matches!(model.basis, Basis::Hsh(_)) || !TERMS.contains(&count) {
        return Some(format!(
            "rti holds basis hsh with 4, 9 or 16 functions, not {family} with {count}; fit --basis hsh -k 9, \
             or write .ktx2 or .exr"
        ));
    }
    space_refusal("rti", model)
}

struct RtiWriter {
    header: AssetHeader,
    /// One per term.
    quantizers: Vec<Quantizer>,
    /// Where the pixels begin in the file.
    offset: u64,
    written: AtomicUsize,
    errors: StoringErrors,
    file: OutputFile,
}

/// The place in a pixel's bytes of plane `role` of `Model::roles`.
pub(super) fn place_in_pixel(layout: Layout, terms: usize, role: usize) -> usize {
    match layout {
        Layout::Rgb => role % 3 * terms + role / 3,
        Layout::Lrgb | Layout::Grey | Layout::Shared => role,
    }
}

/// Starts an `.rti` asset; see [`super::AssetFormat::create`].
///
/// The range of a term is that of its planes' quantizers in the packing.
pub(super) fn create(path: &Path, header: AssetHeader) -> Created {
    check_finite(path, &header)?;
    let (layout, terms) = (header.model.layout, header.model.maps());
    let ranges = plane_ranges(&header);
    let (coefficients, base) = ranges.split_at(terms * layout.planes_per_map());
    check_base_colors(path, base)?;
    let of_planes = plane_quantizers(&header);
    let maps = coefficients.chunks(layout.planes_per_map()).zip(of_planes.chunks(layout.planes_per_map()));
    // What all three planes have is taken as it is: codes of another `.rti` stay what they are.
    let quantizer = |(ranges, own)| shared(own).unwrap_or_else(|| Quantizer::over(range_of(ranges)));
    let quantizers: Vec<_> = maps.map(quantizer).collect();
    let basis_type = if layout == Layout::Lrgb { BASIS_TYPES[0].0 } else { BASIS_TYPES[1].0 };
    let (width, height) = (header.width, header.height);
    let mut head = format!("#HSH1.2\n3\n{width} {height} 3\n{terms} {basis_type} 1\n").into_bytes();
    head.extend(quantizers.iter().flat_map(|q| q.scale.to_le_bytes()));
    head.extend(quantizers.iter().flat_map(|q| q.bias.to_le_bytes()));
    let file = OutputFile::create(path)?;
    file.write_at(0, &head)?;
    let offset = head.len() as u64;
    let (written, errors) = (AtomicUsize::new(0), StoringErrors::new(&header.model));
    Ok(Box::new(RtiWriter { header, quantizers, offset, written, errors, file }))
}

impl AssetWriter for RtiWriter {
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError> {
        assert_shape(&self.header, span);
        let model = &self.header.model;
        let count = model.plane_count();
        let (mut errors, mut bytes) = (vec![PlaneErrors::default(); count], vec![0; span.pixels * count]);
        for (role, errors) in errors.iter_mut().enumerate() {
            let quantizer = self.quantizers.get(role / model.layout.planes_per_map()).unwrap_or(&UNIT);
            let values = coefficients(span, model, role, 0..span.pixels);
            let codes = codes_of(quantizer, values, span.first, errors);
            let place = place_in_pixel(model.layout, model.maps(), role);
            bytes[place..].iter_mut().step_by(count).zip(codes).for_each(|(byte, code)| *byte = code);
        }
        self.file.write_at(self.offset + (span.first * count) as u64, &bytes)?;
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
