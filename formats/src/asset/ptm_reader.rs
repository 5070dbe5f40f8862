//! `.ptm`: the reader of PTM_1.1 and PTM_1.2, RGB and LRGB.
//!
//! Source: FORMATS.md of this project. Headers are read word by word, so that width and height may
//! share a line and lines may end in blanks or a carriage return.

use super::ptm::{FUNCTIONS, quantizer_of};
use super::{AssetHeader, Details, open_measured, planar, plane_bytes};
use crate::FormatError;
use relight_core::basis::Ptm;
use relight_core::{Basis, Layout, Model, RelightingMap, RelightingMaps, Space, Texels};
use relight_texture::{Precision, Quantizer, TexelFormat};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// The longest header that is read.
const LONGEST_HEADER: u64 = 4096;

struct PtmFile {
    file: File,
    header: AssetHeader,
    version: String,
    /// One per function.
    scale_bias: Vec<(f32, f64)>,
    /// Where the coefficients begin.
    offset: u64,
}

/// Words of a header, with the place after the last.
struct Words<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Words<'a> {
    fn next(&mut self, what: &str) -> Result<&'a str, FormatError> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        self.at += start + length;
        match std::str::from_utf8(&rest[start..start + length]) {
            Ok(word) if !word.is_empty() => Ok(word),
            _ => Err(FormatError::invalid(self.path, format!("its header ends before {what}"))),
        }
    }

    fn number(&mut self, what: &str) -> Result<f64, FormatError> {
        let word = self.next(what)?;
        word.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| {
            FormatError::invalid(self.path, format!("{what} '{word}' in its header is not a finite number"))
        })
    }

    fn dimension(&mut self, what: &str) -> Result<u32, FormatError> {
        let word = self.next(what)?;
        word.parse().ok().filter(|&value| value > 0).ok_or_else(|| {
            let problem = format!("{what} '{word}' in its header is outside 1..4294967295");
            FormatError::invalid(self.path, problem)
        })
    }

    /// The place after the line's end.
    fn end_of_line(&mut self) -> Result<usize, FormatError> {
        let rest = &self.bytes[self.at..];
        let blanks = rest.iter().take_while(|b| matches!(b, b' ' | b'\t' | b'\r')).count();
        match rest.get(blanks) {
            Some(b'\n') => Ok(self.at + blanks + 1),
            _ => Err(FormatError::invalid(self.path, "its header does not end with a line of six biases")),
        }
    }
}

/// Reads a `.ptm` asset; see [`super::read_asset`].
pub(super) fn read(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    let mut ptm = open(path)?;
    let AssetHeader { width, height, model, .. } = &ptm.header;
    let format = TexelFormat::Plain { precision: Precision::U8, channels: 1 };
    let needed = plane_bytes(*width, *height, model, format);
    if needed > memory_limit || usize::try_from(needed).is_err() {
        return Err(FormatError::too_large(path, needed, memory_limit));
    }
    let planes = read_planes(&mut ptm).map_err(|e| match e.kind() {
        io::ErrorKind::UnexpectedEof => FormatError::invalid(path, "is cut short"),
        _ => FormatError::io(path, "read", e),
    })?;
    let AssetHeader { width, height, model, .. } = ptm.header;
    Ok(RelightingMaps { width, height, model, planes })
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    let ptm = open(path)?;
    let words =
        |word: fn(&(f32, f64)) -> String| ptm.scale_bias.iter().map(word).collect::<Vec<_>>().join(" ");
    let rows = vec![
        ("version".to_owned(), ptm.version.clone()),
        ("scales".to_owned(), words(|(scale, _)| scale.to_string())),
        ("biases".to_owned(), words(|(_, bias)| bias.to_string())),
    ];
    Ok((ptm.header, Details { rows, ..Details::default() }))
}

/// Reads and checks the header, and the file's size against it.
fn open(path: &Path) -> Result<PtmFile, FormatError> {
    let (file, file_bytes) = open_measured(path)?;
    let mut start = Vec::new();
    (&file).take(LONGEST_HEADER).read_to_end(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    let mut words = Words { path, bytes: &start, at: 0 };
    let version = words.next("its version")?.to_owned();
    if version != "PTM_1.1" && version != "PTM_1.2" {
        let problem = format!("is of version {version}; relight reads PTM_1.1 and PTM_1.2");
        return Err(FormatError::unsupported(path, problem));
    }
    let layout = match words.next("its format")? {
        "PTM_FORMAT_RGB" => Layout::Rgb,
        "PTM_FORMAT_LRGB" => Layout::Lrgb,
        other => {
            let problem = format!(
                "holds {other}; relight reads PTM_FORMAT_RGB and PTM_FORMAT_LRGB, to which PTM tools convert"
            );
            return Err(FormatError::unsupported(path, problem));
        }
    };
    let (width, height) = (words.dimension("width")?, words.dimension("height")?);
    let mut scales = [0.0f32; FUNCTIONS];
    for scale in &mut scales {
        let value = words.number("a scale")?;
        *scale = value as f32;
        if !scale.is_finite() {
            return Err(FormatError::invalid(path, format!("scale {value} exceeds 3.4e38")));
        }
    }
    let mut scale_bias = Vec::new();
    for scale in scales {
        let bias = words.number("a bias")?;
        if !quantizer_of(scale, bias).bias.is_finite() {
            return Err(FormatError::invalid(
                path,
                format!("bias {bias} times scale {scale} exceeds 3.4e38"),
            ));
        }
        scale_bias.push((scale, bias));
    }
    let offset = words.end_of_line()? as u64;
    let pixel_bytes: u64 = if layout == Layout::Rgb { 18 } else { 9 };
    let expected = (u64::from(width) * u64::from(height)).checked_mul(pixel_bytes);
    if expected.is_none_or(|expected| expected > file_bytes - offset) {
        let found = file_bytes - offset;
        let problem =
            format!("is cut short: {width} x {height} pixels of {pixel_bytes} bytes in {found} bytes");
        return Err(FormatError::invalid(path, problem));
    }
    let ptm = Ptm::with_count(FUNCTIONS).map_err(|e| FormatError::invalid(path, e.to_string()))?;
    let model =
        Model { basis: Basis::Ptm(ptm), layout, space: Space::Encoded, lights: Vec::new(), figures: None };
    let (width, height) = (width as usize, height as usize);
    let quantizers = (0..model.plane_count()).map(|plane| quantizer_of_plane(&scale_bias, layout, plane));
    let packing = planar::packing(Precision::U8, quantizers);
    let header = AssetHeader { width, height, model, packing };
    Ok(PtmFile { file, header, version, scale_bias, offset })
}

/// The quantizer of plane `plane` of `Model::roles`; base colours have none of their own.
fn quantizer_of_plane(scale_bias: &[(f32, f64)], layout: Layout, plane: usize) -> Quantizer {
    match scale_bias.get(plane / layout.planes_per_map()) {
        Some(&(scale, bias)) => quantizer_of(scale, bias),
        None => Quantizer { scale: 1.0, bias: 0.0 },
    }
}

/// Reads the planes in the order of `Model::roles`.
fn read_planes(ptm: &mut PtmFile) -> io::Result<Vec<RelightingMap>> {
    let AssetHeader { width, height, model, .. } = &ptm.header;
    let (width, pixels) = (*width, width * height);
    ptm.file.seek(SeekFrom::Start(ptm.offset))?;
    let mut file = io::BufReader::with_capacity(1 << 20, &ptm.file);
    let mut planes = vec![vec![0u8; pixels]; model.plane_count()];
    // Reads a block of some bytes a pixel, where byte i belongs to plane `plane(i)`.
    let mut read_block = |bytes: usize, plane: &dyn Fn(usize) -> usize| -> io::Result<()> {
        let mut row = vec![0; width * bytes];
        for y in (0..pixels / width).rev() {
            file.read_exact(&mut row)?;
            for i in 0..bytes {
                let out = &mut planes[plane(i)][y * width..][..width];
                for (code, pixel) in out.iter_mut().zip(row.chunks_exact(bytes)) {
                    *code = pixel[i];
                }
            }
        }
        Ok(())
    };
    match model.layout {
        Layout::Rgb | Layout::Grey | Layout::Shared => {
            for channel in 0..3 {
                read_block(FUNCTIONS, &|j| 3 * j + channel)?;
            }
        }
        // Nine bytes a pixel before 1.2, two blocks since.
        Layout::Lrgb if ptm.version == "PTM_1.1" => read_block(FUNCTIONS + 3, &|i| i)?,
        Layout::Lrgb => {
            read_block(FUNCTIONS, &|i| i)?;
            read_block(3, &|channel| FUNCTIONS + channel)?;
        }
    }
    let map = |(plane, codes)| {
        let quantizer = quantizer_of_plane(&ptm.scale_bias, model.layout, plane);
        RelightingMap { scale: quantizer.scale, bias: quantizer.bias, texels: Texels::U8(codes) }
    };
    Ok(planes.into_iter().enumerate().map(map).collect())
}
