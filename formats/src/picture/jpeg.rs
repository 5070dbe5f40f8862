//! JPEG: 8-bit baseline and progressive, grey or RGB (YCbCr), through `zune-jpeg`.
//!
//! The header is walked here: probing needs no decoder, and what the decoder can't read is named.
//! `zune-jpeg` 0.5 fills what is missing with grey unless in strict mode; and even then it passes
//! files that break off within the last row of blocks or have their end marker early. Therefore the
//! end marker is looked for first, and what stands before it makes the decoder trip.

use super::jpeg_bytes::JpegBytes;
use super::{DecodedPicture, PictureInfo, SampleType, Samples, Source, check_memory, checked_size, icc};
use crate::FormatError;
use image::metadata::Orientation;
use relight_core::CpuLevel;
use std::io::{self, BufRead, Cursor};
use std::path::Path;

use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

const END_OF_IMAGE: u8 = 0xd9;
const START_OF_SCAN: u8 = 0xda;

/// Longer than the raw bits that refining one block may take before its next code.
const TRIPWIRE_BYTES: usize = 64;

/// Width and height are 16-bit numbers.
const LARGEST_SIDE: usize = 65_535;

pub(super) fn is_magic(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8, 0xff])
}

pub(super) fn probe(source: &mut dyn Source, path: &Path) -> Result<PictureInfo, FormatError> {
    Ok(read_header(source, path)?.info)
}

pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    level: CpuLevel,
    memory_limit: u64,
) -> Result<DecodedPicture, FormatError> {
    let mut cursor = Cursor::new(bytes);
    let header = read_header(&mut cursor, path)?;
    let info = checked_size(header.info, path)?;
    let copies = 2 * bytes.len() as u64;
    let needed = copies.saturating_add(info.bytes()).saturating_add(header.decoder_bytes);
    check_memory(needed, memory_limit, path)?;
    let (end, scans) = find_end(bytes, cursor.position() as usize)
        .ok_or_else(|| damaged(path, "it ends before its last row"))?;
    // The decoder must see at once what follows the first scan of a progressive picture.
    let tripwire_bytes = if header.progressive && scans == 1 { 0 } else { TRIPWIRE_BYTES };
    let bytes = with_tripwire(&bytes[..end], tripwire_bytes);
    let color_space = if info.channels == 1 { ColorSpace::Luma } else { ColorSpace::RGB };
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_use_unsafe(level != CpuLevel::BASELINE)
        .set_max_width(LARGEST_SIDE)
        .set_max_height(LARGEST_SIDE)
        .jpeg_set_out_colorspace(color_space);
    let mut decoder = JpegDecoder::new_with_options(JpegBytes::new(&bytes), options);
    let mut samples = vec![0; info.bytes() as usize];
    decoder.decode_headers().map_err(|error| damaged(path, error))?;
    if decoder.output_buffer_size() != Some(samples.len()) {
        return Err(damaged(path, "its headers contradict each other"));
    }
    decoder.decode_into(&mut samples).map_err(|error| damaged(path, error))?;
    Ok(DecodedPicture { info, samples: Samples::U8(samples) })
}

/// What is said of bytes that are no whole JPEG.
pub(crate) fn damaged(path: &Path, cause: impl std::fmt::Display) -> FormatError {
    let cause = cause.to_string();
    let problem = format!("truncated or damaged JPEG: {}; copy it again", cause.trim());
    FormatError::invalid(path, problem)
}

/// What precedes the first scan.
struct Header {
    info: PictureInfo,
    progressive: bool,
    /// Memory of the decoder besides the samples.
    decoder_bytes: u64,
}

/// Walks the segments up to and including the header of the first scan.
///
/// Source: ITU-T T.81 annex B.
fn read_header(source: &mut dyn Source, path: &Path) -> Result<Header, FormatError> {
    walk_header(source, path).map_err(|error| match error {
        WalkError::Io(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
            FormatError::io(path, "read", error)
        }
        WalkError::Io(_) => damaged(path, "it ends within its header"),
        WalkError::Format(error) => error,
    })
}

enum WalkError {
    Io(io::Error),
    Format(FormatError),
}

impl From<io::Error> for WalkError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<FormatError> for WalkError {
    fn from(error: FormatError) -> Self {
        Self::Format(error)
    }
}

fn walk_header(source: &mut dyn Source, path: &Path) -> Result<Header, WalkError> {
    let mut frame: Option<Frame> = None;
    let mut profile: Vec<(u8, Vec<u8>)> = Vec::new();
    let mut orientation = None;
    source.seek_relative(2)?;
    loop {
        let marker = next_marker(source)?;
        if marker == END_OF_IMAGE {
            return Err(damaged(path, "it has no scan").into());
        }
        if marker == 0x01 || (0xd0..=0xd8).contains(&marker) {
            continue;
        }
        let [high, low] = read_array(source)?;
        let length = u16::from_be_bytes([high, low]);
        let Some(length) = length.checked_sub(2) else {
            return Err(damaged(path, format!("a segment of {length} bytes, at least 2 are needed")).into());
        };
        let is_frame = (0xc0..=0xcf).contains(&marker) && ![0xc4, 0xc8, 0xcc].contains(&marker);
        if !is_frame && ![0xe1, 0xe2, START_OF_SCAN].contains(&marker) {
            source.seek_relative(i64::from(length))?;
            continue;
        }
        let mut segment = vec![0; usize::from(length)];
        source.read_exact(&mut segment)?;
        match marker {
            0xe1 => {
                if let Some(exif) = segment.strip_prefix(b"Exif\0\0") {
                    orientation = Orientation::from_exif_chunk(exif).map(Orientation::to_exif);
                }
            }
            0xe2 => {
                if let Some([sequence, _count, data @ ..]) = segment.strip_prefix(b"ICC_PROFILE\0") {
                    profile.push((*sequence, data.to_vec()));
                }
            }
            START_OF_SCAN => {
                let Some(frame) = frame else {
                    return Err(damaged(path, "a scan without a frame").into());
                };
                profile.sort_by_key(|(sequence, _)| *sequence);
                let profile: Vec<u8> = profile.into_iter().flat_map(|(_, data)| data).collect();
                let interleaved = segment.first() == Some(&frame.components);
                let info = PictureInfo {
                    width: frame.width,
                    height: frame.height,
                    channels: usize::from(frame.components),
                    sample_type: SampleType::U8,
                    alpha: false,
                    color_profile: if profile.is_empty() {
                        None
                    } else {
                        icc::description_unless_srgb(&profile)
                    },
                    orientation: orientation.filter(|orientation| *orientation != 1),
                };
                let whole_picture =
                    if frame.progressive || !interleaved { frame.coefficients * 2 } else { 0 };
                return Ok(Header {
                    info,
                    progressive: frame.progressive,
                    decoder_bytes: frame.row_bytes + whole_picture,
                });
            }
            _ => frame = Some(read_frame(marker, &segment, path)?),
        }
    }
}

fn next_marker(source: &mut dyn Source) -> io::Result<u8> {
    let mut previous = 0;
    loop {
        let [byte] = read_array(source)?;
        if previous == 0xff && byte != 0xff && byte != 0 {
            return Ok(byte);
        }
        previous = byte;
    }
}

fn read_array<const N: usize>(source: &mut dyn Source) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    source.read_exact(&mut bytes)?;
    Ok(bytes)
}

struct Frame {
    width: usize,
    height: usize,
    components: u8,
    progressive: bool,
    /// Coefficients of all blocks, padded to whole groups of blocks.
    coefficients: u64,
    /// Bytes of the decoder's buffers for one row of groups.
    row_bytes: u64,
}

fn read_frame(marker: u8, segment: &[u8], path: &Path) -> Result<Frame, FormatError> {
    let unsupported = |what: String| {
        FormatError::unsupported(path, format!("{what}; convert it to an ordinary 8-bit RGB JPEG or to PNG"))
    };
    match marker {
        0xc0..=0xc2 => {}
        0xc3 | 0xc7 | 0xcb | 0xcf => return Err(unsupported("a lossless JPEG is not read".to_owned())),
        0xc5 | 0xc6 | 0xcd | 0xce => return Err(unsupported("a hierarchical JPEG is not read".to_owned())),
        _ => return Err(unsupported("an arithmetic-coded JPEG is not read".to_owned())),
    }
    let [precision, h1, h0, w1, w0, components, factors @ ..] = segment else {
        return Err(damaged(path, "its frame header is too short"));
    };
    if *precision != 8 {
        return Err(unsupported(format!("a JPEG of {precision} bits a sample is not read, 8 bits are")));
    }
    match components {
        1 | 3 => {}
        4 => {
            let problem = "a CMYK or YCCK JPEG is not read; convert it to RGB";
            return Err(FormatError::unsupported(path, problem));
        }
        _ => return Err(unsupported(format!("a JPEG of {components} components is not read, 1 or 3 are"))),
    }
    let width = usize::from(u16::from_be_bytes([*w1, *w0]));
    let height = usize::from(u16::from_be_bytes([*h1, *h0]));
    let factors: Vec<(u64, u64)> =
        factors.chunks_exact(3).map(|c| (u64::from(c[1] >> 4), u64::from(c[1] & 15))).collect();
    let across = factors.iter().map(|f| f.0).max().unwrap_or(1).max(1);
    let down = factors.iter().map(|f| f.1).max().unwrap_or(1).max(1);
    let groups_across = (width as u64).div_ceil(8 * across);
    let groups_down = (height as u64).div_ceil(8 * down);
    let blocks: u64 = factors.iter().map(|f| f.0 * f.1).sum();
    Ok(Frame {
        width,
        height,
        components: *components,
        progressive: marker == 0xc2,
        coefficients: groups_across * groups_down * blocks * 64,
        // 16-bit samples of the row, and as much again for each of three upsampling buffers.
        row_bytes: groups_across * across * down * 64 * 2 * u64::from(*components) * 4,
    })
}

/// Where the picture whose first scan has its data at `position` has its end marker, and the number
/// of its scans; `None` when the file ends first. Other pictures or padding may follow.
fn find_end(bytes: &[u8], mut position: usize) -> Option<(usize, usize)> {
    let mut scans = 1;
    loop {
        position += bytes.get(position..)?.skip_until(0xff).ok()?;
        match *bytes.get(position)? {
            END_OF_IMAGE => return Some((position - 1, scans)),
            // A stuffed zero or a restart marker.
            0 | 0xd0..=0xd7 => position += 1,
            // Perhaps a fill byte: the next may be a marker.
            0xff => {}
            marker => {
                scans += usize::from(marker == START_OF_SCAN);
                let length: [u8; 2] = bytes.get(position + 1..position + 3)?.try_into().ok()?;
                position += 1 + usize::from(u16::from_be_bytes(length));
            }
        }
    }
}

/// The picture up to its end marker, `body`, then codes that no Huffman table has (all bits 1) and
/// that marker: where data are missing the decoder takes zeros without a word, but over these it
/// trips.
fn with_tripwire(body: &[u8], tripwire_bytes: usize) -> Vec<u8> {
    let mut guarded = Vec::with_capacity(body.len() + 2 * tripwire_bytes + 2);
    guarded.extend_from_slice(body);
    guarded.extend([0xff, 0].repeat(tripwire_bytes));
    guarded.extend([0xff, END_OF_IMAGE]);
    guarded
}
