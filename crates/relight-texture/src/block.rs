//! Block formats: 4 x 4 texels in 8 or 16 bytes.

use crate::{Precision, TexelDomain};

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
#[derive(Clone, Copy, Debug)]
struct Facts {
    format: BlockFormat,
    name: &'static str,
    channels: usize,
    bytes: usize,
    domain: TexelDomain,
    decoded: Precision,
}

const fn facts(
    format: BlockFormat,
    name: &'static str,
    (channels, bytes): (usize, usize),
    domain: TexelDomain,
    decoded: Precision,
) -> Facts {
    Facts { format, name, channels, bytes, domain, decoded }
}

/// All formats, in the order of [`BlockFormat`].
static FACTS: [Facts; 9] = [
    facts(BlockFormat::Bc1, "bc1", (3, 8), TexelDomain::Unit, Precision::U8),
    facts(BlockFormat::Bc3, "bc3", (4, 16), TexelDomain::Unit, Precision::F32),
    facts(BlockFormat::Bc4, "bc4", (1, 8), TexelDomain::Unit, Precision::F32),
    facts(BlockFormat::Bc4Signed, "bc4s", (1, 8), TexelDomain::Signed, Precision::F32),
    facts(BlockFormat::Bc5, "bc5", (2, 16), TexelDomain::Unit, Precision::F32),
    facts(BlockFormat::Bc5Signed, "bc5s", (2, 16), TexelDomain::Signed, Precision::F32),
    facts(BlockFormat::Bc6h, "bc6h", (3, 16), TexelDomain::Unit, Precision::F16),
    facts(BlockFormat::Bc6hSigned, "bc6hs", (3, 16), TexelDomain::Signed, Precision::F16),
    facts(BlockFormat::Bc7, "bc7", (3, 16), TexelDomain::Unit, Precision::U8),
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
        self.facts().decoded
    }
}
