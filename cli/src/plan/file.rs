//! The file of a plan.

use crate::bake::{Job, key_of};
use crate::explain::{Difference, differences};
use crate::failure::{Exit, Failure};
use relight_core::Provenance;
use relight_fit::SPAN;
use relight_formats::{TileGrid, hexadecimal, write_whole};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

/// A plan: what is baked, and how it is cut.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PlanFile {
    /// The version of its form.
    pub(crate) relight_plan: u32,
    /// The program's.
    pub(crate) relight: String,
    pub(crate) key: String,
    pub(crate) fit_key: String,
    /// As a job file says it; paths are absolute.
    pub(crate) job: BTreeMap<String, String>,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pictures: usize,
    pub(crate) tile_pixels: usize,
    pub(crate) tiles: usize,
    /// Bytes of all files that are read.
    pub(crate) input_bytes: u64,
    /// Bytes of the asset's texels.
    pub(crate) texel_bytes: u64,
    pub(crate) shards: Vec<Shard>,
    pub(crate) merge: Cost,
    pub(crate) provenance: Provenance,
}

/// A part of the work.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Shard {
    /// From 1.
    pub(crate) shard: u32,
    /// The first tile, and the one after the last.
    pub(crate) tiles: [usize; 2],
    pub(crate) pixels: usize,
    /// Bytes of the coefficients that it writes.
    pub(crate) bytes: u64,
    /// Peak memory in bytes, predicted.
    pub(crate) memory: u64,
    /// On one core of the machine of docs/accuracy.md, predicted.
    pub(crate) seconds: f64,
}

/// What the rest takes.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Cost {
    pub(crate) memory: u64,
    pub(crate) seconds: f64,
}

/// The tiles of shard `index` (from 0) of `shards`: as even runs as there can be.
pub(crate) fn tiles_of(index: u32, shards: u32, tiles: usize) -> Range<usize> {
    let edge = |index: u32| (u64::from(index) * tiles as u64 / u64::from(shards)) as usize;
    edge(index)..edge(index + 1)
}

impl PlanFile {
    /// Reads the plan at `path`.
    ///
    /// # Errors
    /// Exit code 3 for a file that is none, or of another version.
    pub(crate) fn read(path: &Path) -> Result<Self, Failure> {
        let refused =
            |problem: String| Failure::new(Exit::BadInput, format!("{}: {problem}", path.display()));
        let text = relight_formats::read_text(path)?;
        let plan: Self =
            serde_json::from_str(&text).map_err(|error| refused(format!("is no plan: {error}")))?;
        if plan.relight_plan != super::VERSION {
            let found = plan.relight_plan;
            return Err(refused(format!(
                "is a plan of version {found}; this relight has {}",
                super::VERSION
            )));
        }
        // The product is checked before it counts.
        let pixels = plan.width.checked_mul(plan.height).filter(|&pixels| pixels > 0 && pixels < 1 << 40);
        let grid = pixels.map(|pixels| TileGrid::new(pixels, SPAN));
        let cut =
            grid.is_some_and(|grid| (grid.count(), grid.tile_pixels()) == (plan.tiles, plan.tile_pixels));
        match cut {
            true => Ok(plan),
            false => Err(refused("its tiles are not those of its pixels; plan again".to_owned())),
        }
    }

    pub(super) fn write(&self, path: &Path) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| Failure::new(Exit::Bug, format!("{}: {error}", path.display())))?;
        write_whole(path, (text + "\n").as_bytes()).map_err(Failure::of_output)
    }

    /// Fails where `job` is no longer what was planned.
    ///
    /// # Errors
    /// Exit code 3 with what differs.
    pub(crate) fn check(&self, path: &Path, job: &Job<'_>) -> Result<(), Failure> {
        if hexadecimal(&key_of(&job.provenance)) == self.key {
            return Ok(());
        }
        let differences = differences(&self.provenance, &job.provenance);
        let words: Vec<String> = differences.iter().take(3).map(Difference::words).collect();
        let what = match differences.iter().all(Difference::is_of_storing) {
            true => "the asset is not stored as was planned",
            false => "the inputs are not those that were planned",
        };
        let message = format!("{}: {what} ({}); plan again", path.display(), words.join("; "));
        Err(Failure::new(Exit::BadInput, message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_cover_every_tile_once_and_evenly() {
        for (shards, tiles) in [(1, 1), (2, 7), (7, 20), (16, 20), (16, 3), (10_000, 256)] {
            let ranges: Vec<_> = (0..shards).map(|index| tiles_of(index, shards, tiles)).collect();
            assert_eq!((ranges[0].start, ranges[shards as usize - 1].end), (0, tiles));
            assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start));
            let longest = ranges.iter().map(ExactSizeIterator::len).max().unwrap();
            assert!(longest <= tiles.div_ceil(shards as usize), "{shards} {tiles}");
        }
    }
}
