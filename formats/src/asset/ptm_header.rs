//! `.ptm`: what its header says.
//!
//! Source: FORMATS.md of this project. Headers are read word by word, so that width and height may
//! share a line and lines may end in blanks or a carriage return.

use super::header_words::{HeaderWords, LONGEST_HEADER};
use super::ptm::{FUNCTIONS, quantizer_of};
use super::{AssetHeader, open_measured, planar};
use crate::FormatError;
use relight_core::basis::Ptm;
use relight_core::{Basis, CoefficientRange, Layout, Model, Space};
use relight_texture::{Precision, Quantizer};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Forms that are read.
const READ: [&str; 5] =
    ["PTM_FORMAT_RGB", "PTM_FORMAT_LRGB", "PTM_FORMAT_LUM", "PTM_FORMAT_JPEG_RGB", "PTM_FORMAT_JPEG_LRGB"];

/// Forms that are known by name and not read.
const REFUSED: [&str; 4] =
    ["PTM_FORMAT_PTM_LUT", "PTM_FORMAT_PTM_C_LUT", "PTM_FORMAT_JPEGLS_RGB", "PTM_FORMAT_JPEGLS_LRGB"];

/// How the pixels of a `.ptm` are stored.
pub(super) enum PtmForm {
    /// Three blocks of six coefficients a pixel.
    Rgb,
    /// Six coefficients and a colour a pixel: in two blocks, or side by side as before 1.2.
    Lrgb { interleaved: bool },
    /// Six coefficients of luminance and Cr, Cb a pixel, and what makes a colour of them.
    Lum(ColorMatrix),
    /// Planes in JPEG files, in the order of [`file_role`].
    Jpeg { quality: i64, planes: Vec<JpegPlane> },
}

/// From (Y, Cr, Cb, 1) to R, G, B, all in 0..255 units.
pub(super) type ColorMatrix = [[f64; 4]; 3];

/// A plane in JPEG: where it lies, and from which other one it was predicted.
#[derive(Debug)]
pub(super) struct JpegPlane {
    /// The plane that was taken off, if one was.
    pub(super) reference: Option<usize>,
    /// Whether it was inverted before.
    pub(super) inverted: bool,
    /// Bytes of the JPEG file.
    pub(super) bytes: u64,
    /// Bytes of the side information behind it.
    pub(super) side_bytes: u64,
}

/// A `.ptm` file before its first pixel.
pub(super) struct PtmFile {
    pub(super) file: File,
    pub(super) header: AssetHeader,
    pub(super) version: String,
    /// The word in its header.
    pub(super) format: String,
    pub(super) form: PtmForm,
    /// One per function.
    pub(super) scale_bias: Vec<(f32, f64)>,
    /// Where the pixels begin.
    pub(super) offset: u64,
}

/// The place in `Model::roles` of plane `plane` of a file that stores planes one by one: the functions
/// of R, of G, of B; or those of luminance, then R, G, B.
pub(super) fn file_role(layout: Layout, plane: usize) -> usize {
    match layout {
        Layout::Rgb => 3 * (plane % FUNCTIONS) + plane / FUNCTIONS,
        Layout::Lrgb | Layout::Grey | Layout::Shared => plane,
    }
}

/// Reads and checks the header, and the file's size against it.
pub(super) fn open(path: &Path) -> Result<PtmFile, FormatError> {
    let (file, file_bytes) = open_measured(path)?;
    let mut start = Vec::new();
    (&file).take(LONGEST_HEADER).read_to_end(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    let mut words = HeaderWords::new(path, &start);
    let version = words.next("its version")?.to_owned();
    if version != "PTM_1.1" && version != "PTM_1.2" {
        let problem = format!("is of version {version}; relight reads PTM_1.1 and PTM_1.2");
        return Err(FormatError::unsupported(path, problem));
    }
    let format = words.next("its format")?.to_owned();
    if !READ.contains(&format.as_str()) {
        return Err(unknown_format(path, &format));
    }
    let (width, height) = (words.dimension("width")?, words.dimension("height")?);
    let scale_bias = scales_and_biases(path, &mut words)?;
    let (form, layout, last) = match format.as_str() {
        "PTM_FORMAT_RGB" => (PtmForm::Rgb, Layout::Rgb, "six biases"),
        "PTM_FORMAT_LRGB" => {
            (PtmForm::Lrgb { interleaved: version == "PTM_1.1" }, Layout::Lrgb, "six biases")
        }
        "PTM_FORMAT_LUM" => (PtmForm::Lum(color_matrix(path, &mut words)?), Layout::Rgb, "sixteen numbers"),
        "PTM_FORMAT_JPEG_RGB" => {
            (jpeg_tables(path, &mut words, 3 * FUNCTIONS)?, Layout::Rgb, "eighteen sizes")
        }
        "PTM_FORMAT_JPEG_LRGB" => (jpeg_tables(path, &mut words, FUNCTIONS + 3)?, Layout::Lrgb, "nine sizes"),
        _ => return Err(unknown_format(path, &format)),
    };
    let offset = words.end_of_line(last)? as u64;
    check_length(path, (width, height), &form, file_bytes - offset)?;
    let ptm = Ptm::with_count(FUNCTIONS).map_err(|e| FormatError::invalid(path, e.to_string()))?;
    let model = Model {
        basis: Basis::Ptm(ptm),
        layout,
        space: Space::Encoded,
        lights: Vec::new(),
        figures: None,
        provenance: None,
    };
    let quantizers: Vec<_> =
        (0..model.plane_count()).map(|role| quantizer_of_role(&scale_bias, &form, layout, role)).collect();
    if quantizers.iter().any(|q| !q.scale.is_finite() || !q.bias.is_finite()) {
        return Err(FormatError::invalid(path, "its colour matrix times scales and biases exceeds 3.4e38"));
    }
    let precision = if matches!(form, PtmForm::Lum(_)) { Precision::F16 } else { Precision::U8 };
    let packing = planar::packing(precision, quantizers.into_iter());
    let header = AssetHeader { width, height, model, packing };
    Ok(PtmFile { file, header, version, format, form, scale_bias, offset })
}

fn unknown_format(path: &Path, format: &str) -> FormatError {
    let read = READ.join(", ");
    let problem = if REFUSED.contains(&format) {
        format!("holds {format}; relight reads {read}, to which PTM tools convert")
    } else {
        format!("holds '{format}', which is no format of PTM files; relight reads {read}")
    };
    FormatError::unsupported(path, problem)
}

fn scales_and_biases(path: &Path, words: &mut HeaderWords<'_>) -> Result<Vec<(f32, f64)>, FormatError> {
    let mut scales = [0.0f32; FUNCTIONS];
    for scale in &mut scales {
        let value = words.number("a scale")?;
        *scale = value as f32;
        if !scale.is_finite() {
            return Err(FormatError::invalid(path, format!("scale {value} exceeds 3.4e38")));
        }
    }
    scales
        .into_iter()
        .map(|scale| {
            let bias = words.number("a bias")?;
            if !quantizer_of(scale, bias).bias.is_finite() {
                let problem = format!("bias {bias} times scale {scale} exceeds 3.4e38");
                return Err(FormatError::invalid(path, problem));
            }
            Ok((scale, bias))
        })
        .collect()
}

/// The 4 x 4 numbers of a LUM file. They act on columns (Y, Cr, Cb, 1) where they end with a row
/// `0 0 0 x`, and on rows where they end with such a column.
fn color_matrix(path: &Path, words: &mut HeaderWords<'_>) -> Result<ColorMatrix, FormatError> {
    let mut m = [[0.0; 4]; 4];
    for number in m.iter_mut().flatten() {
        *number = words.number("a number of the colour matrix")?;
    }
    if m[3][..3] == [0.0; 3] {
        Ok([m[0], m[1], m[2]])
    } else if (0..3).all(|row| m[row][3] == 0.0) {
        Ok([0, 1, 2].map(|column| [0, 1, 2, 3].map(|row| m[row][column])))
    } else {
        let problem = "its colour matrix ends with neither a row nor a column of 0 0 0 1; convert the file to \
                       PTM_FORMAT_RGB with the program that wrote it";
        Err(FormatError::unsupported(path, problem))
    }
}

/// The eight lines that describe planes in JPEG. The line of the order in which planes are to be decoded
/// says nothing that their references don't.
fn jpeg_tables(path: &Path, words: &mut HeaderWords<'_>, count: usize) -> Result<PtmForm, FormatError> {
    let last = count as i64 - 1;
    let any = i64::from(i32::MIN)..=i64::from(i32::MAX);
    let size = 0..=i64::from(u32::MAX);
    let quality = words.integer("the JPEG quality", any.clone())?;
    let mut line = |what: &str, range: &std::ops::RangeInclusive<i64>| -> Result<Vec<i64>, FormatError> {
        (0..count).map(|_| words.integer(what, range.clone())).collect()
    };
    let transforms = line("a transform", &(0..=3))?;
    let motion = [line("a motion", &any)?, line("a motion", &any)?];
    line("a place in the order of planes", &any)?;
    let references = line("a reference", &(-1..=last))?;
    let (bytes, side_bytes) = (line("a size", &size)?, line("a size of side information", &size)?);
    let mut planes = Vec::with_capacity(count);
    for i in 0..count {
        if transforms[i] & 2 != 0 && motion.iter().any(|motion| motion[i] != 0) {
            let problem = format!(
                "moves a plane before it takes it off another (motion compensation of plane {i}), which relight \
                 does not read; convert the file to PTM_FORMAT_RGB or LRGB with the program that wrote it"
            );
            return Err(FormatError::unsupported(path, problem));
        }
        if side_bytes[i] % 5 != 0 {
            let problem =
                format!("side information of {} bytes is no whole number of 5 bytes", side_bytes[i]);
            return Err(FormatError::invalid(path, problem));
        }
        planes.push(JpegPlane {
            reference: usize::try_from(references[i]).ok(),
            inverted: transforms[i] & 1 != 0,
            bytes: bytes[i] as u64,
            side_bytes: side_bytes[i] as u64,
        });
    }
    Ok(PtmForm::Jpeg { quality, planes })
}

/// Refuses a file of which less than its header says follows the header: `found` bytes.
fn check_length(path: &Path, size: (usize, usize), form: &PtmForm, found: u64) -> Result<(), FormatError> {
    let pixel_bytes = match form {
        PtmForm::Rgb => 3 * FUNCTIONS as u64,
        PtmForm::Lrgb { .. } => FUNCTIONS as u64 + 3,
        PtmForm::Lum(_) => LUM_BYTES as u64,
        PtmForm::Jpeg { planes, .. } => {
            let expected: u64 = planes.iter().map(|plane| plane.bytes + plane.side_bytes).sum();
            if expected > found {
                let problem = format!("is cut short: planes of {expected} bytes in {found} bytes");
                return Err(FormatError::invalid(path, problem));
            }
            return Ok(());
        }
    };
    planar::check_pixels(path, size, pixel_bytes, found)
}

/// Bytes of a pixel with luminance and chrominance.
pub(super) const LUM_BYTES: usize = FUNCTIONS + 2;

/// The quantizer of plane `role` of `Model::roles`.
///
/// The texels of a LUM file's planes are halves: the file's codes as they are, but for the constants, to
/// which chrominance adds, and which are coefficients.
pub(super) fn quantizer_of_role(
    scale_bias: &[(f32, f64)],
    form: &PtmForm,
    layout: Layout,
    role: usize,
) -> Quantizer {
    let stride = layout.planes_per_map();
    let (function, channel) = (role / stride, role % stride);
    let Some(&(scale, bias)) = scale_bias.get(function) else {
        // Base colours.
        return planar::UNIT;
    };
    match form {
        PtmForm::Lum(matrix) if function == FUNCTIONS - 1 => {
            let largest = largest_constant(&matrix[channel], (scale, bias)) as f32;
            Precision::F16.quantizer(CoefficientRange { min: -largest, max: largest })
        }
        PtmForm::Lum(matrix) => {
            let step = matrix[channel][0] * f64::from(scale) / 255.0;
            Quantizer { scale: step as f32, bias: (-bias * step) as f32 }
        }
        _ => quantizer_of(scale, bias),
    }
}

/// No constant coefficient of a LUM file can exceed it, 1 for white.
fn largest_constant(row: &[f64; 4], (scale, bias): (f32, f64)) -> f64 {
    let luminance = bias.abs().max((255.0 - bias).abs()) * f64::from(scale.abs());
    (row[0].abs() * luminance + 255.0 * (row[1].abs() + row[2].abs()) + row[3].abs()) / 255.0
}
