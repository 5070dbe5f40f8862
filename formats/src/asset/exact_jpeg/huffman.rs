//! Bits of a scan, and the Huffman codes in them.
//!
//! Source: ITU-T T.81 annexes C and F.2.2.

use super::Damage;

/// Bits with which codes are looked up; few are longer.
const AHEAD: u32 = 9;

/// Codes and their symbols.
pub(super) struct HuffmanTable {
    /// What the next [`AHEAD`] bits begin with: length x 256 + symbol, 0 where the code is longer.
    ahead: [u16; 1 << AHEAD],
    /// For each length the first 16 bits that belong to no code so long or shorter.
    ends: [u32; 17],
    /// For each length what to add to a code for the place of its symbol.
    places: [i32; 17],
    symbols: Vec<u8>,
}

impl HuffmanTable {
    /// From the number of codes of each length 1..16, and their symbols in order; `None` where there are more
    /// codes than bits can tell apart.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let mut table =
            Self { ahead: [0; 1 << AHEAD], ends: [0; 17], places: [0; 17], symbols: symbols.to_vec() };
        let (mut code, mut place) = (0u32, 0usize);
        for (length, &count) in (1..).zip(counts) {
            table.places[length as usize] = place as i32 - code as i32;
            for &symbol in &symbols[place..place + usize::from(count)] {
                if code >= 1 << length {
                    return None;
                }
                if length <= AHEAD {
                    let alike = 1 << (AHEAD - length);
                    let first = (code << (AHEAD - length)) as usize;
                    table.ahead[first..first + alike].fill((length as u16) << 8 | u16::from(symbol));
                }
                code += 1;
            }
            place += usize::from(count);
            table.ends[length as usize] = code << (16 - length);
            code <<= 1;
        }
        Some(table)
    }
}

/// The bits of a scan up to the next marker, the first as the most significant.
pub(super) struct Bits<'a> {
    data: &'a [u8],
    position: usize,
    /// Bits that come next, from the top; below `count` of them zeros.
    next: u64,
    count: u32,
    /// Zeros put after the last bit so far.
    padding: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(data: &'a [u8]) -> Self {
        Self { data, position: 0, next: 0, count: 0, padding: 0 }
    }

    /// Makes at least 32 bits ready: enough for a code and the bits that follow it.
    #[inline(always)]
    fn fill(&mut self) {
        if self.count >= 32 {
            return;
        }
        let four = self.data.get(self.position..).and_then(<[u8]>::first_chunk::<4>);
        if let Some(four) = four.filter(|four| !four.contains(&0xff)) {
            self.next |= u64::from(u32::from_be_bytes(*four)) << (32 - self.count);
            self.count += 32;
            self.position += 4;
        } else {
            self.fill_bytewise();
        }
    }

    #[cold]
    fn fill_bytewise(&mut self) {
        while self.count <= 56 {
            let byte = match self.data.get(self.position..).unwrap_or_default() {
                [0xff, 0, ..] => {
                    self.position += 2;
                    0xff
                }
                // A marker, or the end.
                [0xff, ..] | [] => {
                    self.padding += 8;
                    0
                }
                [byte, ..] => {
                    self.position += 1;
                    *byte
                }
            };
            self.next |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    #[inline(always)]
    fn drop(&mut self, count: u32) {
        self.next <<= count;
        self.count -= count;
    }

    /// The symbol of the next code, which is dropped; 16 bits more are ready.
    #[inline(always)]
    pub(super) fn symbol(&mut self, table: &HuffmanTable) -> Result<u8, Damage> {
        self.fill();
        let entry = table.ahead[(self.next >> (64 - AHEAD)) as usize];
        if entry != 0 {
            self.drop(u32::from(entry >> 8));
            return Ok(entry as u8);
        }
        let window = (self.next >> 48) as u32;
        for length in AHEAD as usize + 1..=16 {
            if window < table.ends[length] {
                let place = (window >> (16 - length)) as i32 + table.places[length];
                self.drop(length as u32);
                return table.symbols.get(place as usize).copied().ok_or(NO_CODE);
            }
        }
        Err(NO_CODE)
    }

    /// A number of `size` bits, 1..16, that [`Self::symbol`] left ready: beginning with 1 as it is, with 0 from
    /// -(2^size - 1) up.
    ///
    /// Source: T.81 figure F.12.
    #[inline(always)]
    pub(super) fn number(&mut self, size: u32) -> i32 {
        let value = (self.next >> (64 - size)) as i32;
        self.drop(size);
        if value < 1 << (size - 1) { value - (1 << size) + 1 } else { value }
    }

    /// Whether more bits were taken than there are.
    pub(super) fn is_overdrawn(&self) -> bool {
        self.count < self.padding
    }

    /// Where the data end, which the bits taken so far must reach to their last byte.
    pub(super) fn end(&self) -> Result<usize, Damage> {
        let is_at_marker = !matches!(self.data.get(self.position..), Some([0xff, 0, ..] | [0..=0xfe, ..]));
        let left = self.count.saturating_sub(self.padding);
        if is_at_marker && left < 8 { Ok(self.position) } else { Err(Damage("data that no block takes")) }
    }
}

const NO_CODE: Damage = Damage("a code that its tables lack");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_all_lengths_are_told_apart() {
        // One code of each length 1..16: n - 1 ones, then a zero; symbols out of order.
        let symbols: Vec<u8> = (1..=16u16).map(|length| (length * 37 % 101) as u8).collect();
        let table = HuffmanTable::new(&[1; 16], &symbols).unwrap();
        let mut text = String::new();
        let sequence: Vec<usize> = (0..200).map(|i| i * i % 16).collect();
        for &i in &sequence {
            text += &("1".repeat(i) + "0");
        }
        text += &"1".repeat(7 - (text.len() + 7) % 8);
        let mut data = Vec::new();
        for byte in text.as_bytes().chunks(8) {
            data.push(u8::from_str_radix(std::str::from_utf8(byte).unwrap(), 2).unwrap());
            if data.last() == Some(&0xff) {
                data.push(0);
            }
        }
        let length = data.len();
        data.extend([0xff, 0xd9]);
        let mut bits = Bits::new(&data);
        for (at, &i) in sequence.iter().enumerate() {
            assert_eq!(bits.symbol(&table), Ok(symbols[i]), "code {at}");
            assert!(at + 9 > sequence.len() || bits.end().is_err(), "{at}");
        }
        assert!(!bits.is_overdrawn());
        assert_eq!(bits.end(), Ok(length));
        // 16 ones are no code; more bits than there are are zeros, of which one is a code.
        assert_eq!(Bits::new(&[0xff, 0, 0xff, 0, 0xff, 0]).symbol(&table), Err(NO_CODE));
        let mut bits = Bits::new(&[0x7f, 0xff, 0xd9]);
        assert_eq!(bits.symbol(&table), Ok(symbols[0]));
        assert_eq!((bits.symbol(&table), bits.is_overdrawn()), (Ok(symbols[7]), true));
        let mut counts = [0; 16];
        counts[1] = 5;
        assert!(HuffmanTable::new(&counts, &[0; 5]).is_none(), "two bits tell four codes apart");
    }

    #[test]
    fn numbers_are_those_of_the_standards_table() {
        // Table F.1: of size 3 -7..-4 and 4..7, in that order of their bits.
        for (bits, number) in (0u8..8).zip([-7, -6, -5, -4, 4, 5, 6, 7]) {
            let mut reader = Bits::new(&[0, 0]);
            (reader.next, reader.count) = (u64::from(bits) << 61, 64);
            assert_eq!(reader.number(3), number);
        }
    }
}
