//! BC1, BC3's colours and BC7 by the `dds` crate: Rust without platform functions, and with the
//! feature `scalar-math` of its `glam` (see Cargo.toml) the same bytes everywhere. Its metric is the
//! plain sum of squares over channels, without dithering. BC7 is made from codes of 8 bits.

use super::encode::BlockRow;
use super::{BlockCoding, Quality};
use dds::{ColorFormat, CompressionQuality, Dithering, EncodeOptions, ErrorMetric, Format, ImageView, Size};

/// Encodes by `dds`; `texels` hold the channels of `color`.
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

pub(super) fn bc7(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(Format::BC7_UNORM, ColorFormat::RGB_F32, row.texels, row.width, quality(coding), out);
}
