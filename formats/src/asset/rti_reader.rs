//! `.rti`: the reader of HSH1.2 with hemispherical harmonics.
//!
//! Source: FORMATS.md of this project.

use super::header_words::{HeaderWords, LONGEST_HEADER};
use super::rti::{BASIS_TYPES, TERMS, place_in_pixel};
use super::{AssetHeader, Details, open_measured, planar, plane_bytes, plane_quantizers};
use crate::FormatError;
use crate::error::check_memory;
use relight_core::basis::Hsh;
use relight_core::{Basis, Model, RelightingMap, RelightingMaps, Space, Texels};
use relight_texture::{Precision, Quantizer, TexelFormat};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// The one version.
const VERSION: &str = "#HSH1.2";

/// Kinds of files, by their number; one is read.
const KINDS: [(i64, &str); 4] =
    [(1, "PTM"), (2, "spherical harmonics"), (HSH, "hemispherical harmonics"), (4, "an adaptive basis")];
const HSH: i64 = 3;

struct RtiFile {
    file: File,
    header: AssetHeader,
    /// One per term.
    quantizers: Vec<Quantizer>,
    /// Where the pixels begin.
    offset: u64,
}

/// Reads an `.rti` asset; see [`super::read_asset`].
pub(super) fn read(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    let mut rti = open(path)?;
    let AssetHeader { width, height, model, .. } = &rti.header;
    let format = TexelFormat::Plain { precision: Precision::U8, channels: 1 };
    let needed = plane_bytes(*width, *height, model, format);
    check_memory(needed, memory_limit, path)?;
    let texels = read_texels(&mut rti).map_err(|e| match e.kind() {
        io::ErrorKind::UnexpectedEof => FormatError::invalid(path, "is cut short"),
        _ => FormatError::io(path, "read", e),
    })?;
    let planes = plane_quantizers(&rti.header)
        .into_iter()
        .zip(texels)
        .map(|(q, codes)| RelightingMap { scale: q.scale, bias: q.bias, texels: Texels::U8(codes) })
        .collect();
    let AssetHeader { width, height, model, .. } = rti.header;
    Ok(RelightingMaps { width, height, model, planes })
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    let rti = open(path)?;
    let words = |word: fn(&Quantizer) -> f32| {
        rti.quantizers.iter().map(|q| word(q).to_string()).collect::<Vec<_>>().join(" ")
    };
    let rows = vec![
        ("version".to_owned(), VERSION[1..].to_owned()),
        ("scales".to_owned(), words(|q| q.scale)),
        ("biases".to_owned(), words(|q| q.bias)),
    ];
    Ok((rti.header, Details { rows, ..Details::default() }))
}

/// Reads and checks the header, and the file's size against it.
fn open(path: &Path) -> Result<RtiFile, FormatError> {
    let (file, file_bytes) = open_measured(path)?;
    let mut start = Vec::new();
    (&file).take(LONGEST_HEADER).read_to_end(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    let unsupported = |problem: String| Err(FormatError::unsupported(path, problem));
    let mut words = HeaderWords::new(path, &start);
    let version = words.next("its version")?;
    if version != VERSION {
        return unsupported(format!("is of version {version}; relight reads {VERSION}"));
    }
    words.skip_comments();
    let kind = words.integer("its kind", 1..=4)?;
    if let Some((_, name)) = KINDS.iter().find(|(number, _)| *number == kind && kind != HSH) {
        return unsupported(format!("holds {name} (kind {kind}); relight reads hemispherical harmonics (3)"));
    }
    words.skip_comments();
    let (width, height) = (words.dimension("width")?, words.dimension("height")?);
    words.integer("its number of channels", 3..=3)?;
    words.skip_comments();
    let terms = words.integer("its number of terms", 1..=i64::from(u16::MAX))? as usize;
    if !TERMS.contains(&terms) {
        return unsupported(format!("has {terms} terms; relight reads 4, 9 and 16"));
    }
    let basis_type = words.integer("its basis type", 0..=i64::from(u16::MAX))?;
    let Some(&(_, layout)) = BASIS_TYPES.iter().find(|(word, _)| *word == basis_type) else {
        return unsupported(format!("has basis type {basis_type}; relight reads 1 (LRGB) and 2 (RGB)"));
    };
    let element = words.integer("its element size", 0..=i64::from(u16::MAX))?;
    if element != 1 {
        return unsupported(format!("has elements of {element} bytes; relight reads those of 1"));
    }
    let scales_at = words.end_of_line("terms, basis type and element size")?;
    let offset = scales_at + 8 * terms;
    let Some(numbers) = start.get(scales_at..offset) else {
        return Err(FormatError::invalid(path, "is cut short within its scales and biases"));
    };
    let quantizers = quantizers(path, numbers)?;
    let hsh = Hsh::with_count(terms).map_err(|e| FormatError::invalid(path, e.to_string()))?;
    let model = Model {
        basis: Basis::Hsh(hsh),
        layout,
        space: Space::Encoded,
        lights: Vec::new(),
        figures: None,
        provenance: None,
    };
    let pixel_bytes = model.plane_count() as u64;
    let found = file_bytes.saturating_sub(offset as u64);
    planar::check_pixels(path, (width, height), pixel_bytes, found)?;
    let of_role = |role: usize| match quantizers.get(role / layout.planes_per_map()) {
        Some(&quantizer) => quantizer,
        None => planar::UNIT,
    };
    let packing = planar::packing(Precision::U8, (0..model.plane_count()).map(of_role));
    let header = AssetHeader { width, height, model, packing };
    Ok(RtiFile { file, header, quantizers, offset: offset as u64 })
}

/// Scales, then biases, 32-bit floats with the least significant byte first.
fn quantizers(path: &Path, numbers: &[u8]) -> Result<Vec<Quantizer>, FormatError> {
    let floats: Vec<f32> =
        numbers.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let (scales, biases) = floats.split_at(floats.len() / 2);
    let pairs = scales.iter().zip(biases).enumerate();
    pairs
        .map(|(term, (&scale, &bias))| {
            // What the largest byte gives must be finite, too.
            if !(scale + bias).is_finite() || !scale.is_finite() {
                let problem = format!("term {term} has scale {scale} and bias {bias}, which must be finite");
                return Err(FormatError::invalid(path, problem));
            }
            Ok(Quantizer { scale, bias })
        })
        .collect()
}

/// Reads the codes of the planes in the order of `Model::roles`.
fn read_texels(rti: &mut RtiFile) -> io::Result<Vec<Vec<u8>>> {
    let AssetHeader { width, height, model, .. } = &rti.header;
    rti.file.seek(SeekFrom::Start(rti.offset))?;
    let mut file = io::BufReader::with_capacity(1 << 20, &rti.file);
    let count = model.plane_count();
    let mut planes = vec![vec![0u8; width * height]; count];
    let mut row = vec![0; width * count];
    for y in 0..*height {
        file.read_exact(&mut row)?;
        for (role, plane) in planes.iter_mut().enumerate() {
            let place = place_in_pixel(model.layout, model.maps(), role);
            let codes = row[place..].iter().step_by(count);
            for (code, &byte) in plane[y * width..][..*width].iter_mut().zip(codes) {
                *code = byte;
            }
        }
    }
    Ok(planes)
}
