//! A scan: blocks of one or several components, from bits to samples.
//!
//! Source: ITU-T T.81 annexes F.2.2 and E.2.4.

use super::huffman::{Bits, HuffmanTable};
use super::inverse_dct::{InverseDct, flat};
use super::{CUT_SHORT, Damage};
use relight_core::CpuLevel;

/// Where the coefficients of a file, which go from low to high frequencies, are in a block.
/// Source: T.81 figure A.6.
#[rustfmt::skip]
const ZIGZAG: [u8; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7, 14, 21, 28,
    35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55,
    62, 63,
];

/// Bits that differences of means and other coefficients have at most in files of 8-bit samples.
/// Source: T.81 tables F.1 and F.2.
const LARGEST_DC: u8 = 11;
const LARGEST_AC: u8 = 10;

/// A component in a scan.
pub(super) struct ScanComponent<'a> {
    /// Its place in a pixel.
    pub(super) channel: usize,
    /// Steps of its coefficients in zigzag order.
    pub(super) steps: &'a [u16; 64],
    pub(super) dc: &'a HuffmanTable,
    pub(super) ac: &'a HuffmanTable,
    /// The mean of the block before, in steps.
    pub(super) last_dc: i16,
}

/// Components, all at full size, whose blocks take turns.
pub(super) struct Scan<'a> {
    pub(super) components: Vec<ScanComponent<'a>>,
    /// Groups of blocks between restart markers; 0 for none.
    pub(super) restart_interval: usize,
}

impl Scan<'_> {
    /// Reads the blocks that `data` begins with into `samples`, `width` pixels of `channels` in a row; gives the
    /// bytes they take.
    pub(super) fn read(
        mut self,
        data: &[u8],
        width: usize,
        channels: usize,
        samples: &mut [u8],
    ) -> Result<usize, Damage> {
        let level = CpuLevel::detect();
        let height = samples.len() / (width * channels);
        let (across, down) = (width.div_ceil(8), height.div_ceil(8));
        let (mut bits, mut start) = (Bits::new(data), 0);
        let mut coefficients = [[0; 8]; 8];
        for group in 0..across * down {
            if self.restart_interval > 0 && group > 0 && group % self.restart_interval == 0 {
                start = after_restart(data, start + bits.end()?, group / self.restart_interval - 1)?;
                bits = Bits::new(&data[start..]);
                self.components.iter_mut().for_each(|component| component.last_dc = 0);
            }
            let (column, row) = (8 * (group % across), 8 * (group / across));
            for component in &mut self.components {
                let is_flat = read_block(&mut bits, component, &mut coefficients)?;
                let codes = if is_flat {
                    [[flat(coefficients[0][0]); 8]; 8]
                } else {
                    let codes = level.run(InverseDct(&coefficients));
                    coefficients = [[0; 8]; 8];
                    codes
                };
                for (y, codes) in (row..height).zip(codes) {
                    let at = (y * width + column) * channels + component.channel;
                    let places = samples[at..(y + 1) * width * channels].iter_mut().step_by(channels);
                    places.zip(codes).for_each(|(place, code)| *place = code);
                }
            }
            if bits.is_overdrawn() {
                return Err(CUT_SHORT);
            }
        }
        Ok(start + bits.end()?)
    }
}

/// Where data go on after restart marker `number` (counted from 0, 8 of them in turn), which must stand at
/// `position`.
fn after_restart(data: &[u8], position: usize, number: usize) -> Result<usize, Damage> {
    let expected = 0xd0 + (number % 8) as u8;
    let fill = data[position..].iter().take_while(|&&byte| byte == 0xff).count();
    match data.get(position + fill) {
        Some(&marker) if marker == expected => Ok(position + fill + 1),
        Some(_) => Err(Damage("its data end before a restart marker")),
        None => Err(CUT_SHORT),
    }
}

/// Reads a block into `coefficients`, zeros but for the first, times their steps, row by row; whether none but
/// the first was there.
#[inline(always)]
fn read_block(
    bits: &mut Bits<'_>,
    component: &mut ScanComponent<'_>,
    coefficients: &mut [[i32; 8]; 8],
) -> Result<bool, Damage> {
    let size = bits.symbol(component.dc)?;
    if size > LARGEST_DC {
        return Err(Damage("a mean of more bits than 8-bit samples have"));
    }
    if size > 0 {
        component.last_dc = component.last_dc.wrapping_add(bits.number(u32::from(size)) as i16);
    }
    coefficients[0][0] = i32::from(component.last_dc) * i32::from(component.steps[0]);
    let (mut next, mut is_flat) = (1, true);
    while next < 64 {
        let symbol = bits.symbol(component.ac)?;
        let (run, size) = (usize::from(symbol >> 4), symbol & 15);
        if size == 0 && run < 15 {
            break;
        }
        let at = next + run;
        if at > 63 || size > LARGEST_AC {
            return Err(Damage("a coefficient beyond its block or beyond what 8-bit samples have"));
        }
        if size > 0 {
            let value = bits.number(u32::from(size)) * i32::from(component.steps[at]);
            let place = usize::from(ZIGZAG[at]);
            coefficients[place / 8][place % 8] = value;
            is_flat = false;
        }
        next = at + 1;
    }
    Ok(is_flat)
}
