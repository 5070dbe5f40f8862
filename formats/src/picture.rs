//! Pictures as cameras and renderers store them: JPEG, PNG, TIFF, OpenEXR and Radiance HDR, read
//! at the precision of the file and never converted.
//!
//! A format is told by its first bytes, never by the file's name. Adding one is one file here and
//! one row in `FORMATS`.

mod icc;
mod jpeg;
mod jpeg_bytes;
mod openexr;
mod png;
mod radiance;
mod tiff;

pub(crate) use jpeg::damaged as damaged_jpeg;

use crate::FormatError;
use crate::error::check_memory;
use half::f16;
use relight_core::CpuLevel;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// How one sample is stored, in rising precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SampleType {
    /// Unsigned 8 bits; 255 is 1.
    U8,
    /// Unsigned 16 bits; 65535 is 1.
    U16,
    /// IEEE half, any finite value.
    F16,
    /// IEEE single, any finite value.
    F32,
}

impl SampleType {
    /// Bytes of one sample: 1, 2 or 4.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// Whether samples are floating point (and by convention linear light).
    pub fn is_float(self) -> bool {
        matches!(self, Self::F16 | Self::F32)
    }
}

/// The samples of one picture at the precision of its file; integers in native byte order.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 0..255.
    U8(Vec<u8>),
    /// 0..65535.
    U16(Vec<u16>),
    /// Finite halves.
    F16(Vec<f16>),
    /// Finite singles.
    F32(Vec<f32>),
}

impl Samples {
    /// The number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(samples) => samples.len(),
            Self::U16(samples) => samples.len(),
            Self::F16(samples) => samples.len(),
            Self::F32(samples) => samples.len(),
        }
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What a picture is, from its header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureInfo {
    /// Pixels in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// 1 (grey) or 3 (R, G, B).
    pub channels: usize,
    /// How a sample is stored.
    pub sample_type: SampleType,
    /// Whether the file holds an alpha channel; it is never among the samples.
    pub alpha: bool,
    /// The description of an embedded ICC profile that isn't sRGB; `None` if absent or sRGB.
    pub color_profile: Option<String>,
    /// EXIF orientation 2..8; `None` if upright or absent. The samples aren't turned by it.
    pub orientation: Option<u8>,
}

impl PictureInfo {
    /// Bytes of all samples.
    pub(crate) fn bytes(&self) -> u64 {
        pixels(self.width, self.height)
            .saturating_mul(self.channels as u64)
            .saturating_mul(self.sample_type.bytes() as u64)
    }
}

/// A picture in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodedPicture {
    /// What it is.
    pub info: PictureInfo,
    /// width x height x channels, interleaved, rows from the top, pixels from the left.
    pub samples: Samples,
}

/// What decoders read headers from.
trait Source: BufRead + Seek {}
impl<T: BufRead + Seek> Source for T {}

/// One row of the table of formats.
struct Format {
    name: &'static str,
    /// File name extensions in lower case, the usual one first: for finding pictures, not for reading them.
    extensions: &'static [&'static str],
    is_magic: fn(&[u8]) -> bool,
    probe: fn(&mut dyn Source, &Path) -> Result<PictureInfo, FormatError>,
    decode: fn(&[u8], &Path, CpuLevel, u64) -> Result<DecodedPicture, FormatError>,
}

/// The one that is read within files of other kinds, too.
const JPEG: Format = Format {
    name: "JPEG",
    extensions: &["jpg", "jpeg", "jpe", "jfif"],
    is_magic: jpeg::is_magic,
    probe: jpeg::probe,
    decode: jpeg::decode,
};

/// All formats that can be read.
const FORMATS: [Format; 5] = [
    JPEG,
    Format {
        name: "PNG",
        extensions: &["png"],
        is_magic: png::is_magic,
        probe: png::probe,
        decode: png::decode,
    },
    Format {
        name: "TIFF",
        extensions: &["tif", "tiff"],
        is_magic: tiff::is_magic,
        probe: tiff::probe,
        decode: tiff::decode,
    },
    Format {
        name: "OpenEXR",
        extensions: &["exr"],
        is_magic: openexr::is_magic,
        probe: openexr::probe,
        decode: openexr::decode,
    },
    Format {
        name: "Radiance HDR",
        extensions: &["hdr", "pic"],
        is_magic: radiance::is_magic,
        probe: radiance::probe,
        decode: radiance::decode,
    },
];

/// First bytes that tell every format from the others.
const MAGIC_BYTES: usize = 16;

/// Whether a file of this name may be a picture that can be read, by its extension in any case.
///
/// For listing folders only: what a file is, [`probe`] tells by its bytes.
pub fn has_picture_extension(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    extension
        .is_some_and(|extension| FORMATS.iter().any(|format| format.extensions.contains(&extension.as_str())))
}

/// Reads a picture's header: no sample is decoded.
///
/// # Errors
/// [`FormatError::Io`] when the file can't be read, [`FormatError::Invalid`] when its header is
/// damaged, [`FormatError::Unsupported`] when it is no picture or of a kind that isn't read.
pub fn probe(path: &Path) -> Result<PictureInfo, FormatError> {
    let file = File::open(path).map_err(|source| FormatError::io(path, "open", source))?;
    let mut reader = BufReader::new(file);
    let mut magic = Vec::with_capacity(MAGIC_BYTES);
    (&mut reader)
        .take(MAGIC_BYTES as u64)
        .read_to_end(&mut magic)
        .and_then(|_| reader.rewind())
        .map_err(|source| FormatError::io(path, "read", source))?;
    let format = format_of(&magic, path)?;
    let info = guarded(format, path, || (format.probe)(&mut reader, path))?;
    checked_size(info, path)
}

/// Reads a picture: its samples at the precision of the file, alpha dropped.
///
/// `level` is what a JPEG is decoded with; all levels give the same samples. `memory_limit`
/// bounds file, samples and decoder together, in bytes.
///
/// # Errors
/// As [`probe`], and [`FormatError::Invalid`] for truncated or damaged data and for samples that
/// are NaN or infinite, [`FormatError::TooLarge`] for pictures beyond `memory_limit`.
pub fn decode(path: &Path, level: CpuLevel, memory_limit: u64) -> Result<DecodedPicture, FormatError> {
    let io = |source| FormatError::io(path, "read", source);
    let mut file = File::open(path).map_err(|source| FormatError::io(path, "open", source))?;
    let length = file.metadata().map_err(io)?.len();
    check_memory(length, memory_limit, path)?;
    let mut bytes = Vec::with_capacity(length as usize + 1);
    (&mut file).take(memory_limit).read_to_end(&mut bytes).map_err(io)?;
    decode_bytes(&bytes, path, level, memory_limit)
}

/// Reads a picture that is already in memory; `path` is only for messages.
///
/// # Errors
/// As [`decode`].
pub fn decode_bytes(
    bytes: &[u8],
    path: &Path,
    level: CpuLevel,
    memory_limit: u64,
) -> Result<DecodedPicture, FormatError> {
    let format = format_of(&bytes[..bytes.len().min(MAGIC_BYTES)], path)?;
    let picture = guarded(format, path, || (format.decode)(bytes, path, level, memory_limit))?;
    check_finite(&picture, path)?;
    Ok(picture)
}

/// Checks that `bytes` are a JPEG of this size and `channels` (1 or 3) of a kind that is read, by its header.
///
/// # Errors
/// As [`probe`]; `path` is for messages.
pub(crate) fn check_jpeg(
    bytes: &[u8],
    (width, height): (usize, usize),
    channels: usize,
    path: &Path,
) -> Result<(), FormatError> {
    if !(JPEG.is_magic)(bytes) {
        return Err(FormatError::invalid(path, "is no JPEG"));
    }
    let info = guarded(&JPEG, path, || (JPEG.probe)(&mut Cursor::new(bytes), path))?;
    if (info.width, info.height, info.channels) != (width, height, channels) {
        let problem = format!(
            "its JPEG has {} x {} pixels of {} channels where {width} x {height} of {channels} are needed",
            info.width, info.height, info.channels
        );
        return Err(FormatError::invalid(path, problem));
    }
    Ok(())
}

/// Decodes a JPEG that [`check_jpeg`] passes, within another file or beside one, 8 bits a sample, interleaved,
/// rows from the top.
///
/// # Errors
/// As [`decode`].
pub(crate) fn decode_jpeg(bytes: &[u8], path: &Path, memory_limit: u64) -> Result<Vec<u8>, FormatError> {
    let level = CpuLevel::detect();
    match guarded(&JPEG, path, || (JPEG.decode)(bytes, path, level, memory_limit))?.samples {
        Samples::U8(samples) => Ok(samples),
        _ => Err(FormatError::invalid(path, "its JPEG has more than 8 bits")),
    }
}

fn format_of(magic: &[u8], path: &Path) -> Result<&'static Format, FormatError> {
    if magic.is_empty() {
        return Err(FormatError::invalid(path, "the file is empty; copy it again"));
    }
    FORMATS.iter().find(|format| (format.is_magic)(magic)).ok_or_else(|| {
        let names: Vec<_> = FORMATS.iter().map(|format| format.name).collect();
        let start: Vec<_> = magic.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
        let problem = format!(
            "its first bytes ({}) are not those of a picture that relight reads ({}); convert it to PNG",
            start.join(" "),
            names.join(", ")
        );
        FormatError::unsupported(path, problem)
    })
}

/// Runs a decoder so that a panic in a dependency, which damaged bytes can provoke (see
/// `formats/tests/pictures.rs`), becomes an error of this file. Nothing outlives the closure that
/// a panic could have left half-made.
fn guarded<T>(
    format: &Format,
    path: &Path,
    read: impl FnOnce() -> Result<T, FormatError>,
) -> Result<T, FormatError> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let problem = format!("damaged {}: its decoder gave up; copy the file again", format.name);
        Err(FormatError::invalid(path, problem))
    })
}

fn pixels(width: usize, height: usize) -> u64 {
    (width as u64).saturating_mul(height as u64)
}

/// Refuses pictures without pixels.
fn checked_size(info: PictureInfo, path: &Path) -> Result<PictureInfo, FormatError> {
    if info.width == 0 || info.height == 0 {
        let problem = format!(
            "the picture is {} x {} pixels; at least 1 x 1 is needed, save it again",
            info.width, info.height
        );
        return Err(FormatError::invalid(path, problem));
    }
    Ok(info)
}

/// Keeps the first `kept` of every `stored` samples: drops alpha.
fn keep_channels<T: Copy>(samples: &mut Vec<T>, stored: usize, kept: usize) {
    if stored == kept {
        return;
    }
    let pixels = samples.len() / stored;
    for pixel in 0..pixels {
        for channel in 0..kept {
            samples[pixel * kept + channel] = samples[pixel * stored + channel];
        }
    }
    samples.truncate(pixels * kept);
}

/// A header that its decoder refused, or data that it could not decode.
fn error_from_image(error: image::ImageError, path: &Path, format: &str, memory_limit: u64) -> FormatError {
    use image::ImageError;
    let cause = error.to_string();
    match error {
        ImageError::Unsupported(_) => FormatError::unsupported(
            path,
            format!("{format} of a kind that is not read: {cause}; convert it to RGB"),
        ),
        ImageError::Limits(_) => FormatError::too_large(path, memory_limit.saturating_add(1), memory_limit),
        _ => FormatError::invalid(path, format!("truncated or damaged {format}: {cause}; copy it again")),
    }
}

fn check_finite(picture: &DecodedPicture, path: &Path) -> Result<(), FormatError> {
    let (position, value) = match &picture.samples {
        Samples::U8(_) | Samples::U16(_) => return Ok(()),
        Samples::F16(samples) => match samples.iter().position(|sample| !sample.is_finite()) {
            Some(position) => (position, samples[position].to_f32()),
            None => return Ok(()),
        },
        Samples::F32(samples) => match samples.iter().position(|sample| !sample.is_finite()) {
            Some(position) => (position, samples[position]),
            None => return Ok(()),
        },
    };
    let PictureInfo { width, channels, .. } = picture.info;
    let (pixel, channel) = (position / channels, position % channels);
    let letter = if channels == 1 { "Y" } else { ["R", "G", "B"][channel.min(2)] };
    let problem = format!(
        "pixel x {}, y {} (from 0, top left) has {letter} = {value}; samples must be finite, \
         render the picture again or replace that value",
        pixel % width,
        pixel / width
    );
    Err(FormatError::invalid(path, problem))
}
