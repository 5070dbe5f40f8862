//! Web folders of CNR relight and OpenLIME: what they hold, and their writer.
//!
//! `info.json` and `plane_0.jpg`, `plane_1.jpg` .., three planes each as R, G, B, rows top-down. Source:
//! FORMATS.md of this project. JPEG wants whole planes where coefficients come in runs of any order, so the
//! codes of all planes are held; [`held_bytes`] says what that takes.

use super::exact_jpeg::decode_planes;
use super::planar::{UNIT, check_base_colors, codes_of, coefficients, plane_ranges};
use super::ptm_jpeg::together;
use super::web_functions::codes_on_square;
use super::web_info::{INFO, WebInfo, WebMaterial};
use super::web_jpeg::{WORKING_BYTES, encode_planes};
use super::web_tiles;
use super::{
    AssetHeader, AssetWriter, Created, WriteSettings, assert_shape, check_complete, check_finite,
    plane_quantizers,
};
use crate::FormatError;
use crate::error::check_memory;
use crate::output_folder::OutputFolder;
use relight_core::{Basis, CoefficientSpan, Layout, Model, Space};
use relight_texture::{PackReport, PlaneErrors, Quantizer, StoringErrors};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Quality of the planes' JPEG files unless another is asked for.
pub(super) const USUAL_QUALITY: u8 = 95;

/// Where a plane hardly varies around a value far from 0, steps of 1/32768 of that value are fine enough.
const LARGEST_BIAS: f32 = 32768.0;

/// The place in a file of each of our six functions; theirs are 1, u, v, u^2, uv, v^2.
const PTM_ORDER: [usize; 6] = [3, 5, 4, 1, 2, 0];

/// Planes of a file.
pub(super) const OF_A_FILE: usize = 3;

/// Where a plane of `Model::roles` is in a web folder.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Of the folder's planes, in order.
    pub(super) plane: usize,
    /// Whether it is that of the negated function.
    pub(super) negated: bool,
}

/// The word for a model's functions; `None` where a folder can't hold them.
fn kind_of(model: &Model) -> Option<&'static str> {
    match &model.basis {
        Basis::Ptm(_) => (model.maps() == PTM_ORDER.len()).then_some("ptm"),
        Basis::Hsh(_) => Some("hsh"),
        Basis::Sh(_) => Some("sh"),
        Basis::Learned(_) => Some("bilinear"),
        Basis::Srbf(_) => None,
    }
}

/// Why a web folder can't hold a model.
pub(super) fn refusal(model: &Model) -> Option<String> {
    let (family, count) = (model.basis.family().name, model.maps());
    let below = model.lights.iter().find(|light| light.z() < 0.0);
    if kind_of(model).is_none() {
        return Some(format!(
            "web holds basis ptm with 6 functions, hsh, sh, pca and --planes, not {family} with {count}; fit one \
             of these, or write .ktx2 or .exr"
        ));
    }
    if model.space != Space::Encoded {
        return Some(
            "web holds fits in encoded space, not linear; fit in encoded space, or write .ktx2".to_owned(),
        );
    }
    if model.layout == Layout::Lrgb && !model.maps().is_multiple_of(OF_A_FILE) {
        return Some(format!(
            "web holds luminance in 6, 9 .. functions, three to a file, not {count}; take --color rgb"
        ));
    }
    if model.channels() != 3 {
        return Some("web holds planes of coloured pictures, not of grey ones; write .ktx2".to_owned());
    }
    match (below, &model.basis) {
        (Some(light), Basis::Learned(_)) => Some(format!(
            "web holds functions of light from above the surface, not from below it (z = {:.3}); write .ktx2",
            light.z()
        )),
        _ => None,
    }
}

/// Where plane `role` of `Model::roles` is.
pub(super) fn place_of_role(model: &Model, role: usize) -> Place {
    let (maps, layout) = (model.maps(), model.layout);
    let function = role / layout.planes_per_map();
    let at = |function: usize| if let Basis::Ptm(_) = model.basis { PTM_ORDER[function] } else { function };
    let plane = match layout {
        Layout::Rgb => OF_A_FILE * at(function) + role % 3,
        Layout::Lrgb if role < maps => 3 + at(function),
        Layout::Lrgb => role - maps,
        Layout::Grey | Layout::Shared => role,
    };
    Place { plane, negated: function < maps && is_negated(&model.basis, function) }
}

/// Spherical harmonics of theirs lack the phase of Condon and Shortley, -1 for odd m.
fn is_negated(basis: &Basis, function: usize) -> bool {
    let degree = function.isqrt();
    matches!(basis, Basis::Sh(_)) && !(function - degree * degree + degree).is_multiple_of(2)
}

/// The name of a file of planes.
pub(super) fn file_name(file: usize) -> String {
    format!("plane_{file}.jpg")
}

/// Whether a folder may have a file of this name.
fn is_own(name: &str) -> bool {
    let number = name.strip_prefix("plane_").and_then(|rest| rest.strip_suffix(".jpg"));
    let described = name.strip_prefix("plane_").and_then(|rest| rest.strip_suffix(".dzi"));
    let number = number.or(described);
    name == INFO
        || web_tiles::is_tile(name)
        || number.is_some_and(|number| !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()))
}

/// Starts a folder at `path`.
pub(super) fn create_folder(path: &Path) -> Result<OutputFolder, FormatError> {
    OutputFolder::create(path, &[&[INFO], &["plane_0.jpg", "plane_0.dzi"]], is_own)
}

/// Bytes that writing holds: the codes of all planes and what making one file takes.
pub(super) fn held_bytes(width: usize, height: usize, model: &Model) -> u64 {
    let planes = model.plane_count().next_multiple_of(OF_A_FILE) as u64;
    (width as u64).saturating_mul(height as u64).saturating_mul(planes + WORKING_BYTES)
}

struct WebWriter {
    header: AssetHeader,
    /// One a plane, in the order of `Model::roles`.
    quantizers: Vec<Quantizer>,
    quality: u8,
    /// Whether planes are cut into tiles.
    deepzoom: bool,
    held: Mutex<Held>,
    /// Errors of rounding to codes.
    errors: StoringErrors,
    folder: OutputFolder,
}

struct Held {
    /// Codes of each plane in the folder's order; the last file is filled up with zeros.
    planes: Vec<Vec<u8>>,
    /// Pixels that have come.
    written: usize,
}

/// Starts a web folder; see [`super::AssetFormat::create`].
///
/// The range of a plane is that of its quantizer in the packing.
pub(super) fn create(path: &Path, header: AssetHeader, settings: &WriteSettings) -> Created {
    check_finite(path, &header)?;
    let AssetHeader { width, height, model, .. } = &header;
    check_memory(held_bytes(*width, *height, model), settings.memory_limit, path)?;
    let coefficients = model.maps() * model.layout.planes_per_map();
    check_base_colors(path, &plane_ranges(&header)[coefficients..])?;
    let mut quantizers: Vec<_> = plane_quantizers(&header).into_iter().map(with_finite_bias).collect();
    quantizers[coefficients..].fill(UNIT);
    let folder = create_folder(path)?;
    let planes = vec![vec![0; width * height]; model.plane_count().next_multiple_of(OF_A_FILE)];
    let held = Mutex::new(Held { planes, written: 0 });
    let errors = StoringErrors::new(model);
    let quality = settings.jpeg_quality.unwrap_or(USUAL_QUALITY);
    let deepzoom = settings.deepzoom;
    Ok(Box::new(WebWriter { header, quantizers, quality, deepzoom, held, errors, folder }))
}

/// A quantizer whose bias in the folder's terms, -bias / scale, exists.
fn with_finite_bias(quantizer: Quantizer) -> Quantizer {
    let scale = quantizer.scale.max(quantizer.bias.abs() / LARGEST_BIAS);
    if scale < f32::MIN_POSITIVE { UNIT } else { Quantizer { scale, ..quantizer } }
}

impl AssetWriter for WebWriter {
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError> {
        assert_shape(&self.header, span);
        let model = &self.header.model;
        let mut errors = vec![PlaneErrors::default(); self.quantizers.len()];
        let mut codes = Vec::with_capacity(self.quantizers.len());
        for (role, (quantizer, errors)) in self.quantizers.iter().zip(&mut errors).enumerate() {
            let values = coefficients(span, model, role, 0..span.pixels);
            codes.push(codes_of(quantizer, values, span.first, errors));
        }
        self.errors.add(span.first, errors);
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        for (role, codes) in codes.into_iter().enumerate() {
            let Place { plane, negated } = place_of_role(model, role);
            let flip = if negated { 255 } else { 0 };
            let places = &mut held.planes[plane][span.first..span.first + span.pixels];
            places.iter_mut().zip(codes).for_each(|(place, code)| *place = code ^ flip);
        }
        held.written += span.pixels;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<PackReport, FormatError> {
        let Self { header, quantizers, quality, deepzoom, held, errors, folder } = *self;
        let Held { mut planes, written } = held.into_inner().unwrap_or_else(PoisonError::into_inner);
        check_complete(folder.path(), &header, written)?;
        let AssetHeader { width, height, model, .. } = &header;
        // Planes that serve all channels have little in common; those of R, G and B have much. But spherical
        // harmonics, seen on half the sphere, have coefficients of several times white that cancel one another:
        // there the conversion's rounding would show.
        let in_common = model.layout != Layout::Shared && !matches!(model.basis, Basis::Sh(_));
        let mut of_planes = vec![PlaneErrors::default(); planes.len()];
        for (file, of_file) in planes.chunks_exact_mut(OF_A_FILE).enumerate() {
            let size = (*width, *height);
            let decoded = if deepzoom {
                web_tiles::write(&folder, file, of_file, size, quality, in_common)?
            } else {
                let jpeg = encode_planes(of_file, size, quality, in_common)
                    .map_err(|error| FormatError::invalid(folder.path(), error.to_string()))?;
                folder.write(&file_name(file), &jpeg)?;
                decode_planes(&jpeg, size, OF_A_FILE, folder.path(), u64::MAX)?
            };
            for (i, plane) in of_file.iter_mut().enumerate() {
                let decoded = decoded[i..].iter().step_by(OF_A_FILE);
                let losses = decoded.clone().zip(&*plane).map(|(&a, &b)| f32::from(a) - f32::from(b));
                of_planes[OF_A_FILE * file + i].add(0, losses);
                plane.iter_mut().zip(decoded).for_each(|(code, &decoded)| *code = decoded);
            }
        }
        let losses = StoringErrors::new(model);
        let by_role = quantizers.iter().enumerate().map(|(role, quantizer)| {
            let place = place_of_role(model, role).plane;
            std::mem::take(&mut of_planes[place]).scaled(quantizer.scale / 255.0)
        });
        losses.add(0, by_role.collect());
        let (info, square_error) = describe(&header, &quantizers, quality, &planes);
        let text = serde_json::to_string(&info)
            .map_err(|error| FormatError::invalid(folder.path(), error.to_string()))?;
        folder.write(INFO, text.as_bytes())?;
        folder.finish()?;
        let pixels = width * height;
        let mut report = together(&errors.report(pixels), &losses.report(pixels));
        report.relit_rmse = (report.relit_rmse * report.relit_rmse + square_error).sqrt();
        Ok(report)
    }
}

/// The description of a folder, and the mean squared error in relit samples of what it makes of learned
/// functions. `planes` are in the folder's order.
fn describe(
    header: &AssetHeader,
    quantizers: &[Quantizer],
    quality: u8,
    planes: &[Vec<u8>],
) -> (WebInfo, f64) {
    let AssetHeader { width, height, model, .. } = header;
    let mut material =
        WebMaterial { range: Vec::new(), scale: vec![1.0; planes.len()], bias: vec![0.0; planes.len()] };
    for (role, quantizer) in quantizers.iter().enumerate() {
        let Place { plane, negated } = place_of_role(model, role);
        let (scale, bias) = (f64::from(quantizer.scale), f64::from(quantizer.bias));
        material.scale[plane] = scale;
        material.bias[plane] = if negated { (scale + bias) / scale } else { -bias / scale };
    }
    let mut info = WebInfo {
        width: *width,
        height: *height,
        format: "jpg".to_owned(),
        kind: kind_of(model).unwrap_or_default().to_owned(),
        colorspace: match model.layout {
            Layout::Shared => "mrgb".to_owned(),
            Layout::Lrgb => "lrgb".to_owned(),
            Layout::Rgb | Layout::Grey => "rgb".to_owned(),
        },
        nplanes: Some(planes.len()),
        quality: Some(f64::from(quality)),
        lights: model.lights.iter().flat_map(|light| light.components().map(millionths)).collect(),
        sigma: None,
        resolution: None,
        basis: Vec::new(),
        materials: Vec::new(),
        pixel_size_in_mm: None,
        colorprofile: None,
    };
    let mut square_error = 0.0;
    if let Basis::Learned(learned) = &model.basis {
        let left_out =
            model.figures.map(|figures| figures.leave_one_out_rmse).filter(|rmse| rmse.is_finite());
        let squares: Vec<f64> =
            quantizers.iter().zip(planes).map(|(quantizer, codes)| mean_square(*quantizer, codes)).collect();
        let mut codes = codes_on_square(learned, &model.lights, &squares, left_out);
        // Planes that fill up the last file weigh nothing.
        let of_a_row = 3 * codes.edge * codes.edge;
        codes.basis.resize((planes.len() + 1) * of_a_row, 127.0);
        codes.range.resize(planes.len(), 1.0);
        (info.resolution, info.basis, material.range) = (Some(codes.edge), codes.basis, codes.range);
        square_error = codes.square_error;
    }
    info.materials = vec![material];
    (info, square_error)
}

/// Rounded to millionths: more would be read by nobody.
fn millionths(component: f64) -> f64 {
    (component * 1e6).round() / 1e6
}

/// Mean square of the coefficients of a plane.
fn mean_square(quantizer: Quantizer, codes: &[u8]) -> f64 {
    let mut counts = [0u64; 256];
    codes.iter().for_each(|&code| counts[usize::from(code)] += 1);
    let of_code = |(code, &count): (usize, &u64)| {
        let value = f64::from(quantizer.scale) * (code as f64 / 255.0) + f64::from(quantizer.bias);
        value * value * count as f64
    };
    counts.iter().enumerate().map(of_code).sum::<f64>() / codes.len().max(1) as f64
}
