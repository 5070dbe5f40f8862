//! Our formats as wgpu's.

use crate::Gpu;
use relight_texture::{BlockFormat, Precision, TexelFormat};
use wgpu::{Features, TextureFormat, TextureUsages};

/// wgpu's name of `format`. Blocks are linear data: never an sRGB format.
pub(crate) fn texture_format(format: TexelFormat) -> TextureFormat {
    match format {
        TexelFormat::Plain { precision: Precision::U8, channels: 1 } => TextureFormat::R8Unorm,
        TexelFormat::Plain { precision: Precision::U8, .. } => TextureFormat::Rgba8Unorm,
        TexelFormat::Plain { precision: Precision::F16, channels: 1 } => TextureFormat::R16Float,
        TexelFormat::Plain { precision: Precision::F16, .. } => TextureFormat::Rgba16Float,
        TexelFormat::Plain { precision: Precision::F32, channels: 1 } => TextureFormat::R32Float,
        TexelFormat::Plain { precision: Precision::F32, .. } => TextureFormat::Rgba32Float,
        TexelFormat::Block(BlockFormat::Bc1) => TextureFormat::Bc1RgbaUnorm,
        TexelFormat::Block(BlockFormat::Bc3) => TextureFormat::Bc3RgbaUnorm,
        TexelFormat::Block(BlockFormat::Bc4) => TextureFormat::Bc4RUnorm,
        TexelFormat::Block(BlockFormat::Bc4Signed) => TextureFormat::Bc4RSnorm,
        TexelFormat::Block(BlockFormat::Bc5) => TextureFormat::Bc5RgUnorm,
        TexelFormat::Block(BlockFormat::Bc5Signed) => TextureFormat::Bc5RgSnorm,
        TexelFormat::Block(BlockFormat::Bc6h) => TextureFormat::Bc6hRgbUfloat,
        TexelFormat::Block(BlockFormat::Bc6hSigned) => TextureFormat::Bc6hRgbFloat,
        TexelFormat::Block(BlockFormat::Bc7) => TextureFormat::Bc7RgbaUnorm,
    }
}

impl Gpu {
    /// Whether the adapter samples `format` as it lies in files.
    pub fn samples(&self, format: TexelFormat) -> bool {
        let features = self.device.features();
        if matches!(format, TexelFormat::Block(_)) && !features.contains(Features::TEXTURE_COMPRESSION_BC) {
            return false;
        }
        let usages = self.adapter.get_texture_format_features(texture_format(format)).allowed_usages;
        usages.contains(TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST)
    }
}
