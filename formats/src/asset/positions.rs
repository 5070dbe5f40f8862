//! Positions beside an asset's planes: what is written, and reading them from texels.

use super::AssetFormat;
use super::texture::{Texture, read_exact};
use crate::FormatError;
use crate::error::check_memory;
use relight_core::{NO_SURFACE, PositionMap};
use relight_texture::{PositionPlan, Precision};
use std::path::Path;

/// Bytes of a point in memory.
pub(super) const POINT: u64 = 12;

/// The channels of positions in OpenEXR assets, as [`crate::read_position_file`] finds them too.
pub(super) const POSITION_CHANNELS: [&str; 3] = ["position.X", "position.Y", "position.Z"];

/// Points that are read or written at a time.
pub(super) const PIECE: usize = 1 << 14;

/// Positions to store in an asset.
#[derive(Clone, Debug)]
pub struct AssetPositions {
    /// One point a pixel of the asset.
    pub map: PositionMap,
    /// How they are stored: [`Precision::F16`] relative to the box of all points, or
    /// [`Precision::F32`].
    pub precision: Precision,
}

impl AssetFormat {
    /// Whether this format can hold positions so; `path` is for the message alone.
    ///
    /// # Errors
    /// [`FormatError::Unsupported`] saying what can.
    pub fn check_positions(&self, path: &Path, precision: Precision) -> Result<(), FormatError> {
        let (name, held) = (self.name, self.positions);
        let problem = if held.contains(&precision) {
            return Ok(());
        } else if held.is_empty() {
            format!("{name} holds no positions; write .ktx2, .dds or .exr")
        } else {
            let held: Vec<_> = held.iter().map(|precision| precision.name()).collect();
            format!(
                "{name} holds positions as {}, not {}; choose another",
                held.join(" or "),
                precision.name()
            )
        };
        Err(FormatError::unsupported(path, problem))
    }

    /// Refuses positions that this format can't hold or that are those of other pixels.
    pub(super) fn check_map(
        &self,
        path: &Path,
        (width, height): (usize, usize),
        positions: &AssetPositions,
    ) -> Result<(), FormatError> {
        self.check_positions(path, positions.precision)?;
        let PositionMap { width: across, height: down, points } = &positions.map;
        if (*across, *down) != (width, height) || points.len() != width * height {
            let problem = format!(
                "its positions are {across} x {down} where its pictures are {width} x {height}; give those of the same view"
            );
            return Err(FormatError::invalid(path, problem));
        }
        Ok(())
    }
}

/// The points of a texture of one level and layer, laid out as `plan` says.
pub(super) fn read(
    texture: &Texture,
    plan: &PositionPlan,
    memory_limit: u64,
) -> Result<PositionMap, FormatError> {
    let (width, height) = (texture.shape.width, texture.shape.height);
    let needed = (width as u64).saturating_mul(height as u64).saturating_mul(POINT);
    check_memory(needed, memory_limit, &texture.path)?;
    let mut points = vec![NO_SURFACE; width * height];
    let mut texels = Vec::new();
    texture.for_each_layer(0, memory_limit - needed, |_, bytes| {
        for piece in points.chunks_mut(PIECE) {
            texels.resize(piece.len() * plan.format().unit_bytes(), 0);
            read_exact(&texture.path, bytes, &mut texels)?;
            plan.copy_points(&texels, piece);
        }
        Ok(())
    })?;
    Ok(PositionMap { width, height, points })
}
