//! From what was found to the bits of a block.

use super::modes::{Mode, Mode0, Mode1, Mode2, Mode3, Mode6, parting_of, subset_in, value};
use super::partitions::{THREE, TWO};
use super::{Best, Block};
use crate::block::side_by_side::{TEXELS, limited, nearest};

/// Bits from the lowest on.
struct Bits {
    bits: u128,
    count: u32,
}

impl Bits {
    fn push(&mut self, value: u64, count: u32) {
        self.bits |= u128::from(value) << self.count;
        self.count += count;
    }
}

impl Best {
    /// The bytes of a block of these texels.
    pub(super) fn block(&self, texels: &Block) -> [u8; 16] {
        match self.mode {
            0 => self.block_of::<Mode0>(texels),
            1 => self.block_of::<Mode1>(texels),
            2 => self.block_of::<Mode2>(texels),
            3 => self.block_of::<Mode3>(texels),
            _ => self.block_of::<Mode6>(texels),
        }
    }

    fn block_of<M: Mode>(&self, texels: &Block) -> [u8; 16] {
        let partition = self.partition;
        let parting = parting_of::<M>(partition);
        let is_in = |texel: usize, subset: usize| subset_in::<M>(parting, texel) == subset as u32;
        let anchors = match M::SUBSETS {
            1 => [0; 3],
            2 => [0, usize::from(TWO[partition].1), 0],
            _ => [0, usize::from(THREE[partition].1[0]), usize::from(THREE[partition].1[1])],
        };
        let mut codes = [[[0u64; 3]; 2]; 3];
        let mut places = [0; TEXELS];
        for subset in 0..M::SUBSETS {
            let own = self.codes[subset];
            let [first, second] = own.map(|codes| codes.map(value::<M>));
            let across = [0, 1, 2].map(|c| second[c] - first[c]);
            let square = across[0] * across[0] + across[1] * across[1] + across[2] * across[2];
            let inverse = if square > 0.0 { M::STEPS as f32 / square } else { 0.0 };
            for (texel, values) in texels.as_chunks::<3>().0.iter().enumerate() {
                if is_in(texel, subset) {
                    let along =
                        (0..3).fold(0.0, |sum, c| sum + (values[c] - first[c]) * (across[c] * inverse));
                    places[texel] = nearest(limited(along, M::STEPS as f32)) as usize;
                }
            }
            codes[subset] = own.map(|codes| codes.map(|code| code as u64));
            // The anchor's index has no highest bit.
            if places[anchors[subset]] > M::STEPS / 2 {
                codes[subset].swap(0, 1);
                for (texel, place) in places.iter_mut().enumerate() {
                    if is_in(texel, subset) {
                        *place = M::STEPS - *place;
                    }
                }
            }
        }
        let mut bits = Bits { bits: 0, count: 0 };
        bits.push(1 << M::NUMBER, M::NUMBER as u32 + 1);
        bits.push(partition as u64, M::PARTITIONS.ilog2());
        let has_parity = M::STRIDE == 2.0;
        let shift = u32::from(has_parity);
        for c in 0..3 {
            for ends in &codes[..M::SUBSETS] {
                ends.iter().for_each(|end| bits.push(end[c] >> shift, M::BITS - shift));
            }
        }
        if M::NUMBER == 6 {
            bits.push((1 << 14) - 1, 14);
        }
        if has_parity {
            for ends in &codes[..M::SUBSETS] {
                // One for both where they share it.
                let count = if M::NUMBER == 1 { 1 } else { 2 };
                ends[..count].iter().for_each(|end| bits.push(end[0] & 1, 1));
            }
        }
        let index_bits = (M::STEPS + 1).ilog2();
        for (texel, place) in places.iter().enumerate() {
            let is_anchor = anchors[..M::SUBSETS].contains(&texel);
            bits.push(*place as u64, index_bits - u32::from(is_anchor));
        }
        debug_assert_eq!(bits.count, 128);
        bits.bits.to_le_bytes()
    }
}
