//! Functions of light that were learned from the pictures themselves: a table over directions.
//!
//! A pixel is mean + sum over planes of plane x weight, where mean and weights differ from channel to
//! channel. Each of these functions is a column of a table whose nodes lie on an octahedral square, bilinear
//! between them.
//!
//! Source: principal components over lights and channels with interpolated directions, MATH.md sections 4 and
//! 5; Ponchio, Corsini, Scopigno, *Relight: a compact and accurate RTI representation for the web*, 2019.

use super::{BasisError, FunctionsOfLight};
use crate::Direction;
use crate::sphere::Octahedral;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use half::f16;
use serde::{Deserialize, Serialize};

/// The most planes that may be learned.
pub(super) const MAX_PLANES: usize = 128;

/// The longest origin, in bytes.
const LONGEST_ORIGIN: usize = 40;

/// Functions 0 .. channels are the mean, then each plane has one a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Record", into = "Record")]
pub struct Learned {
    origin: String,
    planes: usize,
    channels: usize,
    square: Octahedral,
    /// By node, then function; numbers that halves hold.
    table: Vec<f32>,
}

#[derive(Serialize, Deserialize)]
struct Record {
    origin: String,
    planes: usize,
    channels: usize,
    #[serde(flatten)]
    square: Octahedral,
    /// Halves in little endian, in base 64.
    table: String,
}

impl TryFrom<Record> for Learned {
    type Error = BasisError;

    fn try_from(record: Record) -> Result<Self, BasisError> {
        let Record { origin, planes, channels, square, table } = record;
        let bytes = STANDARD.decode(&table).map_err(|_| BasisError::Table { problem: "no base 64" })?;
        let (halves, rest) = bytes.as_chunks::<2>();
        if !rest.is_empty() {
            return Err(BasisError::Table { problem: "half a number at the end" });
        }
        let table = halves.iter().map(|bytes| f16::from_le_bytes(*bytes).to_f32()).collect();
        Self::new(origin, planes, channels, square, table)
    }
}

impl From<Learned> for Record {
    fn from(learned: Learned) -> Self {
        let Learned { origin, planes, channels, square, table } = learned;
        let bytes: Vec<u8> = table.into_iter().flat_map(|value| f16::from_f32(value).to_le_bytes()).collect();
        Self { origin, planes, channels, square, table: STANDARD.encode(bytes) }
    }
}

impl Learned {
    /// The functions of `planes` planes and the mean in `channels` channels (1 or 3): `table` holds, node by
    /// node of `square`, (planes + 1) x channels values, which are rounded to halves. `origin` says in a
    /// word or two where the functions come from.
    ///
    /// # Errors
    /// [`BasisError::Count`] for 0 planes or more than 128; [`BasisError::Table`] for shapes and values that
    /// are not as said.
    pub fn new(
        origin: String,
        planes: usize,
        channels: usize,
        square: Octahedral,
        mut table: Vec<f32>,
    ) -> Result<Self, BasisError> {
        let counts = super::Counts::UpTo(MAX_PLANES);
        if !counts.contains(planes) {
            return Err(BasisError::Count { family: "pca", count: planes, counts });
        }
        for value in &mut table {
            *value = f16::from_f32(*value).to_f32();
        }
        let problem = if channels != 1 && channels != 3 {
            "channels other than 1 or 3"
        } else if !square.is_valid() {
            "an edge of other than 2 to 256 nodes"
        } else if table.len() != square.count() * channels * (planes + 1) {
            "another number of values than nodes x channels x (planes + 1)"
        } else if table.iter().any(|value| !value.is_finite()) {
            "values beyond those of halves"
        } else if origin.len() > LONGEST_ORIGIN || origin.chars().any(char::is_control) {
            "an origin of more than 40 bytes or with control characters"
        } else {
            return Ok(Self { origin, planes, channels, square, table });
        };
        Err(BasisError::Table { problem })
    }

    /// As [`Learned::new`] with a table of zeros: for what is only to be counted.
    ///
    /// # Errors
    /// As there.
    pub fn blank(planes: usize, channels: usize) -> Result<Self, BasisError> {
        let square = Octahedral { nodes: 2, hemisphere: true };
        let values = square.count() * channels * planes.saturating_add(1).min(MAX_PLANES + 1);
        Self::new(String::new(), planes, channels, square, vec![0.0; values])
    }

    /// Where the functions come from, in a word or two.
    pub fn origin(&self) -> &str {
        &self.origin
    }

    /// Number of planes.
    pub fn planes(&self) -> usize {
        self.planes
    }

    /// Channels of the relit picture: 1 or 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Where the table's nodes lie.
    pub fn square(&self) -> Octahedral {
        self.square
    }

    /// The values: node by node, function by function.
    pub fn table(&self) -> &[f32] {
        &self.table
    }

    /// The function that plane `plane` has in channel `channel`.
    pub fn function(&self, plane: usize, channel: usize) -> usize {
        (plane + 1) * self.channels + channel
    }
}

impl FunctionsOfLight for Learned {
    fn count(&self) -> usize {
        (self.planes + 1) * self.channels
    }

    fn evaluate(&self, light: Direction, weights: &mut [f64]) {
        let count = self.count();
        let taps = self.square.taps(light);
        let weights = &mut weights[..count];
        weights.fill(0.0);
        for (node, factor) in taps.nodes.into_iter().zip(taps.weights) {
            for (weight, value) in weights.iter_mut().zip(&self.table[node * count..][..count]) {
                *weight += factor * f64::from(*value);
            }
        }
    }

    fn label(&self, j: usize) -> String {
        let channel = match self.channels {
            1 => "",
            _ => [".R", ".G", ".B"][j % 3],
        };
        match j / self.channels {
            0 => format!("mean{channel}"),
            plane => format!("p{}{channel}", plane - 1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn learned() -> Learned {
        let square = Octahedral { nodes: 3, hemisphere: true };
        let table = (0..9 * 9).map(|i| i as f32 * 0.25 - 3.0).collect();
        Learned::new("pca".to_owned(), 2, 3, square, table).unwrap()
    }

    #[test]
    fn the_nodes_hold_their_values_and_json_keeps_them() {
        let learned = learned();
        let mut weights = [0.0; 9];
        learned.evaluate(Direction::OUT, &mut weights);
        let middle: Vec<f64> = (36..45).map(|i| f64::from(i) * 0.25 - 3.0).collect();
        assert_eq!(weights.to_vec(), middle);
        assert_eq!(learned.label(0), "mean.R");
        assert_eq!(learned.label(learned.function(1, 2)), "p1.B");
        let text = serde_json::to_string(&learned).unwrap();
        assert_eq!(serde_json::from_str::<Learned>(&text).unwrap(), learned);
    }

    #[test]
    fn damaged_tables_are_refused() {
        let text = serde_json::to_string(&learned()).unwrap();
        for (from, to) in [
            ("\"nodes\":3", "\"nodes\":4"),
            ("\"nodes\":3", "\"nodes\":1"),
            ("\"nodes\":3", "\"nodes\":3000000000"),
            ("\"planes\":2", "\"planes\":0"),
            ("\"planes\":2", "\"planes\":18446744073709551615"),
            ("\"channels\":3", "\"channels\":2"),
            ("\"origin\":\"pca\"", "\"origin\":\"a\\nb\""),
            ("\"table\":\"", "\"table\":\"*"),
            ("\"table\":\"", "\"table\":\"AAAA"),
        ] {
            let damaged = text.replacen(from, to, 1);
            assert_ne!(damaged, text);
            assert!(serde_json::from_str::<Learned>(&damaged).is_err(), "{damaged}");
        }
        // The half's infinity.
        let mut infinite = learned();
        infinite.table[5] = f32::INFINITY;
        let text = serde_json::to_string(&infinite).unwrap();
        assert!(serde_json::from_str::<Learned>(&text).is_err());
    }
}
