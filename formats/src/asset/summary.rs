//! What an asset is, without its texels, in fields and in words.

use super::{AssetFormat, AssetHeader, format_of, layout_name, open_measured, plane_names};
use crate::FormatError;
use relight_core::Basis;
use relight_texture::{Packing, PositionPlan, level_size};
use std::path::{Path, PathBuf};

/// What a format tells of its own.
#[derive(Clone, Debug, Default)]
pub(super) struct Details {
    /// All files, the textures in order; empty where there is one.
    pub(super) files: Vec<PathBuf>,
    /// Bytes of all files, where there are several.
    pub(super) file_bytes: u64,
    pub(super) positions: Option<PositionPlan>,
    /// Facts as name and value.
    pub(super) rows: Vec<(String, String)>,
}

/// What an asset is, without its texels.
#[derive(Clone, Debug)]
pub struct AssetSummary {
    /// Its format.
    pub format: &'static AssetFormat,
    /// Size, model and packing.
    pub header: AssetHeader,
    /// Its files, the textures first.
    pub files: Vec<PathBuf>,
    /// Bytes of all files.
    pub file_bytes: u64,
    /// How its positions lie, where it has some: the last of the textures, or channels of its file.
    pub positions: Option<PositionPlan>,
    /// Facts of the format's own, as name and value.
    pub details: Vec<(String, String)>,
}

/// Reads what an asset is, without its texels.
///
/// # Errors
/// As of [`read_asset`](super::read_asset), short of what only the texels show.
pub fn summarize_asset(path: &Path) -> Result<AssetSummary, FormatError> {
    let format = format_of(path)?;
    let (header, Details { mut files, mut file_bytes, positions, rows: details }) = (format.summarize)(path)?;
    if files.is_empty() {
        (_, file_bytes) = open_measured(path)?;
        files.push(path.to_owned());
    }
    Ok(AssetSummary { format, header, files, file_bytes, positions, details })
}

/// [`summarize_asset`] in words: rows of a name and a value.
///
/// # Errors
/// As of [`summarize_asset`].
pub fn describe_asset(path: &Path) -> Result<Vec<(String, String)>, FormatError> {
    let AssetSummary { format, header, files, file_bytes, positions, details } = summarize_asset(path)?;
    let AssetHeader { width, height, model, packing } = &header;
    let mut rows: Vec<(String, String)> = Vec::new();
    let mut row = |name: &str, value: String| rows.push((name.to_owned(), value));
    row("format", format!("{} ({})", format.name, format.about));
    row("size", format!("{width} x {height}"));
    row(
        "basis",
        match &model.basis {
            Basis::Learned(learned) => {
                let (square, planes) = (learned.square(), learned.planes());
                let part = if square.hemisphere { "hemisphere" } else { "sphere" };
                let nodes = square.nodes;
                format!("{}, {planes} planes, table of {nodes} x {nodes} over the {part}", learned.origin())
            }
            basis => format!("{}, {} functions", basis.family().name, basis.count()),
        },
    );
    row("layout", layout_name(model.layout).to_owned());
    row("space", format!("{:?}", model.space).to_lowercase());
    let formats: Vec<_> = packing.formats().map(|format| format.name()).collect();
    row("texels", formats.join(" + "));
    row("planes", model.plane_count().to_string());
    let lights = model.lights.len();
    row("lights", if lights == 0 { "not recorded".to_owned() } else { lights.to_string() });
    if let Some(figures) = model.figures {
        row("fit rmse", figures.fit_rmse.to_string());
        row("leave-one-out rmse", figures.leave_one_out_rmse.to_string());
    }
    if files.len() > 1 {
        let names = files.iter().map(|file| file.file_name().unwrap_or_default().display().to_string());
        row("files", names.collect::<Vec<_>>().join(" "));
    }
    row("file bytes", file_bytes.to_string());
    if let Some(PositionPlan { precision, scale, bias }) = positions {
        let words = |values: [f32; 3]| values.map(|value| value.to_string()).join(" ");
        let (name, scale, bias) = (precision.name(), words(scale), words(bias));
        row("positions", format!("{name}, scale {scale}, bias {bias}"));
    }
    row("GPU bytes a pixel", bytes_a_pixel(*width, *height, packing).to_string());
    rows.extend(details);
    rows.extend(maps(&header));
    Ok(rows)
}

/// Bytes of all levels as a GPU holds them, padding to whole blocks included, divided by the pixels
/// of level 0; to three digits.
fn bytes_a_pixel(width: usize, height: usize, packing: &Packing) -> f64 {
    let layer_bytes = |format: relight_texture::TexelFormat| -> u64 {
        let levels = 0..packing.levels;
        levels.map(|l| format.layer_bytes(level_size(width, l), level_size(height, l))).sum()
    };
    let bytes: f64 =
        packing.arrays.iter().map(|array| layer_bytes(array.format) as f64 * array.layers.len() as f64).sum();
    (bytes / (width as f64 * height as f64) * 1000.0).round() / 1000.0
}

/// A row for each layer: its planes, scales and biases.
fn maps(header: &AssetHeader) -> Vec<(String, String)> {
    let names = plane_names(&header.model);
    let mut rows = Vec::new();
    for (index, array) in header.packing.arrays.iter().enumerate() {
        for (number, layer) in array.layers.iter().enumerate() {
            let name = match header.packing.arrays.len() {
                1 => format!("layer {number}"),
                _ => format!("layer {index}.{number}"),
            };
            let words = |words: Vec<String>| words.join(" ");
            let planes = words(layer.planes.iter().map(|&plane| names[plane].clone()).collect());
            let scales = words(layer.quantizers.iter().map(|q| q.scale.to_string()).collect());
            let biases = words(layer.quantizers.iter().map(|q| q.bias.to_string()).collect());
            rows.push((name, format!("{planes}, scale {scales}, bias {biases}")));
        }
    }
    rows
}
