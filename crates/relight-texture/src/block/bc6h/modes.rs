//! The fourteen modes of BC6H and how their fields lie in a block.
//!
//! Source: Microsoft, *BC6H Format* (Direct3D 11), tables of modes and of bit fields.

/// A mode: how many bits its ends have, and where they go.
pub(super) struct Mode {
    /// Value of the first 2 or 5 bits.
    prefix: (u128, u32),
    /// Lines: 1 with 16 colours, or 2 with 8 each.
    pub(super) lines: usize,
    /// Bits of an end's channel.
    pub(super) bits: u32,
    /// Bits of the difference to the first end with which the other ends are stored, by channel;
    /// none where they are stored as they are.
    pub(super) deltas: Option<[u32; 3]>,
    /// Runs of bits in the block's order. `gy4` is bit 4 of channel g of end y; `rw0:10` bits 0 to
    /// 9; `rw15:-6` bits 15 down to 10.
    fields: &'static str,
}

const fn mode(
    prefix: (u128, u32),
    (lines, bits, deltas): (usize, u32, Option<[u32; 3]>),
    fields: &'static str,
) -> Mode {
    Mode { prefix, lines, bits, deltas, fields }
}

/// Modes with two lines in the order of the source, then those with one; within each, finer ends
/// (with less room for differences) come first.
#[rustfmt::skip]
pub(super) static MODES: [Mode; 14] = [
    mode((0b00010, 5), (2, 11, Some([5, 4, 4])), "rw0:10 gw0:10 bw0:10 rx0:5 rw10 gy0:4 gx0:4 gw10 bz0 gz0:4 bx0:4 bw10 bz1 by0:4 ry0:5 bz2 rz0:5 bz3"),
    mode((0b00110, 5), (2, 11, Some([4, 5, 4])), "rw0:10 gw0:10 bw0:10 rx0:4 rw10 gz4 gy0:4 gx0:5 gw10 gz0:4 bx0:4 bw10 bz1 by0:4 ry0:4 bz0 bz2 rz0:4 gy4 bz3"),
    mode((0b01010, 5), (2, 11, Some([4, 4, 5])), "rw0:10 gw0:10 bw0:10 rx0:4 rw10 by4 gy0:4 gx0:4 gw10 bz0 gz0:4 bx0:5 bw10 by0:4 ry0:4 bz1 bz2 rz0:4 bz4 bz3"),
    mode((0b00, 2), (2, 10, Some([5, 5, 5])), "gy4 by4 bz4 rw0:10 gw0:10 bw0:10 rx0:5 gz4 gy0:4 gx0:5 bz0 gz0:4 bx0:5 bz1 by0:4 ry0:5 bz2 rz0:5 bz3"),
    mode((0b01110, 5), (2, 9, Some([5, 5, 5])), "rw0:9 by4 gw0:9 gy4 bw0:9 bz4 rx0:5 gz4 gy0:4 gx0:5 bz0 gz0:4 bx0:5 bz1 by0:4 ry0:5 bz2 rz0:5 bz3"),
    mode((0b10010, 5), (2, 8, Some([6, 5, 5])), "rw0:8 gz4 by4 gw0:8 bz2 gy4 bw0:8 bz3 bz4 rx0:6 gy0:4 gx0:5 bz0 gz0:4 bx0:5 bz1 by0:4 ry0:6 rz0:6"),
    mode((0b10110, 5), (2, 8, Some([5, 6, 5])), "rw0:8 bz0 by4 gw0:8 gy5 gy4 bw0:8 gz5 bz4 rx0:5 gz4 gy0:4 gx0:6 gz0:4 bx0:5 bz1 by0:4 ry0:5 bz2 rz0:5 bz3"),
    mode((0b11010, 5), (2, 8, Some([5, 5, 6])), "rw0:8 bz1 by4 gw0:8 by5 gy4 bw0:8 bz5 bz4 rx0:5 gz4 gy0:4 gx0:5 bz0 gz0:4 bx0:6 by0:4 ry0:5 bz2 rz0:5 bz3"),
    mode((0b01, 2), (2, 7, Some([6, 6, 6])), "gy5 gz4 gz5 rw0:7 bz0 bz1 by4 gw0:7 by5 bz2 gy4 bw0:7 bz3 bz5 bz4 rx0:6 gy0:4 gx0:6 gz0:4 bx0:6 by0:4 ry0:6 rz0:6"),
    mode((0b11110, 5), (2, 6, None), "rw0:6 gz4 bz0 bz1 by4 gw0:6 gy5 by5 bz2 gy4 bw0:6 gz5 bz3 bz5 bz4 rx0:6 gy0:4 gx0:6 gz0:4 bx0:6 by0:4 ry0:6 rz0:6"),
    mode((0b01111, 5), (1, 16, Some([4, 4, 4])), "rw0:10 gw0:10 bw0:10 rx0:4 rw15:-6 gx0:4 gw15:-6 bx0:4 bw15:-6"),
    mode((0b01011, 5), (1, 12, Some([8, 8, 8])), "rw0:10 gw0:10 bw0:10 rx0:8 rw11:-2 gx0:8 gw11:-2 bx0:8 bw11:-2"),
    mode((0b00111, 5), (1, 11, Some([9, 9, 9])), "rw0:10 gw0:10 bw0:10 rx0:9 rw10 gx0:9 gw10 bx0:9 bw10"),
    mode((0b00011, 5), (1, 10, None), "rw0:10 gw0:10 bw0:10 rx0:10 gx0:10 bx0:10"),
];

/// Texels of the second line, bit i for texel i, for each of the 32 partitions.
pub(super) static PARTITIONS: [u16; 32] = [
    0xcccc, 0x8888, 0xeeee, 0xecc8, 0xc880, 0xfeec, 0xfec8, 0xec80, 0xc800, 0xffec, 0xfe80, 0xe800, 0xffe8,
    0xff00, 0xfff0, 0xf000, 0xf710, 0x008e, 0x7100, 0x08ce, 0x008c, 0x7310, 0x3100, 0x8cce, 0x088c, 0x3110,
    0x6666, 0x366c, 0x17e8, 0x0ff0, 0x718e, 0x399c,
];

/// The texel of the second line whose index is stored without its highest bit, which is 0.
pub(super) static ANCHORS: [usize; 32] = [
    15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 2, 8, 2, 2, 8, 8, 15, 2, 8, 2, 2, 8,
    8, 2, 2,
];

impl Mode {
    /// Whether the ends' codes can be stored.
    pub(super) fn fits(&self, codes: &[[i32; 3]; 4]) -> bool {
        let Some(bits) = self.deltas else { return true };
        let others = &codes[1..2 * self.lines];
        others.iter().all(|end| {
            (0..3).all(|c| {
                let reach = 1 << (bits[c] - 1);
                (-reach..reach).contains(&(end[c] - codes[0][c]))
            })
        })
    }

    /// The block. The anchors' indices are below half of the palette; `partition` is 0 for one line.
    pub(super) fn block(&self, codes: &[[i32; 3]; 4], partition: usize, indices: &[u8; 16]) -> [u8; 16] {
        let (mut block, mut at) = self.prefix;
        let mut push = |value: u128, bits: u32| {
            block |= (value & ((1 << bits) - 1)) << at;
            at += bits;
        };
        for run in self.fields.split(' ') {
            let (channel, end) = (place(b"rgb", run.as_bytes()[0]), place(b"wxyz", run.as_bytes()[1]));
            let stored = match self.deltas {
                Some(_) if end > 0 => codes[end][channel] - codes[0][channel],
                _ => codes[end][channel],
            };
            let (first, length) = run[2..].split_once(':').unwrap_or((&run[2..], "1"));
            let first: i32 = first.parse().expect("a number in the table");
            let length: i32 = length.parse().expect("a number in the table");
            for i in 0..length.abs() {
                push((stored >> (first + i * length.signum())) as u128, 1);
            }
        }
        let bits = if self.lines == 2 { 3 } else { 4 };
        if self.lines == 2 {
            push(partition as u128, 5);
        }
        for (i, index) in indices.iter().enumerate() {
            let anchor = i == 0 || self.lines == 2 && i == ANCHORS[partition];
            push(u128::from(*index), if anchor { bits - 1 } else { bits });
        }
        block.to_le_bytes()
    }
}

fn place(letters: &[u8], letter: u8) -> usize {
    letters.iter().position(|other| *other == letter).expect("a letter in the table")
}
