//! BC1, BC3, BC4, BC5 and BC7 by the `dds` crate: Rust without platform functions, hence the same
//! bytes everywhere. Its metric is the plain sum of squares over channels, without dithering.

use super::encode::BlockRow;
use super::{BlockCoding, Quality};
use dds::{ColorFormat, CompressionQuality, Dithering, EncodeOptions, ErrorMetric, Format, ImageView, Size};

/// Encodes by `dds`; `texels` hold the channels of `color`, 0..1 also for signed formats.
fn encode(
    format: Format,
    color: ColorFormat,
    texels: &[f32],
    width: usize,
    quality: CompressionQuality,
    mut out: &mut [u8],
) {
    let mut options = EncodeOptions::default();
    options.quality = quality;
    options.dithering = Dithering::None;
    options.error_metric = ErrorMetric::Uniform;
    options.parallel = false;
    let size = Size::new(width as u32, 4);
    let view = ImageView::new(bytemuck::cast_slice(texels), size, color).expect("4 whole rows");
    dds::encode(&mut out, view, format, None, &options).expect("a format that it encodes, into enough bytes");
}

fn quality(coding: BlockCoding) -> CompressionQuality {
    match coding.quality {
        Quality::Fast => CompressionQuality::Fast,
        Quality::Normal => CompressionQuality::Normal,
        Quality::High => CompressionQuality::High,
        Quality::Best => CompressionQuality::Unreasonable,
    }
}

/// Texels of one or two channels moved from `low`..1 to 0..1; two become RGB, as `dds` has no pairs.
fn moved(row: &BlockRow<'_>, low: f32) -> Vec<f32> {
    let moved = |value: f32| (value - low) / (1.0 - low);
    match row.channels {
        1 => row.texels.iter().map(|value| moved(*value)).collect(),
        _ => row.texels.chunks_exact(2).flat_map(|pair| [moved(pair[0]), moved(pair[1]), 0.0]).collect(),
    }
}

pub(super) fn bc1(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(Format::BC1_UNORM, ColorFormat::RGB_F32, row.texels, row.width, quality(coding), out);
}

pub(super) fn bc3(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(Format::BC3_UNORM, ColorFormat::RGBA_F32, row.texels, row.width, quality(coding), out);
}

pub(super) fn bc4(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(Format::BC4_UNORM, ColorFormat::GRAYSCALE_F32, row.texels, row.width, quality(coding), out);
}

pub(super) fn bc4_signed(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(
        Format::BC4_SNORM,
        ColorFormat::GRAYSCALE_F32,
        &moved(&row, -1.0),
        row.width,
        quality(coding),
        out,
    );
}

pub(super) fn bc5(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(Format::BC5_UNORM, ColorFormat::RGB_F32, &moved(&row, 0.0), row.width, quality(coding), out);
}

pub(super) fn bc5_signed(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(Format::BC5_SNORM, ColorFormat::RGB_F32, &moved(&row, -1.0), row.width, quality(coding), out);
}

pub(super) fn bc7(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(Format::BC7_UNORM, ColorFormat::RGB_F32, row.texels, row.width, quality(coding), out);
}
