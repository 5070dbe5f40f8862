//! JPEG decoded to the very codes that browsers see: planes are numbers, and a code of a spherical harmonic's
//! plane is worth up to ten of a picture's.
//!
//! What every browser has is libjpeg-turbo with its accurate inverse DCT. Baseline files of components at full
//! size, all that writers of planes make, are decoded here with the same integers; other kinds (progressive,
//! subsampled, arithmetic) by the decoder of pictures, whose codes differ by 1 at one in a hundred pixels.
//!
//! Source: ITU-T T.81 annexes B, C, F; the arithmetic is that of the Independent JPEG Group's libjpeg
//! (`jidctint.c`, `jdcolor.c`; IJG licence), to which libjpeg-turbo's own is identical bit by bit.

mod huffman;
mod inverse_dct;
mod scan;

use crate::FormatError;
use crate::error::check_memory;
use crate::picture::{check_jpeg, damaged_jpeg, decode_jpeg};
use huffman::HuffmanTable;
use scan::{Scan, ScanComponent};
use std::path::Path;

/// What is wrong with a file's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Damage(&'static str);

const CUT_SHORT: Damage = Damage("it ends before its last row");
const BAD_TABLE: Damage = Damage("a table that contradicts itself");
const BAD_SCAN: Damage = Damage("a scan of components or tables that it lacks");

/// Bytes of a JFIF segment that count, and of Adobe's.
const JFIF_BYTES: usize = 14;
const ADOBE_BYTES: usize = 12;

/// Decodes a JPEG of `channels` (1 or 3) planes, 8 bits a sample, interleaved, rows from the top; 0..255.
///
/// `path` is for messages. `memory_limit` bounds the samples, for other kinds the decoder, too; `bytes` are the
/// caller's.
/// # Errors
/// [`FormatError::Invalid`] for damaged or truncated bytes and other sizes, refused before memory is asked for;
/// [`FormatError::Unsupported`] for kinds that are not read; [`FormatError::TooLarge`] beyond `memory_limit`.
pub(super) fn decode_planes(
    bytes: &[u8],
    (width, height): (usize, usize),
    channels: usize,
    path: &Path,
    memory_limit: u64,
) -> Result<Vec<u8>, FormatError> {
    check_jpeg(bytes, (width, height), channels, path)?;
    let damaged = |Damage(cause)| damaged_jpeg(path, cause);
    let mut decoder = Decoder { bytes, position: 2, ..Decoder::default() };
    if !decoder.walk_to_frame().map_err(damaged)? {
        return decode_jpeg(bytes, path, memory_limit);
    }
    let needed = (width as u64).saturating_mul(height as u64).saturating_mul(channels as u64);
    check_memory(needed, memory_limit, path)?;
    let count = usize::try_from(needed).map_err(|_| FormatError::too_large(path, needed, memory_limit))?;
    let mut samples = vec![0; count];
    decoder.read_scans(width, &mut samples).map_err(damaged)?;
    if decoder.is_ycc() {
        rgb_from_ycc(&mut samples);
    }
    Ok(samples)
}

/// A component of the frame.
struct Component {
    id: u8,
    /// The number of its table of steps.
    steps: usize,
    /// Whether its scan has been read.
    is_read: bool,
}

/// What has been read so far.
#[derive(Default)]
struct Decoder<'a> {
    bytes: &'a [u8],
    position: usize,
    components: Vec<Component>,
    /// Steps of quantisation in zigzag order.
    steps: [Option<[u16; 64]>; 4],
    dc_tables: [Option<HuffmanTable>; 4],
    ac_tables: [Option<HuffmanTable>; 4],
    /// Groups of blocks between restart markers; 0 for none.
    restart_interval: usize,
    is_jfif: bool,
    adobe_transform: Option<u8>,
}

impl<'a> Decoder<'a> {
    /// Reads up to and including the frame header; `false` when its kind is another decoder's.
    fn walk_to_frame(&mut self) -> Result<bool, Damage> {
        loop {
            let (marker, segment) = self.next_segment()?;
            match marker {
                0xc0 | 0xc1 => return self.read_frame(segment),
                0xc4 => self.read_huffman_tables(segment)?,
                0xc2..=0xcf => return Ok(false),
                _ => self.read_other(marker, segment)?,
            }
        }
    }

    /// Reads everything after the frame header into `samples`, `width` pixels in a row.
    fn read_scans(&mut self, width: usize, samples: &mut [u8]) -> Result<(), Damage> {
        loop {
            let (marker, segment) = self.next_segment()?;
            match marker {
                0xc4 => self.read_huffman_tables(segment)?,
                0xc0..=0xcf => return Err(Damage("a second frame")),
                0xda => self.read_scan(segment, width, samples)?,
                0xd9 if self.components.iter().all(|component| component.is_read) => return Ok(()),
                0xd9 => return Err(CUT_SHORT),
                _ => self.read_other(marker, segment)?,
            }
        }
    }

    /// The next marker and what belongs to it; nothing for those that stand alone.
    fn next_segment(&mut self) -> Result<(u8, &'a [u8]), Damage> {
        let rest = self.bytes.get(self.position..).unwrap_or_default();
        let is_marker = |pair: &[u8]| pair[0] == 0xff && ![0, 0xff].contains(&pair[1]);
        let skipped = rest.windows(2).position(is_marker).ok_or(CUT_SHORT)?;
        let marker = rest[skipped + 1];
        self.position += skipped + 2;
        if marker == 0x01 || (0xd0..=0xd9).contains(&marker) {
            return Ok((marker, &[]));
        }
        let Some([high, low, rest @ ..]) = self.bytes.get(self.position..) else { return Err(CUT_SHORT) };
        let length = usize::from(u16::from_be_bytes([*high, *low]));
        let content = length.checked_sub(2).ok_or(Damage("a segment of less than 2 bytes"))?;
        self.position += length;
        Ok((marker, rest.get(..content).ok_or(CUT_SHORT)?))
    }

    fn read_other(&mut self, marker: u8, segment: &[u8]) -> Result<(), Damage> {
        match (marker, segment) {
            (0xdb, tables) => self.read_steps(tables)?,
            (0xdd, [high, low]) => {
                self.restart_interval = usize::from(u16::from_be_bytes([*high, *low]));
            }
            (0xdd, _) => return Err(Damage("a restart interval of other than 2 bytes")),
            (0xe0, jfif) if jfif.len() >= JFIF_BYTES && jfif.starts_with(b"JFIF\0") => self.is_jfif = true,
            (0xee, adobe) if adobe.len() >= ADOBE_BYTES && adobe.starts_with(b"Adobe") => {
                self.adobe_transform = Some(adobe[ADOBE_BYTES - 1]);
            }
            _ => {}
        }
        Ok(())
    }

    fn read_frame(&mut self, segment: &[u8]) -> Result<bool, Damage> {
        // Precision, height, width and the number of components have been checked.
        let components = segment.get(6..).unwrap_or_default();
        let count = usize::from(segment.get(5).copied().unwrap_or_default());
        if components.len() != 3 * count {
            return Err(Damage("a frame header of another length than its components take"));
        }
        for component in components.chunks_exact(3) {
            if component[1] != 0x11 {
                return Ok(false);
            }
            let (id, steps) = (component[0], usize::from(component[2]));
            self.components.push(Component { id, steps, is_read: false });
        }
        Ok(true)
    }

    fn read_steps(&mut self, mut tables: &[u8]) -> Result<(), Damage> {
        while let [kind, rest @ ..] = tables {
            let (wide, number) = (kind >> 4 != 0, usize::from(kind & 15));
            let (steps, rest) = rest.split_at_checked(if wide { 128 } else { 64 }).ok_or(BAD_TABLE)?;
            let place = self.steps.get_mut(number).ok_or(BAD_TABLE)?;
            let step = |i: usize| {
                if wide { u16::from_be_bytes([steps[2 * i], steps[2 * i + 1]]) } else { u16::from(steps[i]) }
            };
            *place = Some(std::array::from_fn(step));
            tables = rest;
        }
        Ok(())
    }

    fn read_huffman_tables(&mut self, mut tables: &[u8]) -> Result<(), Damage> {
        while let [kind, rest @ ..] = tables {
            let of_kind = if kind >> 4 == 0 { &mut self.dc_tables } else { &mut self.ac_tables };
            let place = of_kind.get_mut(usize::from(kind & 15)).ok_or(BAD_TABLE)?;
            let (counts, rest) = rest.split_first_chunk::<16>().ok_or(BAD_TABLE)?;
            let symbols = counts.iter().map(|&count| usize::from(count)).sum();
            let (symbols, rest) = rest.split_at_checked(symbols).ok_or(BAD_TABLE)?;
            *place = Some(HuffmanTable::new(counts, symbols).ok_or(BAD_TABLE)?);
            tables = rest;
        }
        Ok(())
    }

    fn read_scan(&mut self, segment: &[u8], width: usize, samples: &mut [u8]) -> Result<(), Damage> {
        let [count, rest @ ..] = segment else { return Err(BAD_SCAN) };
        // Three bytes follow that only progressive files use.
        let named = rest.get(..2 * usize::from(*count)).ok_or(BAD_SCAN)?;
        let mut components: Vec<ScanComponent<'_>> = Vec::with_capacity(self.components.len());
        for pair in named.chunks_exact(2) {
            let of_id = |component: &Component| component.id == pair[0] && !component.is_read;
            let channel = self.components.iter().position(of_id).ok_or(BAD_SCAN)?;
            self.components[channel].is_read = true;
            let (dc, ac) = (usize::from(pair[1] >> 4), usize::from(pair[1] & 15));
            components.push(ScanComponent {
                channel,
                steps: self
                    .steps
                    .get(self.components[channel].steps)
                    .and_then(Option::as_ref)
                    .ok_or(BAD_SCAN)?,
                dc: self.dc_tables.get(dc).and_then(Option::as_ref).ok_or(BAD_SCAN)?,
                ac: self.ac_tables.get(ac).and_then(Option::as_ref).ok_or(BAD_SCAN)?,
                last_dc: 0,
            });
        }
        if components.is_empty() {
            return Err(BAD_SCAN);
        }
        let scan = Scan { components, restart_interval: self.restart_interval };
        let data = &self.bytes[self.position..];
        self.position += scan.read(data, width, self.components.len(), samples)?;
        Ok(())
    }

    /// Whether components are Y, Cb and Cr, in the order in which libjpeg believes what a file says.
    fn is_ycc(&self) -> bool {
        let ids: Vec<u8> = self.components.iter().map(|component| component.id).collect();
        match (self.is_jfif, self.adobe_transform) {
            _ if ids.len() != 3 => false,
            (true, _) => true,
            (_, Some(transform)) => transform != 0,
            _ => ids != *b"RGB",
        }
    }
}

/// `value` in 16 bits after the point, rounded.
const fn fixed(value: f64) -> i32 {
    (value * 65536.0 + 0.5) as i32
}

/// JFIF's conversion, 0..255 to 0..255, each product rounded once, the two of green together.
///
/// Source: JFIF 1.02; libjpeg `jdcolor.c`.
fn rgb_from_ycc(samples: &mut [u8]) {
    const HALF: i32 = 1 << 15;
    for pixel in samples.as_chunks_mut::<3>().0 {
        let [y, cb, cr] = pixel.map(i32::from);
        let (cb, cr) = (cb - 128, cr - 128);
        let r = y + ((fixed(1.402) * cr + HALF) >> 16);
        let g = y + ((HALF - fixed(0.34414) * cb - fixed(0.71414) * cr) >> 16);
        let b = y + ((fixed(1.772) * cb + HALF) >> 16);
        *pixel = [r, g, b].map(|code| code.clamp(0, 255) as u8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::web_jpeg::encode_planes;
    use crate::{Samples, picture};
    use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
    use relight_core::CpuLevel;
    use std::path::PathBuf;
    use std::time::Instant;

    const SIZE: (usize, usize) = (45, 27);

    /// Slopes with noise on them, black and white included, each plane its own.
    fn planes((width, height): (usize, usize)) -> Vec<Vec<u8>> {
        let code = |p: usize, i: usize| {
            let (x, y) = (i % width, i / width);
            let noise = (i * 7919 + p * 104_729) * 31 % 97 % (8 << p);
            (x * (11 - 3 * p) + y * (2 + 3 * p) + noise).saturating_sub(60).min(255) as u8
        };
        (0..3).map(|p| (0..width * height).map(|i| code(p, i)).collect()).collect()
    }

    /// A JPEG of [`planes`] as R, G, B, by settings of its own.
    fn encoded(size: (usize, usize), set: impl Fn(&mut Encoder<&mut Vec<u8>>)) -> Vec<u8> {
        let planes = planes(size);
        let samples: Vec<u8> = (0..3 * size.0 * size.1).map(|i| planes[i % 3][i / 3]).collect();
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, 85);
        encoder.set_sampling_factor(SamplingFactor::F_1_1);
        set(&mut encoder);
        encoder.encode(&samples, size.0 as u16, size.1 as u16, ColorType::Rgb).unwrap();
        bytes
    }

    fn decoded(bytes: &[u8], size: (usize, usize), channels: usize) -> Result<Vec<u8>, FormatError> {
        decode_planes(bytes, size, channels, Path::new("a.jpg"), 1 << 30)
    }

    fn by_the_decoder_of_pictures(bytes: &[u8]) -> Vec<u8> {
        let picture = picture::decode_bytes(bytes, Path::new("a.jpg"), CpuLevel::BASELINE, 1 << 30).unwrap();
        let Samples::U8(samples) = picture.samples else { panic!("8 bits") };
        samples
    }

    fn testdata(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/jpeg").join(name)
    }

    #[test]
    fn every_code_is_that_of_libjpeg_turbo() {
        let files = [
            ("ycc", (45, 27), 3),
            ("rgb", (45, 27), 3),
            ("scans", (61, 19), 3),
            ("restarts", (45, 27), 3),
            ("letters", (45, 27), 3),
            ("grey", (45, 27), 1),
        ];
        let mut others = 0;
        for (name, size, channels) in files {
            let bytes = std::fs::read(testdata(&format!("{name}.jpg"))).unwrap();
            let theirs = std::fs::read(testdata(&format!("{name}.png"))).unwrap();
            let theirs = by_the_decoder_of_pictures(&theirs);
            let ours = decoded(&bytes, size, channels).unwrap();
            assert_eq!(ours.len(), theirs.len(), "{name}");
            let worst = ours.iter().zip(&theirs).map(|(a, b)| a.abs_diff(*b)).max();
            assert_eq!(worst, Some(0), "{name}: {} codes differ", unlike(&ours, &theirs));
            if name != "letters" {
                others += unlike(&by_the_decoder_of_pictures(&bytes), &theirs);
            }
        }
        assert!(others > 30, "another decoder's roundings show at {others} codes only: this tests nothing");
    }

    fn unlike(a: &[u8], b: &[u8]) -> usize {
        a.iter().zip(b).filter(|(a, b)| a != b).count()
    }

    #[test]
    fn colours_are_those_of_jfif_rounded() {
        let mut largest = 0.0f64;
        for (cb, cr) in (0..=255u8).flat_map(|cb| (0..=255u8).map(move |cr| (cb, cr))) {
            let mut pixel = [120, cb, cr];
            rgb_from_ycc(&mut pixel);
            let (b, r) = (f64::from(cb) - 128.0, f64::from(cr) - 128.0);
            let exact = [1.402 * r, -0.344_14 * b - 0.714_14 * r, 1.772 * b];
            for (found, exact) in pixel.into_iter().zip(exact) {
                largest = largest.max((f64::from(found) - (120.0 + exact).clamp(0.0, 255.0)).abs());
            }
        }
        assert!((0.49..0.505).contains(&largest), "off by {largest}");
    }

    #[test]
    fn other_kinds_are_read_by_the_decoder_of_pictures() {
        let subsampled = encoded(SIZE, |encoder| encoder.set_sampling_factor(SamplingFactor::F_2_2));
        let progressive = encoded(SIZE, |encoder| encoder.set_progressive(true));
        for bytes in [subsampled, progressive] {
            assert!(decoded(&bytes, SIZE, 3).unwrap() == by_the_decoder_of_pictures(&bytes));
        }
    }

    #[test]
    fn what_is_cut_or_out_of_turn_is_refused_in_a_sentence() {
        let plain = encoded(SIZE, |_| {});
        let scans = encoded(SIZE, |encoder| encoder.set_optimized_huffman_tables(true));
        let restarts = encoded(SIZE, |encoder| encoder.set_restart_interval(2));
        for whole in [&plain, &scans, &restarts] {
            for length in 0..whole.len() {
                let refused = decoded(&whole[..length], SIZE, 3).unwrap_err().to_string();
                let told = refused.contains("truncated or damaged JPEG") && refused.contains("copy it again");
                assert!(told || refused.contains("is no JPEG"), "{length} bytes: {refused}");
            }
            // Its end is told to be here by a marker.
            let ended = [&whole[..whole.len() - 40], &[0xff, 0xd9]].concat();
            assert!(decoded(&ended, SIZE, 3).unwrap_err().to_string().contains("truncated or damaged"));
        }
        let refusal = |bytes: &[u8]| decoded(bytes, SIZE, 3).unwrap_err().to_string();
        let marker = restarts.windows(2).position(|pair| pair == [0xff, 0xd1]).unwrap();
        let mut other = restarts.clone();
        other[marker + 1] = 0xd2;
        assert!(refusal(&other).contains("its data end before a restart marker"), "{}", refusal(&other));
        other.drain(marker..marker + 2);
        assert!(refusal(&other).contains("truncated or damaged"), "{}", refusal(&other));
        let end = plain.len() - 2;
        let more = [&plain[..end], &[0x55; 9], &plain[end..]].concat();
        assert!(refusal(&more).contains("data that no block takes"), "{}", refusal(&more));
        let first = scans.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap();
        let mut twice = scans.clone();
        twice[first + 5] = 2;
        assert!(refusal(&twice).contains("a scan of components or tables that it lacks"));
        assert!(
            decoded(&plain, (45, 28), 3).unwrap_err().to_string().contains("45 x 27 pixels of 3 channels")
        );
        let needed = (45 * 27 * 3) as u64;
        let within = |limit| decode_planes(&plain, SIZE, 3, Path::new("a.jpg"), limit);
        assert!(within(needed).is_ok());
        assert!(matches!(within(needed - 1), Err(FormatError::TooLarge { .. })));
    }

    #[test]
    fn mangled_bytes_are_errors_or_pictures_and_take_no_longer() {
        let mut state = 3u64;
        let mut random = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        let sources = [
            encode_planes(&planes(SIZE), SIZE, 80, false).unwrap(),
            encode_planes(&planes((300, 20)), (300, 20), 80, true).unwrap(),
            encoded(SIZE, |encoder| encoder.set_restart_interval(2)),
        ];
        for (whole, size) in sources.iter().zip([SIZE, (300, 20), SIZE]) {
            let (mut read, rounds) = (0, 4000);
            let start = Instant::now();
            for round in 0..rounds {
                let mut bytes = whole.clone();
                for _ in 0..1 + random(3) {
                    let at = random(if round % 2 == 0 { 640 } else { bytes.len() });
                    bytes[at] = [0xff, 0, bytes[at] ^ 1 << random(8)][random(3)];
                }
                if round % 7 == 0 {
                    bytes.truncate(random(bytes.len()));
                }
                if let Ok(samples) = decoded(&bytes, size, 3) {
                    assert_eq!(samples.len(), 3 * size.0 * size.1);
                    read += 1;
                }
            }
            assert!((rounds / 50..rounds * 9 / 10).contains(&read), "{read} of {rounds} were read");
            assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
        }
    }
}
