//! From rows of texels to blocks: clean values, whole blocks, one row of blocks at a time.

use super::{BlockCoding, BlockFormat, Encoder};
use crate::{TexelDomain, TexelFormat};

/// A row of blocks before it is encoded: 4 rows of texels with their channels interleaved. All
/// values lie in the format's domain.
pub(super) struct BlockRow<'a> {
    pub(super) texels: &'a [f32],
    /// A multiple of 4.
    pub(super) width: usize,
    pub(super) channels: usize,
}

/// Encodes a row of blocks into all of `out`.
pub(super) type EncodeRow = fn(BlockRow<'_>, BlockCoding, &mut [u8]);

impl BlockRow<'_> {
    /// The 4 x 4 texels of each block, row-major, channels interleaved.
    pub(super) fn blocks<const VALUES: usize>(&self) -> impl Iterator<Item = [f32; VALUES]> + '_ {
        let (block, row) = (4 * self.channels, self.width * self.channels);
        (0..self.width / 4).map(move |i| {
            let mut values = [0.0; VALUES];
            for (y, four) in values.chunks_exact_mut(block).enumerate() {
                four.copy_from_slice(&self.texels[y * row + i * block..][..block]);
            }
            values
        })
    }
}

/// Encodes rows of `width` texels, each `format.channels()` values in the format's domain, into
/// rows of blocks from the top.
///
/// The height follows from the length of `texels`. Blocks that reach beyond the right or lower
/// edge are filled up with the last column or row. Values outside of the domain are clamped, NaN
/// becomes 0. Each row of blocks depends on its own 4 rows of texels only, so that strips of 4, 8,
/// 12 .. rows can be encoded at the same time.
/// # Panics
/// When `texels` are not whole rows or `out` is not [`TexelFormat::layer_bytes`] long.
pub fn encode_blocks(format: BlockFormat, coding: BlockCoding, texels: &[f32], width: usize, out: &mut [u8]) {
    let facts = format.facts();
    let row = width * facts.channels;
    assert!(row > 0 && texels.len().is_multiple_of(row), "{} values in rows of {row}", texels.len());
    let layer = TexelFormat::Block(format).layer_bytes(width, texels.len() / row);
    assert_eq!(out.len() as u64, layer, "bytes of the blocks");

    let encode = match coding.encoder {
        Encoder::Portable => facts.encode,
        Encoder::Ispc => facts.foreign.unwrap_or(facts.encode),
    };
    let (low, high) = match facts.domain {
        TexelDomain::Signed => (-1.0, 1.0),
        _ => (0.0, 1.0),
    };
    // The sum takes the sign off -0, which an encoder of unsigned halves would see as a huge number.
    let clean = |value: f32| if value.is_nan() { 0.0 } else { value.clamp(low, high) + 0.0 };
    let padded = width.next_multiple_of(4);
    let mut strip = vec![0.0; 4 * padded * facts.channels];
    let blocks = out.chunks_exact_mut(padded / 4 * facts.bytes);
    for (rows, blocks) in texels.chunks(4 * row).zip(blocks) {
        for (y, target) in strip.chunks_exact_mut(padded * facts.channels).enumerate() {
            let source = &rows[y.min(rows.len() / row - 1) * row..][..row];
            let (inside, beyond) = target.split_at_mut(row);
            inside.iter_mut().zip(source).for_each(|(to, from)| *to = clean(*from));
            for texel in beyond.chunks_exact_mut(facts.channels) {
                texel.copy_from_slice(&inside[row - facts.channels..]);
            }
        }
        encode(BlockRow { texels: &strip, width: padded, channels: facts.channels }, coding, blocks);
    }
}
