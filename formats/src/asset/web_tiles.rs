//! Planes of a web folder in tiles, for pictures that browsers had better not load whole: Deep Zoom's layout.
//!
//! `plane_k.dzi` (XML) and `plane_k_files/LEVEL/COLUMN_ROW.jpg`: the finest level is the picture, each level
//! below half of it, rounded up, down to 1 x 1 at level 0. A tile has `overlap` pixels of each neighbour.
//!
//! Source: Microsoft, *Deep Zoom File Format Overview*; the OpenSeadragon wiki, *The DZI File Format*.

use super::exact_jpeg::decode_planes;
use super::open_measured;
use super::web::OF_A_FILE;
use super::web_jpeg::encode_planes;
use crate::FormatError;
use crate::output_folder::OutputFolder;
use rayon::prelude::*;
use relight_texture::full_levels;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Pixels of a tile's edge without overlap, and of the overlap: together 256, as is usual.
const TILE: usize = 254;
const OVERLAP: usize = 1;

/// More is no description.
const LARGEST_DZI: u64 = 1 << 16;

/// How a picture is cut into tiles.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tiling {
    width: usize,
    height: usize,
    tile: usize,
    overlap: usize,
}

/// A part of a level.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Area {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

/// The name of the description of a file of planes.
pub(super) fn dzi_name(file: usize) -> String {
    format!("plane_{file}.dzi")
}

/// The folder of the tiles beside the description `dzi`.
fn tiles_of(dzi: &Path) -> PathBuf {
    let stem = dzi.file_stem().unwrap_or_default().to_string_lossy();
    dzi.with_file_name(format!("{stem}_files"))
}

/// Whether a file below a web folder, its folders before it, is one of its tiles.
pub(super) fn is_tile(name: &str) -> bool {
    let number = |word: &str| !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_digit());
    let [folder, level, tile] = name.split('/').collect::<Vec<_>>()[..] else { return false };
    let plane = folder.strip_prefix("plane_").and_then(|rest| rest.strip_suffix("_files"));
    let place = tile.strip_suffix(".jpg").and_then(|stem| stem.split_once('_'));
    plane.is_some_and(number) && number(level) && place.is_some_and(|(x, y)| number(x) && number(y))
}

impl Tiling {
    /// The number of the level that is the picture.
    fn finest(self) -> usize {
        let largest = self.width.max(self.height);
        full_levels(largest, 1) - usize::from(largest.is_power_of_two())
    }

    /// Width and height of a level.
    fn size(self, level: usize) -> (usize, usize) {
        let halvings = self.finest() - level;
        (self.width.div_ceil(1 << halvings), self.height.div_ceil(1 << halvings))
    }

    /// The tiles of a level, row by row: column, row, and what they hold.
    fn tiles(self, level: usize) -> impl Iterator<Item = (usize, usize, Area)> {
        let (width, height) = self.size(level);
        let span = move |index: usize, size: usize| {
            let start = (index * self.tile).saturating_sub(self.overlap);
            (start, ((index + 1) * self.tile + self.overlap).min(size) - start)
        };
        let tile = move |column: usize, row: usize| {
            let ((x, width), (y, height)) = (span(column, width), span(row, height));
            (column, row, Area { x, y, width, height })
        };
        let (columns, rows) = (width.div_ceil(self.tile), height.div_ceil(self.tile));
        (0..rows).flat_map(move |row| (0..columns).map(move |column| tile(column, row)))
    }

    /// The description.
    fn xml(self) -> String {
        let Self { width, height, tile, overlap } = self;
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<Image xmlns=\"http://schemas.microsoft.com/deepzoom/2008\" \
             Format=\"jpg\" Overlap=\"{overlap}\" TileSize=\"{tile}\">\n  <Size Width=\"{width}\" \
             Height=\"{height}\"/>\n</Image>\n"
        )
    }
}

/// Copies a tile's samples into those of its level, `width` pixels in a row.
fn place(samples: &[u8], area: Area, width: usize, level: &mut [u8]) {
    for (row, samples) in samples.chunks_exact(OF_A_FILE * area.width).enumerate() {
        let start = OF_A_FILE * ((area.y + row) * width + area.x);
        level[start..start + samples.len()].copy_from_slice(samples);
    }
}

/// Half a plane, rounded up: means of 2 x 2 codes, of fewer at the edges.
fn halved(plane: &[u8], (width, height): (usize, usize)) -> Vec<u8> {
    let mut half = Vec::with_capacity(width.div_ceil(2) * height.div_ceil(2));
    for y in (0..height).step_by(2) {
        for x in (0..width).step_by(2) {
            let at = |dx: usize, dy: usize| {
                u32::from(plane[(y + dy).min(height - 1) * width + (x + dx).min(width - 1)])
            };
            half.push(((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) / 4) as u8);
        }
    }
    half
}

/// Writes the tiles of a file of planes and gives back the samples of the finest level as a reader sees them,
/// the planes interleaved.
pub(super) fn write(
    folder: &OutputFolder,
    file: usize,
    planes: &[Vec<u8>],
    (width, height): (usize, usize),
    quality: u8,
    in_common: bool,
) -> Result<Vec<u8>, FormatError> {
    let tiling = Tiling { width, height, tile: TILE, overlap: OVERLAP };
    let dzi = dzi_name(file);
    folder.write(&dzi, tiling.xml().as_bytes())?;
    let tiles = tiles_of(Path::new(&dzi));
    let mut seen = vec![0; OF_A_FILE * width * height];
    let mut coarser: Option<Vec<Vec<u8>>> = None;
    for level in (0..=tiling.finest()).rev() {
        let size = tiling.size(level);
        let of_level = coarser.as_deref().unwrap_or(planes);
        let encoded = tiling
            .tiles(level)
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|(column, row, area)| {
                let part = |plane: &Vec<u8>| -> Vec<u8> {
                    let rows = (area.y..area.y + area.height).map(|y| y * size.0 + area.x);
                    rows.flat_map(|start| &plane[start..start + area.width]).copied().collect()
                };
                let parts: Vec<_> = of_level.iter().map(part).collect();
                let jpeg = encode_planes(&parts, (area.width, area.height), quality, in_common)
                    .map_err(|error| FormatError::invalid(folder.path(), error.to_string()))?;
                Ok((column, row, area, jpeg))
            })
            .collect::<Result<Vec<_>, FormatError>>()?;
        for (column, row, area, jpeg) in encoded {
            let name = tiles.join(level.to_string()).join(format!("{column}_{row}.jpg"));
            if level == tiling.finest() {
                let samples =
                    decode_planes(&jpeg, (area.width, area.height), OF_A_FILE, folder.path(), u64::MAX)?;
                place(&samples, area, width, &mut seen);
            }
            folder.write_below(&name, &jpeg)?;
        }
        coarser = Some(of_level.iter().map(|plane| halved(plane, size)).collect());
    }
    Ok(seen)
}

/// The samples of the finest level of the tiles that `dzi` describes, the planes interleaved; `held` bytes are
/// spoken for.
pub(super) fn read(
    dzi: &Path,
    (width, height): (usize, usize),
    memory_limit: u64,
    held: u64,
) -> Result<Vec<u8>, FormatError> {
    let tiling = read_dzi(dzi)?;
    if (tiling.width, tiling.height) != (width, height) {
        let problem = format!(
            "has tiles of {} x {} pixels where {width} x {height} are needed; copy the whole folder again",
            tiling.width, tiling.height
        );
        return Err(FormatError::invalid(dzi, problem));
    }
    let needed = held.saturating_add((OF_A_FILE * width * height) as u64);
    if needed > memory_limit {
        return Err(FormatError::too_large(dzi, needed, memory_limit));
    }
    let mut level = vec![0; OF_A_FILE * width * height];
    let folder = tiles_of(dzi).join(tiling.finest().to_string());
    for (column, row, area) in tiling.tiles(tiling.finest()) {
        let path = folder.join(format!("{column}_{row}.jpg"));
        let samples = read_planes(&path, (area.width, area.height), memory_limit, needed)?;
        place(&samples, area, width, &mut level);
    }
    Ok(level)
}

/// The samples of a JPEG of planes; `held` bytes are spoken for.
pub(super) fn read_planes(
    path: &Path,
    size: (usize, usize),
    memory_limit: u64,
    held: u64,
) -> Result<Vec<u8>, FormatError> {
    let (mut file, bytes) = open_measured(path)?;
    let left = memory_limit.saturating_sub(held);
    if bytes > left {
        return Err(FormatError::too_large(path, held.saturating_add(bytes), memory_limit));
    }
    let mut jpeg = Vec::with_capacity(bytes as usize);
    (&mut file).take(bytes).read_to_end(&mut jpeg).map_err(|e| FormatError::io(path, "read", e))?;
    decode_planes(&jpeg, size, OF_A_FILE, path, left - bytes)
}

/// Bytes of all tiles that `dzi` describes, and of itself.
pub(super) fn bytes(dzi: &Path) -> Result<u64, FormatError> {
    let tiling = read_dzi(dzi)?;
    let mut bytes = open_measured(dzi)?.1;
    for level in 0..=tiling.finest() {
        for (column, row, _) in tiling.tiles(level) {
            let path = tiles_of(dzi).join(level.to_string()).join(format!("{column}_{row}.jpg"));
            bytes += open_measured(&path)?.1;
        }
    }
    Ok(bytes)
}

fn read_dzi(path: &Path) -> Result<Tiling, FormatError> {
    let (file, bytes) = open_measured(path)?;
    if bytes > LARGEST_DZI {
        let problem = format!("has {bytes} bytes where {LARGEST_DZI} are the most; copy it again");
        return Err(FormatError::invalid(path, problem));
    }
    let mut text = String::new();
    file.take(LARGEST_DZI).read_to_string(&mut text).map_err(|e| FormatError::io(path, "read", e))?;
    let number = |name: &str, range: std::ops::RangeInclusive<usize>| {
        let found = attribute(&text, name);
        found.and_then(|word| word.parse().ok()).filter(|number| range.contains(number)).ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            let found = found.unwrap_or("none").escape_debug();
            FormatError::invalid(path, format!("needs {name} within {least}..{most}, has '{found}'"))
        })
    };
    let sides = 1..=65_535;
    let (width, height) = (number("Width", sides.clone())?, number("Height", sides.clone())?);
    let tile = number("TileSize", 16..=65_535)?;
    let overlap = number("Overlap", 0..=tile / 2)?;
    match attribute(&text, "Format") {
        Some("jpg") => Ok(Tiling { width, height, tile, overlap }),
        found => {
            let found = found.unwrap_or("none").escape_debug();
            Err(FormatError::unsupported(path, format!("has tiles of Format '{found}'; relight reads jpg")))
        }
    }
}

/// The value of an attribute, the first of that name.
fn attribute<'a>(xml: &'a str, name: &str) -> Option<&'a str> {
    let of = |(at, _): (usize, &str)| {
        let begins = xml[..at].ends_with(char::is_whitespace);
        let value = xml[at + name.len()..].strip_prefix('=').filter(|_| begins)?;
        let quote = value.chars().next().filter(|quote| ['"', '\''].contains(quote))?;
        value[1..].split(quote).next()
    };
    xml.match_indices(name).find_map(of)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_those_of_the_wikis_example() {
        // 8 x 4 pixels, tiles of 3 with 1 of overlap: 6 tiles of 4, 5 and 3 pixels.
        let tiling = Tiling { width: 8, height: 4, tile: 3, overlap: 1 };
        assert_eq!(tiling.finest(), 3);
        let tiles: Vec<_> = tiling.tiles(3).collect();
        let area = |x, y, width, height| Area { x, y, width, height };
        assert_eq!(
            tiles[..3],
            [(0, 0, area(0, 0, 4, 4)), (1, 0, area(2, 0, 5, 4)), (2, 0, area(5, 0, 3, 4))]
        );
        assert_eq!((tiles.len(), tiles[5]), (6, (2, 1, area(5, 2, 3, 2))));
        let sizes: Vec<_> = (0..4).map(|level| tiling.size(level)).collect();
        assert_eq!(sizes, [(1, 1), (2, 1), (4, 2), (8, 4)]);
        for (width, height, finest) in
            [(1, 1, 0), (2, 1, 1), (3, 2, 2), (256, 9, 8), (257, 9, 9), (402, 395, 9)]
        {
            let tiling = Tiling { width, height, tile: TILE, overlap: OVERLAP };
            assert_eq!((tiling.finest(), tiling.size(0)), (finest, (1, 1)), "{width} x {height}");
            let halves =
                |of: (usize, usize), half: (usize, usize)| (of.0.div_ceil(2), of.1.div_ceil(2)) == half;
            assert!((0..finest).all(|level| halves(tiling.size(level + 1), tiling.size(level))));
        }
    }

    #[test]
    fn halves_are_means() {
        assert_eq!(halved(&[0, 4, 200, 8, 12, 100], (3, 2)), [6, 150]);
        assert_eq!(halved(&[7], (1, 1)), [7]);
    }
}
