//! One texture in a file: its shape, where its layers lie, and reading them as a stream.

use super::document::Document;
use crate::FormatError;
use crate::positioned::read_exact_at;
use relight_texture::{TexelFormat, level_size};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// The window that a Zstandard frame may always ask for, as a power of two: that of level 19.
const WINDOW: u32 = 23;

/// The largest window that decoders take by themselves.
const LARGEST_WINDOW: u32 = 27;

/// What a texture is, without its texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    /// Texels in a row of level 0.
    pub(super) width: usize,
    /// Rows of level 0.
    pub(super) height: usize,
    pub(super) format: TexelFormat,
    /// At least 1.
    pub(super) levels: usize,
    /// At least 1.
    pub(super) layers: usize,
    /// Whether it is an array texture, even of one layer.
    pub(super) array: bool,
}

impl Shape {
    /// Bytes of a layer of a level; saturates.
    pub(super) fn layer_bytes(&self, level: usize) -> u64 {
        self.format.layer_bytes(level_size(self.width, level), level_size(self.height, level))
    }

    /// Bytes of all layers of a level; saturates.
    pub(super) fn level_bytes(&self, level: usize) -> u64 {
        self.layer_bytes(level).saturating_mul(self.layers as u64)
    }

    /// Bytes of all levels; saturates.
    pub(super) fn bytes(&self) -> u64 {
        (0..self.levels).map(|level| self.level_bytes(level)).fold(0, u64::saturating_add)
    }
}

/// Where the layers of a level lie in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LevelPlace {
    /// Where the first begins.
    pub(super) offset: u64,
    /// Bytes from one to the next.
    pub(super) stride: u64,
}

/// How a file stores its levels.
#[derive(Clone, Debug)]
pub(super) enum Storage {
    /// As they are.
    Plain(Vec<LevelPlace>),
    /// Each as Zstandard frames of (offset, bytes).
    Zstandard(Vec<(u64, u64)>),
}

/// An opened texture, checked against the size of its file.
#[derive(Debug)]
pub(super) struct Texture {
    pub(super) path: PathBuf,
    pub(super) file: File,
    pub(super) file_bytes: u64,
    pub(super) shape: Shape,
    /// The format as its standard calls it.
    pub(super) format_name: String,
    /// What it says of the asset that it belongs to; `None` where another program wrote it.
    pub(super) label: Option<Document>,
    pub(super) storage: Storage,
}

impl Texture {
    /// Hands a reader of each layer of `level` on, in order, which gives just that layer's bytes.
    /// A decoder's window may take `spare` bytes of memory, or 8 MiB.
    pub(super) fn for_each_layer(
        &self,
        level: usize,
        spare: u64,
        mut take: impl FnMut(usize, &mut dyn Read) -> Result<(), FormatError>,
    ) -> Result<(), FormatError> {
        let Self { shape, path, .. } = self;
        let layer_bytes = shape.layer_bytes(level);
        match &self.storage {
            Storage::Plain(places) => {
                for layer in 0..shape.layers {
                    let LevelPlace { offset, stride } = places[level];
                    let at = offset + layer as u64 * stride;
                    take(layer, &mut Positioned { file: &self.file, at, end: at + layer_bytes })?;
                }
            }
            Storage::Zstandard(frames) => {
                let (at, bytes) = frames[level];
                let stored = Positioned { file: &self.file, at, end: at + bytes };
                let failed = |e: io::Error| read_error(path, e);
                let mut decoder =
                    zstd::stream::read::Decoder::with_buffer(BufReader::with_capacity(1 << 17, stored))
                        .map_err(failed)?;
                let window = spare.max(1).ilog2().clamp(WINDOW, LARGEST_WINDOW);
                decoder.window_log_max(window).map_err(failed)?;
                for layer in 0..shape.layers {
                    take(layer, &mut (&mut decoder).take(layer_bytes))?;
                }
                if decoder.read(&mut [0]).map_err(failed)? != 0 {
                    let problem =
                        format!("level {level} holds more than its {} bytes", shape.level_bytes(level));
                    return Err(FormatError::invalid(path, problem));
                }
            }
        }
        Ok(())
    }
}

/// A part of a file, by positioned reads: the cursor of the file is nobody's.
struct Positioned<'a> {
    file: &'a File,
    at: u64,
    end: u64,
}

impl Read for Positioned<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = bytes.len().min(usize::try_from(self.end - self.at).unwrap_or(usize::MAX));
        read_exact_at(self.file, self.at, &mut bytes[..count])?;
        self.at += count as u64;
        Ok(count)
    }
}

/// Fills `bytes`, and says in words when they end before.
pub(super) fn read_exact(path: &Path, from: &mut dyn Read, bytes: &mut [u8]) -> Result<(), FormatError> {
    from.read_exact(bytes).map_err(|e| read_error(path, e))
}

/// What a decoder refuses is a damaged file; everything else is the system's word.
fn read_error(path: &Path, error: io::Error) -> FormatError {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => FormatError::invalid(path, "is cut short"),
        io::ErrorKind::Other | io::ErrorKind::InvalidData => {
            FormatError::invalid(path, format!("damaged Zstandard: {error}"))
        }
        _ => FormatError::io(path, "read", error),
    }
}
