//! Writing relit pictures: PNG with encoded values, OpenEXR with linear ones; and small ones as text within pages.

use crate::FormatError;
use crate::output_file::write_whole;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage, f16,
};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use relight_core::relighter::Picture;
use std::io::Cursor;
use std::path::Path;

/// How samples of a written picture are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureDepth {
    /// PNG, 8 bits.
    U8,
    /// PNG, 16 bits.
    U16,
    /// OpenEXR, half.
    F16,
    /// OpenEXR, float.
    F32,
}

/// The depths that the extension of `path` can hold, its default first.
///
/// # Errors
/// [`FormatError::Unsupported`] for any extension but `.png` and `.exr`.
pub fn picture_depths(path: &Path) -> Result<[PictureDepth; 2], FormatError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("png") => Ok([PictureDepth::U8, PictureDepth::U16]),
        Some("exr") => Ok([PictureDepth::F16, PictureDepth::F32]),
        _ => Err(FormatError::unsupported(
            path,
            "pictures are written as .png or .exr; give one of those extensions",
        )),
    }
}

impl PictureDepth {
    /// Whether files of this depth hold linear light rather than sRGB-encoded values.
    pub fn is_linear(self) -> bool {
        matches!(self, Self::F16 | Self::F32)
    }
}

/// Writes `picture`, whose values are encoded for integer depths (clipped to 0..1 here) and linear
/// for float depths.
///
/// # Errors
/// [`FormatError::Io`] when the file can't be written; nothing is left behind then.
pub fn write_picture(path: &Path, picture: &Picture, depth: PictureDepth) -> Result<(), FormatError> {
    write_whole(path, &picture_bytes(path, picture, depth)?)
}

/// The bytes of the file that [`write_picture`] writes; `path` names it in errors.
///
/// # Errors
/// [`FormatError`] when it can't be encoded.
pub fn picture_bytes(path: &Path, picture: &Picture, depth: PictureDepth) -> Result<Vec<u8>, FormatError> {
    match depth {
        PictureDepth::U8 => {
            let codes: Vec<u8> =
                picture.samples.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect();
            let color = if picture.channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
            png(path, (picture.width, picture.height), &codes, color)
        }
        PictureDepth::U16 => {
            let code = |v: &f32| ((v.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16).to_ne_bytes();
            let codes: Vec<u8> = picture.samples.iter().flat_map(code).collect();
            let color = if picture.channels == 1 { ExtendedColorType::L16 } else { ExtendedColorType::Rgb16 };
            png(path, (picture.width, picture.height), &codes, color)
        }
        PictureDepth::F16 | PictureDepth::F32 => openexr(path, picture, depth),
    }
}

/// Codes of 8 bits, to be written into a page rather than to a file of their own.
#[derive(Clone, Copy, Debug)]
pub struct PagePicture<'a> {
    /// Width and height in pixels.
    pub size: (usize, usize),
    /// 1 (grey) or 3 (R, G, B), interleaved.
    pub channels: usize,
    /// width x height x channels codes.
    pub codes: &'a [u8],
}

impl PagePicture<'_> {
    /// As the `data:` URI of a PNG without colour profile, gamma or alpha, so that codes come back as they are; `page` is the
    /// file that it is for.
    ///
    /// # Errors
    /// [`FormatError::Io`] naming `page` when it can't be encoded.
    pub fn png_uri(&self, page: &Path) -> Result<String, FormatError> {
        let color = if self.channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
        Ok(format!("data:image/png;base64,{}", STANDARD.encode(png(page, self.size, self.codes, color)?)))
    }

    /// As the `data:` URI of a JPEG of `quality` 1 to 100 with all of its colour; `page` is the file that it is for.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] naming `page` for more than 65,535 pixels in a row or column.
    pub fn jpeg_uri(&self, page: &Path, quality: u8) -> Result<String, FormatError> {
        let refused = |problem: String| FormatError::invalid(page, problem);
        let short = |length: usize| {
            u16::try_from(length)
                .map_err(|_| refused(format!("{length} pixels are too many for JPEG's 65535")))
        };
        let (width, height) = (short(self.size.0)?, short(self.size.1)?);
        let color = if self.channels == 1 { ColorType::Luma } else { ColorType::Rgb };
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, quality);
        encoder.set_sampling_factor(SamplingFactor::F_1_1);
        encoder.set_optimized_huffman_tables(true);
        encoder.encode(self.codes, width, height, color).map_err(|error| refused(error.to_string()))?;
        Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(bytes)))
    }
}

fn png(
    path: &Path,
    (width, height): (usize, usize),
    codes: &[u8],
    color: ExtendedColorType,
) -> Result<Vec<u8>, FormatError> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive);
    encoder
        .write_image(codes, width as u32, height as u32, color)
        .map_err(|error| FormatError::io(path, "encode", std::io::Error::other(error)))?;
    Ok(bytes)
}

fn openexr(path: &Path, picture: &Picture, depth: PictureDepth) -> Result<Vec<u8>, FormatError> {
    let names: &[&str] = if picture.channels == 1 { &["Y"] } else { &["R", "G", "B"] };
    let channels = names.iter().enumerate().map(|(channel, name)| {
        let values = picture.samples.iter().skip(channel).step_by(picture.channels).copied();
        let samples = match depth {
            PictureDepth::F16 => FlatSamples::F16(values.map(f16::from_f32).collect()),
            _ => FlatSamples::F32(values.collect()),
        };
        AnyChannel::new(*name, samples)
    });
    let layer = Layer::new(
        (picture.width, picture.height),
        LayerAttributes::default(),
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels.collect()),
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .to_buffered(&mut bytes)
        .map_err(|error| FormatError::io(path, "encode", std::io::Error::other(error)))?;
    Ok(bytes.into_inner())
}
