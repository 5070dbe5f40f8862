//! `.ptm` with planes in JPEG: the writer.
//!
//! JPEG wants whole planes where coefficients come in runs of any order, so the codes of all planes are
//! held; [`held_bytes`] says what that takes.

use super::jpeg_planes::{CodedPlane, WORKING_PLANES, encode_plane};
use super::planar::{codes_of, coefficients};
use super::ptm::PtmCoding;
use super::ptm_header::file_role;
use super::{AssetHeader, AssetWriter, Created, assert_shape, check_complete};
use crate::{FormatError, OutputFile};
use relight_core::CoefficientSpan;
use relight_texture::{PackReport, PlaneErrors, StoringErrors};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

struct PtmJpegWriter {
    header: AssetHeader,
    coding: PtmCoding,
    quality: u8,
    held: Mutex<Held>,
    /// Errors of rounding to codes.
    errors: StoringErrors,
    file: OutputFile,
}

struct Held {
    /// Codes of each plane in the file's order, rows from the bottom.
    planes: Vec<Vec<u8>>,
    /// Pixels that have come.
    written: usize,
}

/// Bytes that writing `planes` planes holds: their codes, their files (which hardly ever exceed them) and
/// what making one takes.
pub(super) fn held_bytes(width: usize, height: usize, planes: usize) -> u64 {
    let of_a_plane = (width as u64).saturating_mul(height as u64);
    of_a_plane.saturating_mul(2 * planes as u64 + WORKING_PLANES)
}

/// Starts a `.ptm` asset with planes in JPEG of `quality`, 1 to 100.
pub(super) fn create(
    path: &Path,
    header: AssetHeader,
    coding: PtmCoding,
    quality: u8,
    memory_limit: u64,
) -> Created {
    let count = header.model.plane_count();
    let needed = held_bytes(header.width, header.height, count);
    if needed > memory_limit || usize::try_from(needed).is_err() {
        let (path, limit) = (path.to_owned(), memory_limit);
        let remedy = "raise --memory, or write .ptm without JPEG, which is streamed";
        return Err(FormatError::TooLarge { path, needed, limit, remedy });
    }
    let file = OutputFile::create(path)?;
    let planes = vec![vec![0; header.width * header.height]; count];
    let held = Mutex::new(Held { planes, written: 0 });
    let errors = StoringErrors::new(&header.model);
    Ok(Box::new(PtmJpegWriter { header, coding, quality, held, errors, file }))
}

impl AssetWriter for PtmJpegWriter {
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError> {
        assert_shape(&self.header, span);
        let AssetHeader { width, height, model, .. } = &self.header;
        let count = model.plane_count();
        let (mut errors, mut codes) = (vec![PlaneErrors::default(); count], Vec::with_capacity(count));
        for plane in 0..count {
            let role = file_role(model.layout, plane);
            let quantizer = self.coding.quantizer(model.layout, role);
            let values = coefficients(span, model, role, 0..span.pixels);
            codes.push(codes_of(&quantizer, values, span.first, &mut errors[role]));
        }
        self.errors.add(span.first, errors);
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        for (plane, codes) in held.planes.iter_mut().zip(&codes) {
            let mut start = 0;
            while start < span.pixels {
                let (x, y) = ((span.first + start) % width, (span.first + start) / width);
                let end = (start + width - x).min(span.pixels);
                let place = (height - 1 - y) * width + x;
                plane[place..place + end - start].copy_from_slice(&codes[start..end]);
                start = end;
            }
        }
        held.written += span.pixels;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<PackReport, FormatError> {
        let Self { header, coding, quality, held, errors, mut file } = *self;
        let Held { mut planes, written } = held.into_inner().unwrap_or_else(PoisonError::into_inner);
        check_complete(file.path(), &header, written)?;
        let (size, layout) = ((header.width, header.height), header.model.layout);
        let losses = StoringErrors::new(&header.model);
        let mut of_planes = vec![PlaneErrors::default(); planes.len()];
        let mut coded = Vec::with_capacity(planes.len());
        for i in 0..planes.len() {
            let (plane, decoded) = encode_plane(file.path(), &planes[i], &planes[..i], size, quality)?;
            let role = file_role(layout, i);
            let step = coding.quantizer(layout, role).scale / 255.0;
            let loss = decoded.iter().zip(&planes[i]).map(|(&a, &b)| step * (f32::from(a) - f32::from(b)));
            of_planes[role].add(0, loss);
            // Later planes are taken off what a reader sees of this one.
            planes[i] = decoded;
            coded.push(plane);
        }
        losses.add(0, of_planes);
        file.write_all(coding.head(&header, "JPEG_").as_bytes())?;
        file.write_all(tables(quality, &coded).as_bytes())?;
        for plane in &coded {
            file.write_all(&plane.jpeg)?;
            file.write_all(&plane.side)?;
        }
        file.finish()?;
        let pixels = header.width * header.height;
        Ok(together(&errors.report(pixels), &losses.report(pixels)))
    }
}

/// The eight lines that describe the planes.
fn tables(quality: u8, planes: &[CodedPlane]) -> String {
    let line = |number: &dyn Fn(usize, &CodedPlane) -> i64| {
        let words: Vec<_> =
            planes.iter().enumerate().map(|(i, plane)| number(i, plane).to_string()).collect();
        words.join(" ") + "\n"
    };
    let reference = |plane: &CodedPlane| plane.reference.map_or(-1, |reference| reference as i64);
    [
        format!("{quality}\n"),
        line(&|_, plane| i64::from(plane.inverted)),
        line(&|_, _| 0),
        line(&|_, _| 0),
        line(&|i, _| i as i64),
        line(&|_, plane| reference(plane)),
        line(&|_, plane| plane.jpeg.len() as i64),
        line(&|_, plane| plane.side.len() as i64),
    ]
    .concat()
}

/// What rounding and JPEG cost together: JPEG sees codes and knows nothing of what rounding took off, so
/// that their errors are independent and their squares add up.
pub(super) fn together(rounding: &PackReport, loss: &PackReport) -> PackReport {
    let both = |a: f64, b: f64| (a * a + b * b).sqrt();
    let all = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(&a, &b)| both(a, b)).collect();
    PackReport {
        rmse: all(&rounding.rmse, &loss.rmse),
        plane_relit_rmse: all(&rounding.plane_relit_rmse, &loss.plane_relit_rmse),
        relit_rmse: both(rounding.relit_rmse, loss.relit_rmse),
    }
}
