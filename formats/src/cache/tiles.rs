//! A fit on disk: what it found, and its coefficients in tiles.

use super::sealed::{HEAD_BYTES, Seal};
use super::{read_within, touch};
use crate::asset::coefficients;
use crate::positioned::read_exact_at;
use crate::temporary::remove_all_strays;
use crate::{FormatError, OutputFile, create_folder, write_whole};
use rayon::prelude::*;
use relight_core::{CoefficientDistribution, CoefficientSpan, Model, Spare, Stack, StackError, StackRows};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{self, File};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The file of what a fit found.
pub(super) const FACTS: &str = "facts";

/// The largest file of facts or distributions that is read: tables of learned functions for a thousand lights take a tenth, the
/// distributions of a thousand planes about a fifth.
const LARGEST_FACTS: u64 = 64 << 20;

/// The file of how its coefficients are distributed.
const DISTRIBUTIONS: &str = "distributions";

/// Most tiles of a picture.
const MOST_TILES: usize = 256;

/// Bytes that are hashed at a time.
const PIECE: usize = 1 << 20;

/// How the pixels of a picture are cut into tiles: runs of whole spans, as many at most as there are kinds of bytes. It
/// depends on the size of the picture alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileGrid {
    pixels: usize,
    tile: usize,
}

impl TileGrid {
    /// Of a picture of `pixels` pixels that are fitted in spans of `span`, at least 1.
    pub fn new(pixels: usize, span: usize) -> Self {
        Self { pixels, tile: span * pixels.div_ceil(span).div_ceil(MOST_TILES).max(1) }
    }

    /// How many tiles there are.
    pub fn count(&self) -> usize {
        self.pixels.div_ceil(self.tile)
    }

    /// The pixels of tile `index`.
    pub fn pixels(&self, index: usize) -> Range<usize> {
        let first = index * self.tile;
        first..(first + self.tile).min(self.pixels)
    }

    /// The pixels of every tile but the last.
    pub fn tile_pixels(&self) -> usize {
        self.tile
    }
}

/// The folder of a fit.
#[derive(Clone, Debug)]
pub struct FitFolder {
    folder: PathBuf,
    key: [u8; 32],
}

/// What was found in the folder of a fit.
#[derive(Debug)]
pub struct Tiles {
    /// The wanted tiles that are whole, opened; one a tile of the grid.
    pub files: Vec<Option<File>>,
    /// How many were odd, and are removed.
    pub odd: usize,
}

impl FitFolder {
    /// The fit of `key` in `folder`.
    pub fn new(folder: PathBuf, key: [u8; 32]) -> Self {
        Self { folder, key }
    }

    /// Makes the folder where it is missing; what killed runs left in it goes.
    ///
    /// # Errors
    /// [`FormatError::Io`].
    pub fn create(&self) -> Result<(), FormatError> {
        self.remove_strays();
        create_folder(&self.folder)
    }

    /// Removes the temporaries that killed runs left in the folder.
    pub fn remove_strays(&self) {
        remove_all_strays(&self.folder);
    }

    /// What [`Self::keep_facts`] kept: `Ok(None)` where there is nothing, `Err` where it was odd and is removed.
    ///
    /// # Errors
    /// [`Odd`].
    pub fn facts<T: DeserializeOwned>(&self) -> Result<Option<T>, Odd> {
        let facts = self.opened(FACTS, *b"fact")?;
        if facts.is_some() {
            touch(&self.folder.join(FACTS));
        }
        Ok(facts)
    }

    /// Keeps what a fit found.
    ///
    /// # Errors
    /// [`FormatError::Io`], for instance on a full disk.
    pub fn keep_facts(&self, facts: &impl Serialize) -> Result<(), FormatError> {
        write_whole(&self.folder.join(FACTS), &self.seal(*b"fact", 0).close(facts))
    }

    /// What [`Self::keep_distributions`] kept, as [`Self::facts`].
    ///
    /// # Errors
    /// [`Odd`].
    pub fn distributions(&self) -> Result<Option<Vec<CoefficientDistribution>>, Odd> {
        self.opened(DISTRIBUTIONS, *b"dist")
    }

    /// Keeps how the coefficients of each plane are distributed, unless that is more than would be read again.
    ///
    /// # Errors
    /// [`FormatError::Io`], for instance on a full disk.
    pub fn keep_distributions(&self, planes: &[CoefficientDistribution]) -> Result<(), FormatError> {
        let file = self.seal(*b"dist", 0).close(&planes);
        if file.len() as u64 > LARGEST_FACTS {
            return Ok(());
        }
        write_whole(&self.folder.join(DISTRIBUTIONS), &file)
    }

    fn opened<T: DeserializeOwned>(&self, name: &str, kind: [u8; 4]) -> Result<Option<T>, Odd> {
        let path = self.folder.join(name);
        let Some(bytes) = read_within(&path, LARGEST_FACTS) else {
            return if path.exists() { Err(self.remove(&path)) } else { Ok(None) };
        };
        self.seal(kind, 0).open(&bytes, LARGEST_FACTS).map(Some).ok_or_else(|| self.remove(&path))
    }

    /// Those of the tiles `wanted` that are there, of `planes` planes each; every one is read and its checksum compared.
    pub fn tiles(&self, grid: TileGrid, planes: usize, wanted: &[usize]) -> Tiles {
        let found: Vec<Result<Option<File>, Odd>> =
            wanted.par_iter().map(|&tile| self.tile(tile, payload(grid, tile, planes))).collect();
        let odd = found.iter().filter(|tile| tile.is_err()).count();
        let mut files: Vec<Option<File>> = (0..grid.count()).map(|_| None).collect();
        for (&tile, found) in wanted.iter().zip(found) {
            files[tile] = found.unwrap_or(None);
        }
        Tiles { files, odd }
    }

    /// Whether there is a file of tile `index`, whole or not.
    pub fn has_file_of_tile(&self, index: usize) -> bool {
        self.tile_path(index).is_file()
    }

    /// Whether tile `index` is there and whole, without reading all of it.
    pub fn has_tile(&self, grid: TileGrid, planes: usize, index: usize) -> bool {
        let payload = payload(grid, index, planes);
        let opened = File::open(self.tile_path(index));
        opened.is_ok_and(|file| self.promised(&file, index, payload).is_some())
    }

    /// Starts tile `index`.
    ///
    /// # Errors
    /// [`FormatError::Io`].
    pub fn tile_writer(
        &self,
        grid: TileGrid,
        planes: usize,
        index: usize,
    ) -> Result<TileWriter, FormatError> {
        let file = OutputFile::create(&self.tile_path(index))?;
        Ok(TileWriter { file, seal: self.seal(*b"tile", index as u64), pixels: grid.pixels(index), planes })
    }

    /// The files in the folder that are of another fit or of none, by name.
    ///
    /// # Errors
    /// [`FormatError::Io`] where the folder can't be read.
    pub fn foreign(&self) -> Result<Vec<String>, FormatError> {
        let failed = |source| FormatError::io(&self.folder, "read", source);
        let mut names = Vec::new();
        for entry in fs::read_dir(&self.folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with('.') {
                continue;
            }
            let mut head = [0; HEAD_BYTES];
            let read = File::open(entry.path()).and_then(|file| read_exact_at(&file, 0, &mut head));
            let ours = read.is_ok() && Seal::key_in(&head) == Some(self.key);
            if !ours {
                names.push(name);
            }
        }
        names.sort();
        Ok(names)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    fn seal(&self, kind: [u8; 4], part: u64) -> Seal {
        Seal { kind, part, key: self.key }
    }

    fn tile_path(&self, index: usize) -> PathBuf {
        self.folder.join(format!("tile-{index:03}"))
    }

    /// The hash that tile `index` says it has.
    fn promised(&self, file: &File, index: usize, payload: u64) -> Option<[u8; 32]> {
        let mut head = [0; HEAD_BYTES];
        let whole = file.metadata().ok()?.len() == payload + HEAD_BYTES as u64;
        read_exact_at(file, 0, &mut head).ok().filter(|()| whole)?;
        self.seal(*b"tile", index as u64).hash_after(&head, payload)
    }

    fn tile(&self, index: usize, payload: u64) -> Result<Option<File>, Odd> {
        let path = self.tile_path(index);
        let Ok(file) = File::open(&path) else { return Ok(None) };
        let promised = self.promised(&file, index, payload);
        if promised.is_some() && hash_of(&file, payload).ok() == promised {
            return Ok(Some(file));
        }
        Err(self.remove(&path))
    }

    /// Takes away what is odd.
    fn remove(&self, path: &Path) -> Odd {
        // What can't be removed is odd the next time too.
        drop(fs::remove_file(path));
        Odd
    }
}

/// Something was odd and is removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Odd;

fn payload(grid: TileGrid, tile: usize, planes: usize) -> u64 {
    (grid.pixels(tile).len() * planes) as u64 * 4
}

/// The hash of the `payload` bytes after a head.
fn hash_of(file: &File, payload: u64) -> io::Result<[u8; 32]> {
    let mut hasher = blake3::Hasher::new();
    let mut piece = vec![0; PIECE.min(payload as usize)];
    let mut done = 0;
    while done < payload {
        let count = ((payload - done) as usize).min(PIECE);
        read_exact_at(file, HEAD_BYTES as u64 + done, &mut piece[..count])?;
        hasher.update(&piece[..count]);
        done += count as u64;
    }
    Ok(*hasher.finalize().as_bytes())
}

/// A tile on its way to disk: each plane's coefficients in a row, f32, little-endian.
#[derive(Debug)]
pub struct TileWriter {
    file: OutputFile,
    seal: Seal,
    pixels: Range<usize>,
    planes: usize,
}

impl TileWriter {
    /// Writes the planes of `model` of a run of the tile's pixels; many threads may at once, each pixel once.
    ///
    /// # Errors
    /// [`FormatError::Io`], for instance on a full disk.
    ///
    /// # Panics
    /// When the run leaves the tile.
    pub fn write(&self, span: &CoefficientSpan<'_>, model: &Model) -> Result<(), FormatError> {
        let first = span.first - self.pixels.start;
        assert!(first + span.pixels <= self.pixels.len(), "the run leaves the tile");
        for plane in 0..self.planes {
            let values = coefficients(span, model, plane, 0..span.pixels);
            let bytes: Vec<u8> = values.flat_map(|value| value.to_le_bytes()).collect();
            self.file.write_at(place(&self.pixels, plane, first), &bytes)?;
        }
        Ok(())
    }

    /// Puts the tile in its place and opens it.
    ///
    /// # Errors
    /// [`FormatError::Io`].
    pub fn finish(self) -> Result<File, FormatError> {
        let payload = (self.pixels.len() * self.planes) as u64 * 4;
        let hash = hash_of(self.file.file(), payload)
            .map_err(|source| FormatError::io(self.file.path(), "read", source))?;
        self.file.write_at(0, &self.seal.head(payload, hash))?;
        let path = self.file.path().to_owned();
        self.file.finish()?;
        File::open(&path).map_err(|source| FormatError::io(&path, "open", source))
    }
}

/// Where pixel `first` of `plane` lies in the file of a tile.
fn place(pixels: &Range<usize>, plane: usize, first: usize) -> u64 {
    HEAD_BYTES as u64 + (plane * pixels.len() + first) as u64 * 4
}

/// The planes of a fit that was kept, as pictures of one channel, in the order of [`Model::roles`].
#[derive(Debug)]
pub struct TileStack {
    width: usize,
    height: usize,
    planes: usize,
    grid: TileGrid,
    folder: PathBuf,
    files: Vec<File>,
    buffers: Spare<Vec<f32>>,
}

impl TileStack {
    /// Of all `tiles` of `folder`; `None` where one is missing.
    ///
    /// # Panics
    /// When the grid is that of another size.
    pub fn new(
        folder: &FitFolder,
        (width, height): (usize, usize),
        grid: TileGrid,
        planes: usize,
        tiles: Tiles,
    ) -> Option<Self> {
        assert_eq!((width * height, grid.count()), (grid.pixels, tiles.files.len()), "a grid of the picture");
        let files = tiles.files.into_iter().collect::<Option<Vec<_>>>()?;
        Some(Self {
            width,
            height,
            planes,
            grid,
            folder: folder.folder.clone(),
            files,
            buffers: Spare::default(),
        })
    }
}

impl Stack for TileStack {
    fn lights(&self) -> usize {
        self.planes
    }

    fn width(&self) -> usize {
        self.width
    }

    fn height(&self) -> usize {
        self.height
    }

    fn channels(&self) -> usize {
        1
    }

    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
        assert!(samples.end <= self.pixels(), "the samples leave the planes");
        let count = samples.len();
        let mut values = self.buffers.take();
        values.resize(self.planes * count, 0.0);
        let mut at = samples.start;
        while at < samples.end {
            let tile = at / self.grid.tile;
            let pixels = self.grid.pixels(tile);
            let run = samples.end.min(pixels.end) - at;
            for plane in 0..self.planes {
                let row = &mut values[plane * count + at - samples.start..][..run];
                let bytes = bytemuck::cast_slice_mut(row);
                read_exact_at(&self.files[tile], place(&pixels, plane, at - pixels.start), bytes).map_err(
                    |source| StackError { context: format!("cannot read {}", self.folder.display()), source },
                )?;
                row.iter_mut().for_each(|value| *value = f32::from_bits(u32::from_le(value.to_bits())));
            }
            at += run;
        }
        Ok(Box::new(TileRows { stack: self, values, count }))
    }
}

struct TileRows<'a> {
    stack: &'a TileStack,
    values: Vec<f32>,
    count: usize,
}

impl Drop for TileRows<'_> {
    fn drop(&mut self) {
        self.stack.buffers.give(std::mem::take(&mut self.values));
    }
}

impl StackRows for TileRows<'_> {
    fn copy(&self, plane: usize, first: usize, out: &mut [f32]) {
        out.copy_from_slice(&self.values[plane * self.count..][..self.count][first..][..out.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_core::basis::Ptm;
    use relight_core::{Basis, CoefficientCounter, Layout, Space};

    #[test]
    fn a_grid_covers_every_pixel_once_in_few_tiles() {
        for pixels in [1, 8191, 8192, 8193, 1 << 20, 500_000_000] {
            let grid = TileGrid::new(pixels, 8192);
            assert!((1..=MOST_TILES).contains(&grid.count()), "{pixels}");
            let mut next = 0;
            for tile in 0..grid.count() {
                let range = grid.pixels(tile);
                assert_eq!(range.start, next);
                assert!(range.start.is_multiple_of(8192) && !range.is_empty());
                next = range.end;
            }
            assert_eq!(next, pixels);
        }
    }

    #[test]
    fn distributions_come_back_and_odd_ones_do_not() {
        let around = tempfile::tempdir().unwrap();
        let folder = FitFolder::new(around.path().join("fit"), [5; 32]);
        folder.create().unwrap();
        assert_eq!(folder.distributions(), Ok(None));
        let mut counters = [CoefficientCounter::new(), CoefficientCounter::new(), CoefficientCounter::new()];
        let row: Vec<f32> = (0..600).map(|i| (i as f32 - 300.0) * 1e-3).collect();
        CoefficientCounter::add_interleaved(&mut counters, &row, 0);
        CoefficientCounter::add_interleaved(&mut counters[2..], &[f32::NAN], 200);
        let kept: Vec<_> = counters.iter().map(CoefficientCounter::distribution).collect();
        folder.keep_distributions(&kept).unwrap();
        assert_eq!(folder.distributions(), Ok(Some(kept)));
        assert_eq!(folder.foreign().unwrap(), Vec::<String>::new());
        let path = folder.path().join(DISTRIBUTIONS);
        let mut bytes = fs::read(&path).unwrap();
        bytes[HEAD_BYTES + 3] ^= 1;
        fs::write(&path, bytes).unwrap();
        assert_eq!(folder.distributions(), Err(Odd));
        assert_eq!(folder.distributions(), Ok(None), "what is odd is removed");
    }

    #[test]
    fn coefficients_come_back_from_tiles_and_odd_tiles_do_not() {
        let around = tempfile::tempdir().unwrap();
        let folder = FitFolder::new(around.path().join("fit"), [5; 32]);
        folder.create().unwrap();
        let model = Model {
            basis: Basis::Ptm(Ptm::with_count(6).unwrap()),
            layout: Layout::Lrgb,
            space: Space::Encoded,
            lights: Vec::new(),
            figures: None,
            provenance: None,
        };
        let (width, height, planes) = (7, 5, model.plane_count());
        let grid = TileGrid { pixels: 35, tile: 16 };
        let value = |plane: usize, pixel: usize| (plane * 100 + pixel) as f32 + 0.25;
        let write = |tile: usize| {
            let writer = folder.tile_writer(grid, planes, tile).unwrap();
            let pixels = grid.pixels(tile);
            let middle = pixels.start + pixels.len() / 2;
            for run in [middle..pixels.end, pixels.start..middle] {
                let maps: Vec<f32> =
                    (0..6).flat_map(|plane| run.clone().map(move |pixel| value(plane, pixel))).collect();
                let base: Vec<f32> =
                    run.clone().flat_map(|pixel| (6..9).map(move |plane| value(plane, pixel))).collect();
                let span =
                    CoefficientSpan { first: run.start, pixels: run.len(), maps: &maps, base_color: &base };
                writer.write(&span, &model).unwrap();
            }
            writer.finish().unwrap();
        };
        write(0);
        write(2);
        let tiles = folder.tiles(grid, planes, &[0, 1, 2]);
        assert_eq!(
            (tiles.odd, tiles.files.iter().map(Option::is_some).collect()),
            (0, vec![true, false, true])
        );
        assert!(TileStack::new(&folder, (width, height), grid, planes, tiles).is_none());
        write(1);
        let stack =
            TileStack::new(&folder, (width, height), grid, planes, folder.tiles(grid, planes, &[0, 1, 2]))
                .unwrap();
        let rows = stack.rows(10..34).unwrap();
        for plane in 0..planes {
            let mut out = [0.0; 20];
            rows.copy(plane, 3, &mut out);
            assert!(
                out.iter().enumerate().all(|(i, &found)| found == value(plane, 13 + i)),
                "{plane} {out:?}"
            );
        }
        drop(rows);
        // One bit, another place, another number of planes, a shorter file.
        let path = folder.tile_path(1);
        let whole = fs::read(&path).unwrap();
        for at in [0, 20, 95, HEAD_BYTES, whole.len() - 1] {
            let mut odd = whole.clone();
            odd[at] ^= 4;
            fs::write(&path, &odd).unwrap();
            assert_eq!(folder.tiles(grid, planes, &[0, 1, 2]).odd, 1, "byte {at}");
            assert!(!path.exists());
        }
        fs::write(&path, &whole[..whole.len() - 4]).unwrap();
        assert!(!folder.has_tile(grid, planes, 1));
        assert_eq!(folder.tiles(grid, planes, &[0, 1, 2]).odd, 1);
        fs::copy(folder.tile_path(0), &path).unwrap();
        assert_eq!(folder.tiles(grid, planes, &[0, 1, 2]).odd, 1);
        assert_eq!(folder.tiles(grid, planes - 1, &[0, 1, 2]).odd, 2);
    }
}
