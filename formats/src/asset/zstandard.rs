//! Zstandard levels of KTX2: supercompression scheme 2.
//!
//! Levels lie as they are in a temporary file until all texels are there; then each is compressed
//! on its own, the smallest first, a MiB at a time. One thread, a fixed level and no checksum: the
//! same texels give the same bytes.

use super::ktx2;
use super::texture::{LevelPlace, Shape};
use crate::positioned::{read_exact_at, write_all_at};
use crate::{FormatError, OutputFile};
use std::fs::File;
use std::io::{self, Write};

/// Bytes that are compressed at a time.
const PIECE: u64 = 1 << 20;

/// Levels of compression: those beyond would ask readers for windows of more than 8 MiB.
pub(super) const LEVELS: std::ops::RangeInclusive<i32> = 1..=19;

/// Writes a whole texture from levels that lie in `spool` as `places` says.
pub(super) fn compress(
    file: &OutputFile,
    shape: &Shape,
    text: &str,
    (spool, places): (&File, &[LevelPlace]),
    level_of_compression: i32,
) -> Result<(), FormatError> {
    let failed = |e| FormatError::io(file.path(), "write", e);
    let unknown = ktx2::Level { byte_offset: 0, byte_length: 0, uncompressed_byte_length: 0 };
    let mut index = vec![unknown; shape.levels];
    // Its length does not depend on the lengths of levels.
    let mut at = ktx2::head(file.path(), shape, Some(text), Some(&index))?.len() as u64;
    for level in (0..shape.levels).rev() {
        let bytes = shape.level_bytes(level);
        let target = Appending { file: file.file(), at };
        let mut encoder = zstd::stream::write::Encoder::new(target, level_of_compression).map_err(failed)?;
        encoder.include_checksum(false).map_err(failed)?;
        encoder.set_pledged_src_size(Some(bytes)).map_err(failed)?;
        let mut piece = Vec::new();
        let mut done = 0;
        while done < bytes {
            piece.resize(PIECE.min(bytes - done) as usize, 0);
            read_exact_at(spool, places[level].offset + done, &mut piece).map_err(failed)?;
            encoder.write_all(&piece).map_err(failed)?;
            done += piece.len() as u64;
        }
        let end = encoder.finish().map_err(failed)?.at;
        index[level] =
            ktx2::Level { byte_offset: at, byte_length: end - at, uncompressed_byte_length: bytes };
        at = end;
    }
    file.write_at(0, &ktx2::head(file.path(), shape, Some(text), Some(&index))?)
}

/// The end of a file that is also written at other places.
struct Appending<'a> {
    file: &'a File,
    at: u64,
}

impl Write for Appending<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write_all_at(self.file, self.at, bytes)?;
        self.at += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
