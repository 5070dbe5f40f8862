//! Block formats: 4 x 4 texels in 8 or 16 bytes.
//!
//! A format is a row of the table below: what it holds, who encodes a row of its blocks and who
//! decodes a block. Padding, strips and clean values are the same for all (`encode`, `decode`).

mod bc1;
mod bc4;
mod bc6h;
mod bc7;
mod coding;
mod decode;
mod encode;
mod foreign;
mod side_by_side;

pub use coding::{BlockCoding, Encoder, Quality};
pub use decode::{decode_blocks, decode_channel};
pub use encode::encode_blocks;

use crate::{Precision, TexelDomain};
use decode::Decode;
use encode::EncodeRow;

/// A block format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum BlockFormat {
    /// R, G, B in 8 bytes: two 5:6:5 ends and two bits a texel.
    Bc1,
    /// R, G, B as in BC1 and a fourth channel as in BC4, 16 bytes.
    Bc3,
    /// One channel in 8 bytes, 0..1.
    Bc4,
    /// One channel in 8 bytes, -1..1.
    Bc4Signed,
    /// Two channels, each as in BC4, 16 bytes.
    Bc5,
    /// Two channels, each as in signed BC4, 16 bytes.
    Bc5Signed,
    /// R, G, B halves from 0 up, 16 bytes.
    Bc6h,
    /// R, G, B halves of both signs, 16 bytes.
    Bc6hSigned,
    /// R, G, B in 16 bytes, the best of the 8-bit formats.
    Bc7,
}

/// A row of the table of block formats.
struct Facts {
    format: BlockFormat,
    name: &'static str,
    channels: usize,
    bytes: usize,
    domain: TexelDomain,
    encode: EncodeRow,
    /// A faster encoder whose bytes may differ between machines, where this build has one.
    foreign: Option<EncodeRow>,
    decode: Decode,
}

const fn facts(
    format: BlockFormat,
    name: &'static str,
    (channels, bytes, domain): (usize, usize, TexelDomain),
    (encode, foreign): (EncodeRow, Option<EncodeRow>),
    decode: Decode,
) -> Facts {
    Facts { format, name, channels, bytes, domain, encode, foreign, decode }
}

use TexelDomain::{Signed, Unit};

/// All formats, in the order of [`BlockFormat`].
#[rustfmt::skip]
static FACTS: [Facts; 9] = [
    facts(BlockFormat::Bc1, "bc1", (3, 8, Unit), (bc1::bc1, None), decode::BC1),
    facts(BlockFormat::Bc3, "bc3", (4, 16, Unit), (bc1::bc3, None), decode::BC3),
    facts(BlockFormat::Bc4, "bc4", (1, 8, Unit), (bc4::bc4, None), decode::BC4),
    facts(BlockFormat::Bc4Signed, "bc4s", (1, 8, Signed), (bc4::bc4_signed, None), decode::BC4_SIGNED),
    facts(BlockFormat::Bc5, "bc5", (2, 16, Unit), (bc4::bc5, None), decode::BC5),
    facts(BlockFormat::Bc5Signed, "bc5s", (2, 16, Signed), (bc4::bc5_signed, None), decode::BC5_SIGNED),
    facts(BlockFormat::Bc6h, "bc6h", (3, 16, Unit), (bc6h::unsigned, foreign::BC6H), decode::BC6H),
    facts(BlockFormat::Bc6hSigned, "bc6hs", (3, 16, Signed), (bc6h::signed, None), decode::BC6H_SIGNED),
    facts(BlockFormat::Bc7, "bc7", (3, 16, Unit), (bc7::bc7, foreign::BC7), decode::BC7),
];

impl BlockFormat {
    /// All formats, in the order in which they are listed to users.
    pub fn all() -> impl Iterator<Item = Self> {
        FACTS.iter().map(|facts| facts.format)
    }

    /// The format of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        FACTS.iter().find(|facts| facts.name == name).map(|facts| facts.format)
    }

    fn facts(self) -> &'static Facts {
        &FACTS[self as usize]
    }

    /// The name on the command line and in documents: `bc1`, `bc4s`, `bc6h` ..
    pub fn name(self) -> &'static str {
        self.facts().name
    }

    /// Channels that can hold planes.
    pub fn channels(self) -> usize {
        self.facts().channels
    }

    /// Bytes of a block: 8 or 16.
    pub fn bytes(self) -> usize {
        self.facts().bytes
    }

    /// Values that a channel holds. Halves of BC6H are used from 0 (or -1) to 1.
    pub fn domain(self) -> TexelDomain {
        self.facts().domain
    }

    /// The precision that holds a decoded channel exactly.
    pub fn decoded_precision(self) -> Precision {
        self.facts().decode.precision()
    }
}
