//! Positions that a bake stores beside its planes.

use crate::failure::Failure;
use crate::options::{Machine, words_of};
use crate::positions::{DepthOptions, note, words};
use clap::{Args, ValueEnum};
use relight_core::PositionMap;
use relight_formats::{AssetFormat, AssetPositions, Crop, FormatError, read_position_file, read_scene};
use relight_texture::{PositionPlan, Precision};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Where positions come from, and how they are stored.
#[derive(Args, Debug)]
#[group(id = "bake_positions")]
pub(super) struct PositionOptions {
    /// Store the position of every pixel, for lights that are near: .exr with channels X, Y, Z, or
    /// --depth and --camera instead
    #[arg(long, value_name = "P.exr", conflicts_with = "depth")]
    positions: Option<PathBuf>,
    #[command(flatten)]
    source: DepthOptions,
    /// How positions are stored: half (relative to their box; default) or float (default in .exr)
    #[arg(long, value_name = "PRECISION", value_enum)]
    positions_precision: Option<PrecisionChoice>,
    /// Store only what this scene needs: positions if it has local lights
    #[arg(long, value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PrecisionChoice {
    Half,
    Float,
}

impl PositionOptions {
    /// The files that are read.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.positions.iter().chain(self.source.files()).chain(&self.scene)
    }

    /// The files that positions are made from.
    pub(super) fn sources(&self) -> impl Iterator<Item = &PathBuf> {
        self.positions.iter().chain(self.source.files())
    }

    /// How positions are to be stored in `format`.
    pub(super) fn precision_words(&self, format: &AssetFormat) -> String {
        let usual = match format.positions.first() {
            Some(Precision::F32) => PrecisionChoice::Float,
            _ => PrecisionChoice::Half,
        };
        words_of(self.positions_precision.unwrap_or(usual))
    }

    /// All that is said of where they come from but for files, by name.
    pub(super) fn named_source(&self) -> Vec<(&'static str, String)> {
        self.source.named()
    }

    /// Whether positions are to be stored, with a note where the scene leaves them out and the files that the scene reads.
    ///
    /// # Errors
    /// As of [`read_scene`]; exit code 2 where the scene needs positions and none are given.
    pub(super) fn wanted(
        &self,
        machine: &Machine,
        notes: &mut Vec<String>,
        read: &mut Vec<PathBuf>,
    ) -> Result<bool, Failure> {
        let given = self.sources().next().is_some();
        let Some(path) = &self.scene else { return Ok(given) };
        let scene = read_scene(path, machine.level, machine.memory)?;
        let local = scene.has_local_lights();
        read.extend(scene.inputs);
        if local && !given {
            let message = format!(
                "{}: has local lights, which need positions; give --positions P.exr, or --depth and --camera",
                path.display()
            );
            return Err(Failure::usage(message));
        }
        if given && !local {
            notes.push(format!("{}: no light is local, so positions are not stored", path.display()));
        }
        Ok(local)
    }

    /// How positions are to be stored in `output`; `None` where there are none.
    ///
    /// # Errors
    /// Exit code 2 where `output` can't hold them. Without `wanted` there are none.
    pub(super) fn precision(
        &self,
        format: &AssetFormat,
        output: &Path,
        wanted: bool,
    ) -> Result<Option<Precision>, Failure> {
        let asked = self.positions_precision.map(|choice| match choice {
            PrecisionChoice::Half => Precision::F16,
            PrecisionChoice::Float => Precision::F32,
        });
        if !wanted {
            return match asked {
                Some(_) if self.sources().next().is_none() => {
                    Err(Failure::usage("--positions-precision belongs to --positions or --depth"))
                }
                _ => Ok(None),
            };
        }
        let precision = asked.or(format.positions.first().copied()).unwrap_or(Precision::F16);
        format.check_positions(output, precision).map_err(Failure::of_output)?;
        Ok(Some(precision))
    }

    /// Reads the positions of whole pictures of `width` x `height` pixels, within `memory` bytes, and keeps those of `crop`.
    pub(super) fn read(
        &self,
        (width, height): (usize, usize),
        crop: Option<Crop>,
        memory: u64,
    ) -> Result<Option<PositionMap>, Failure> {
        let map = match &self.positions {
            Some(path) => Some(read_position_file(path, memory)?),
            None => self.source.read(memory)?,
        };
        if let (Some(map), Some(path)) = (&map, self.sources().next())
            && (map.width, map.height) != (width, height)
        {
            let problem = format!(
                "has {} x {} pixels where the pictures have {width} x {height}; give positions of the same view",
                map.width, map.height
            );
            return Err(FormatError::invalid(path, problem).into());
        }
        Ok(match (map, crop) {
            (Some(map), Some(crop)) => Some(PositionMap {
                width: crop.width,
                height: crop.height,
                points: crop.part_of(&map.points, map.width, 1),
            }),
            (map, _) => map,
        })
    }
}

/// What a bake says of the positions that it stores.
pub(super) struct PositionFacts {
    /// What should be known of a map that can't be meant.
    pub(super) note: Option<String>,
    /// In a line.
    pub(super) words: String,
    /// In the report.
    pub(super) json: Value,
}

impl PositionFacts {
    pub(super) fn of(AssetPositions { map, precision }: &AssetPositions) -> Self {
        let [surface, sky, missing] = map.counts();
        let bounds = map.bounds();
        let PositionPlan { scale, bias, .. } = PositionPlan::new(map, *precision);
        let json = json!({
            "precision": precision.name(),
            "surface": surface,
            "sky": sky,
            "missing": missing,
            "least": bounds.map(|(least, _)| least),
            "largest": bounds.map(|(_, largest)| largest),
            "scale": scale,
            "bias": bias,
        });
        Self { note: note(map), words: format!("positions as {}: {}", precision.name(), words(map)), json }
    }
}
