//! From blocks to texels, by `bcdec_rs`.

use super::BlockFormat;
use crate::loops::q_of_codes;
use crate::{Precision, TexelFormat};
use half::f16;
use relight_core::{CpuLevel, Texels};

/// Decodes a block of 4 x 4 texels, row-major, channels interleaved, into what holds it exactly.
pub(super) enum Decode {
    /// Codes 0..255, RGBA, into rows so many bytes apart.
    U8(fn(&[u8], &mut [u8], usize)),
    /// Bits of halves, RGB.
    F16(fn(&[u8], &mut [u16; 48])),
    /// The format's channels. Interpolated values are not rounded to codes.
    F32(fn(&[u8], &mut [f32; 64])),
}

pub(super) const BC1: Decode = Decode::U8(bcdec_rs::bc1);
pub(super) const BC7: Decode = Decode::U8(bcdec_rs::bc7);
pub(super) const BC6H: Decode = Decode::F16(|block, texels| bcdec_rs::bc6h_half(block, texels, 12, false));
pub(super) const BC6H_SIGNED: Decode =
    Decode::F16(|block, texels| bcdec_rs::bc6h_half(block, texels, 12, true));
pub(super) const BC4: Decode = Decode::F32(|block, texels| bcdec_rs::bc4_float(block, texels, 4, false));
pub(super) const BC4_SIGNED: Decode =
    Decode::F32(|block, texels| bcdec_rs::bc4_float(block, texels, 4, true));
pub(super) const BC5: Decode = Decode::F32(|block, texels| bcdec_rs::bc5_float(block, texels, 8, false));
pub(super) const BC5_SIGNED: Decode =
    Decode::F32(|block, texels| bcdec_rs::bc5_float(block, texels, 8, true));
pub(super) const BC3: Decode = Decode::F32(bc3);

/// Colours are codes as in BC1; the fourth channel is a BC4 block, at its full precision.
fn bc3(block: &[u8], texels: &mut [f32; 64]) {
    let (mut codes, mut fourth) = ([0; 64], [0.0; 16]);
    bcdec_rs::bc3(block, &mut codes, 16);
    bcdec_rs::bc4_float(block, &mut fourth, 4, false);
    for ((texel, codes), fourth) in texels.chunks_exact_mut(4).zip(codes.chunks_exact(4)).zip(fourth) {
        texel.copy_from_slice(&[q_of_code(codes[0]), q_of_code(codes[1]), q_of_code(codes[2]), fourth]);
    }
}

fn q_of_code(code: u8) -> f32 {
    f32::from(code) / 255.0
}

impl Decode {
    pub(super) fn precision(&self) -> Precision {
        match self {
            Self::U8(_) => Precision::U8,
            Self::F16(_) => Precision::F16,
            Self::F32(_) => Precision::F32,
        }
    }
}

/// Where the texels of a layer lie in its blocks.
struct Grid {
    width: usize,
    height: usize,
    bytes: usize,
}

impl Grid {
    /// # Panics
    /// When `blocks` are not those of a layer of that size.
    fn new(format: BlockFormat, blocks: &[u8], width: usize, height: usize) -> Self {
        let layer = TexelFormat::Block(format).layer_bytes(width, height);
        assert_eq!(blocks.len() as u64, layer, "bytes of the blocks of {width} x {height} texels");
        Self { width, height, bytes: format.bytes() }
    }

    /// Decodes each block into `texels` and hands those inside of the layer to
    /// `place(index in the layer, index in the block, texels)`.
    fn each<T: Copy, const N: usize>(
        &self,
        blocks: &[u8],
        decode: impl Fn(&[u8], &mut [T; N]),
        zero: T,
        mut place: impl FnMut(usize, usize, &[T; N]),
    ) {
        let mut texels = [zero; N];
        let columns = self.width.div_ceil(4);
        for (i, block) in blocks.chunks_exact(self.bytes).enumerate() {
            decode(block, &mut texels);
            let (x0, y0) = (i % columns * 4, i / columns * 4);
            for y in 0..4.min(self.height - y0) {
                for x in 0..4.min(self.width - x0) {
                    place((y0 + y) * self.width + x0 + x, y * 4 + x, &texels);
                }
            }
        }
    }
}

/// Decodes rows of blocks over rows of `width` texels into values in the format's domain, channels
/// interleaved; the height follows from the length of `out`. Texels that fill up blocks are dropped.
/// # Panics
/// When `out` is not whole rows, or `blocks` are not [`TexelFormat::layer_bytes`] long.
pub fn decode_blocks(format: BlockFormat, blocks: &[u8], width: usize, out: &mut [f32]) {
    let channels = format.channels();
    let row = width * channels;
    assert!(row > 0 && out.len().is_multiple_of(row), "{} values in rows of {row}", out.len());
    let grid = Grid::new(format, blocks, width, out.len() / row);
    let level = CpuLevel::detect();
    match format.facts().decode {
        Decode::U8(decode) => {
            let pitch = 16 * width.div_ceil(4);
            let mut codes = vec![0; 4 * pitch];
            let rows_of_blocks = blocks.chunks_exact(format.bytes() * width.div_ceil(4));
            for (blocks, rows) in rows_of_blocks.zip(out.chunks_mut(4 * row)) {
                for (i, block) in blocks.chunks_exact(format.bytes()).enumerate() {
                    decode(block, &mut codes[16 * i..], pitch);
                }
                for (codes, row) in codes.chunks_exact(pitch).zip(rows.chunks_exact_mut(row)) {
                    q_of_codes(level, codes, channels, row);
                }
            }
        }
        Decode::F16(decode) => grid.each(blocks, decode, 0, |to, from, texels| {
            let values = &mut out[to * channels..][..channels];
            let halves = texels[from * 3..].iter();
            values.iter_mut().zip(halves).for_each(|(q, bits)| *q = f16::from_bits(*bits).to_f32());
        }),
        Decode::F32(decode) => grid.each(blocks, decode, 0.0, |to, from, texels| {
            out[to * channels..][..channels].copy_from_slice(&texels[from * channels..][..channels]);
        }),
    }
}

/// Decodes one channel of a layer of `width` x `height` texels, row-major, into the precision of
/// [`BlockFormat::decoded_precision`], which holds it exactly.
/// # Panics
/// When the format has no such channel, or `blocks` are not [`TexelFormat::layer_bytes`] long.
pub fn decode_channel(
    format: BlockFormat,
    blocks: &[u8],
    width: usize,
    height: usize,
    channel: usize,
) -> Texels {
    let channels = format.channels();
    assert!(channel < channels, "channel {channel} of {channels}");
    let grid = Grid::new(format, blocks, width, height);
    let count = width * height;
    match format.facts().decode {
        Decode::U8(decode) => {
            let mut codes = vec![0; count];
            let decode = |block: &[u8], texels: &mut [u8; 64]| decode(block, texels, 16);
            grid.each(blocks, decode, 0, |to, from, texels| codes[to] = texels[from * 4 + channel]);
            Texels::U8(codes)
        }
        Decode::F16(decode) => {
            let mut halves = vec![f16::ZERO; count];
            grid.each(blocks, decode, 0, |to, from, texels| {
                halves[to] = f16::from_bits(texels[from * 3 + channel]);
            });
            Texels::F16(halves)
        }
        Decode::F32(decode) => {
            let mut values = vec![0.0; count];
            grid.each(blocks, decode, 0.0, |to, from, texels| values[to] = texels[from * channels + channel]);
            Texels::F32(values)
        }
    }
}
