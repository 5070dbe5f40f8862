//! Texels of textures to planes, a piece at a time.

use super::texture::read_exact;
use crate::FormatError;
use half::f16;
use relight_core::{RelightingMap, Texels};
use relight_texture::{BlockFormat, LayerPlan, Packing, Precision, Quantizer, TexelFormat, decode_blocks};
use std::io::Read;
use std::path::Path;

/// Texels that are read at a time.
const PIECE: usize = 1 << 14;

/// Planes that are filled layer by layer.
pub(super) struct Unpacker {
    width: usize,
    height: usize,
    planes: Vec<Option<RelightingMap>>,
    bytes: Vec<u8>,
    decoded: Vec<f32>,
}

/// A component of a texel.
trait Component: Copy + Default {
    /// From its little-endian bytes, as many as it has.
    fn from_bytes(bytes: &[u8]) -> Self;
    /// From the value of a decoded block, which it holds exactly.
    fn from_decoded(value: f32) -> Self;
    fn texels(components: Vec<Self>) -> Texels;
}

impl Component for u8 {
    fn from_bytes(bytes: &[u8]) -> Self {
        bytes[0]
    }
    fn from_decoded(value: f32) -> Self {
        (value * 255.0 + 0.5) as u8
    }
    fn texels(components: Vec<Self>) -> Texels {
        Texels::U8(components)
    }
}

impl Component for f16 {
    fn from_bytes(bytes: &[u8]) -> Self {
        Self::from_le_bytes([bytes[0], bytes[1]])
    }
    fn from_decoded(value: f32) -> Self {
        Self::from_f32(value)
    }
    fn texels(components: Vec<Self>) -> Texels {
        Texels::F16(components)
    }
}

impl Component for f32 {
    fn from_bytes(bytes: &[u8]) -> Self {
        Self::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
    }
    fn from_decoded(value: f32) -> Self {
        value
    }
    fn texels(components: Vec<Self>) -> Texels {
        Texels::F32(components)
    }
}

impl Unpacker {
    /// Planes of `width` x `height` texels, none of which is there yet.
    pub(super) fn new(width: usize, height: usize, planes: usize) -> Self {
        Self { width, height, planes: vec![None; planes], bytes: Vec::new(), decoded: Vec::new() }
    }

    /// What `limit` leaves when all planes of `packing` are decoded.
    ///
    /// # Errors
    /// [`FormatError::TooLarge`] when they take more.
    pub(super) fn spare_memory(
        path: &Path,
        (width, height): (usize, usize),
        packing: &Packing,
        limit: u64,
    ) -> Result<u64, FormatError> {
        let bytes_a_pixel = packing.arrays.iter().map(|array| {
            let planes: usize = array.layers.iter().map(|layer| layer.planes.len()).sum();
            planes as u64 * array.format.decoded_precision().bytes() as u64
        });
        let needed =
            (width as u64).saturating_mul(height as u64).saturating_mul(bytes_a_pixel.sum::<u64>().max(1));
        match limit.checked_sub(needed) {
            Some(spare) if usize::try_from(needed).is_ok() => Ok(spare),
            _ => Err(FormatError::too_large(path, needed, limit)),
        }
    }

    /// Takes the planes of `layer` from its bytes.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] when they end early, [`FormatError::Io`].
    pub(super) fn add(
        &mut self,
        path: &Path,
        format: TexelFormat,
        layer: &LayerPlan,
        bytes: &mut dyn Read,
    ) -> Result<(), FormatError> {
        match format.decoded_precision() {
            Precision::U8 => self.add_as::<u8>(path, format, layer, bytes),
            Precision::F16 => self.add_as::<f16>(path, format, layer, bytes),
            Precision::F32 => self.add_as::<f32>(path, format, layer, bytes),
        }
    }

    fn add_as<T: Component>(
        &mut self,
        path: &Path,
        format: TexelFormat,
        layer: &LayerPlan,
        bytes: &mut dyn Read,
    ) -> Result<(), FormatError> {
        let mut planes = vec![vec![T::default(); self.width * self.height]; layer.planes.len()];
        match format {
            TexelFormat::Plain { channels, .. } => self.read_texels(path, channels, bytes, &mut planes)?,
            TexelFormat::Block(format) => self.read_blocks(path, format, bytes, &mut planes)?,
        }
        for ((&plane, quantizer), components) in layer.planes.iter().zip(&layer.quantizers).zip(planes) {
            let Quantizer { scale, bias } = *quantizer;
            self.planes[plane] = Some(RelightingMap { scale, bias, texels: T::texels(components) });
        }
        Ok(())
    }

    fn read_texels<T: Component>(
        &mut self,
        path: &Path,
        channels: usize,
        from: &mut dyn Read,
        planes: &mut [Vec<T>],
    ) -> Result<(), FormatError> {
        let (pixels, texel_bytes) = (self.width * self.height, channels * size_of::<T>());
        for first in (0..pixels).step_by(PIECE) {
            let count = PIECE.min(pixels - first);
            self.bytes.resize(count * texel_bytes, 0);
            read_exact(path, from, &mut self.bytes)?;
            for (channel, plane) in planes.iter_mut().enumerate() {
                let texels = self.bytes.chunks_exact(texel_bytes);
                for (component, texel) in plane[first..first + count].iter_mut().zip(texels) {
                    *component = T::from_bytes(&texel[channel * size_of::<T>()..]);
                }
            }
        }
        Ok(())
    }

    /// A run of blocks of one row of blocks at a time: however wide a picture claims to be, that is
    /// what is held.
    fn read_blocks<T: Component>(
        &mut self,
        path: &Path,
        format: BlockFormat,
        from: &mut dyn Read,
        planes: &mut [Vec<T>],
    ) -> Result<(), FormatError> {
        let (width, channels) = (self.width, format.channels());
        for top in (0..self.height).step_by(4) {
            let rows = 4.min(self.height - top);
            for left in (0..width).step_by(PIECE / 4) {
                let columns = (PIECE / 4).min(width - left);
                self.bytes.resize(columns.div_ceil(4) * format.bytes(), 0);
                read_exact(path, from, &mut self.bytes)?;
                self.decoded.resize(rows * columns * channels, 0.0);
                decode_blocks(format, &self.bytes, columns, &mut self.decoded);
                for (y, row) in self.decoded.chunks_exact(columns * channels).enumerate() {
                    let place = (top + y) * width + left;
                    for (channel, plane) in planes.iter_mut().enumerate() {
                        let values = row[channel..].iter().step_by(channels);
                        for (component, value) in plane[place..place + columns].iter_mut().zip(values) {
                            *component = T::from_decoded(*value);
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// The planes that came, in the order of `Model::roles`.
    pub(super) fn into_maps(self) -> Vec<RelightingMap> {
        self.planes.into_iter().flatten().collect()
    }
}
