//! The JSON document that stands in KTX2 files under the key `relight`, in EXR files as the
//! attribute `relight` and in manifests beside textures: everything about an asset but its texels.
//! docs/formats.md has its fields.

use crate::FormatError;
use relight_core::{Basis, Direction, FitFigures, Layout, Model, Provenance, Space};
use relight_texture::{ArrayPlan, PositionPlan, Precision, Quantizer, Wrap};
use serde::{Deserialize, Serialize};
use std::path::{Component, Path};

/// The key and the attribute that hold the document.
pub(super) const KEY: &str = "relight";

/// The document's version that this program writes; those before it are read too.
const VERSION: u32 = 2;

/// The longest document that is read: a million lights would fit.
pub(super) const LONGEST: u64 = 32 << 20;

/// Which planes the channels of a texture layer hold, and how texels become coefficients:
/// coefficient = scale x texel + bias.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Layer {
    /// Index of the plane in each channel, in the order of `Model::roles`.
    pub(super) planes: Vec<usize>,
    /// One per plane.
    pub(super) scale: Vec<f32>,
    /// One per plane.
    pub(super) bias: Vec<f32>,
}

/// An array of layers and where it lies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Array {
    /// Name of the texel format; empty in documents of version 1.
    pub(super) format: String,
    /// Names of files in the folder of the document's own: one that holds all layers, or one a
    /// layer; none where the asset is the one file that holds the document.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) files: Vec<String>,
    /// At least one.
    pub(super) layers: Vec<Layer>,
}

/// Where positions lie, and how texels become points: position = scale x texel + bias.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Positions {
    /// Name of the texel format: f16 or f32, four channels.
    pub(super) format: String,
    /// The name of one file in the folder of the document's own.
    pub(super) files: Vec<String>,
    /// By axis.
    pub(super) scale: [f32; 3],
    /// By axis.
    pub(super) bias: [f32; 3],
}

/// What the documents of textures say beyond the model.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Textures {
    /// Tells the files of one asset from those of another; `None` where there is one file.
    pub(super) id: Option<u64>,
    /// What a sampler shall do beyond the edge.
    pub(super) wrap: Wrap,
    /// Mip levels; `None` in documents of version 1.
    pub(super) levels: Option<usize>,
    /// At least one.
    pub(super) arrays: Vec<Array>,
    /// Where there are positions.
    pub(super) positions: Option<(PositionPlan, String)>,
}

/// What a document is about.
#[derive(Debug)]
pub(super) enum Document {
    /// An asset; its textures where the file holds some.
    Asset(Box<Model>, Option<Textures>),
    /// A further file of an asset.
    Part(Part),
}

/// A further file of an asset.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    /// Name of the asset's first file or manifest, where the part knows it.
    pub(super) of: Option<String>,
    /// Its place among the files of the asset, 0 the first.
    pub(super) file: usize,
    /// As of [`Textures::id`].
    pub(super) id: Option<u64>,
}

#[derive(Deserialize)]
struct Versioned {
    version: u32,
    part_of: Option<String>,
}

#[derive(Serialize, Deserialize)]
struct AssetRecord {
    version: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    id: Option<String>,
    basis: Basis,
    layout: Layout,
    space: Space,
    #[serde(default)]
    lights: Vec<Direction>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    error: Option<ErrorRecord>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    provenance: Option<Box<Provenance>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    wrap: Option<WrapRecord>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    levels: Option<usize>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    arrays: Option<Vec<Array>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    positions: Option<Positions>,
    /// Version 1 had one array of the format of its file.
    #[serde(default, skip_serializing)]
    layers: Option<Vec<Layer>>,
}

#[derive(Serialize, Deserialize)]
struct PartRecord {
    version: u32,
    part_of: String,
    file: usize,
    id: String,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum WrapRecord {
    Clamp,
    Repeat,
    Mirror,
}

/// JSON has no word for infinity: what is not finite is null, and comes back as NaN.
#[derive(Serialize, Deserialize)]
struct ErrorRecord {
    fit_rmse: Option<f64>,
    leave_one_out_rmse: Option<f64>,
}

/// The text of a document: for files, and for people.
pub(super) struct Text {
    /// In one line.
    pub(super) line: String,
    /// As of [`Textures::id`].
    pub(super) id: u64,
    record: AssetRecord,
}

impl Text {
    /// The same over many lines, ending with one of its own.
    ///
    /// # Errors
    /// As of [`text_of`].
    pub(super) fn pretty(&self, path: &Path) -> Result<String, FormatError> {
        serde_json::to_string_pretty(&self.record).map(|text| text + "\n").map_err(|e| unwritable(path, &e))
    }
}

/// The record of layers as a document has it.
pub(super) fn array_of(plan: &ArrayPlan, files: Vec<String>) -> Array {
    let layers = plan
        .layers
        .iter()
        .map(|layer| Layer {
            planes: layer.planes.clone(),
            scale: layer.quantizers.iter().map(|quantizer| quantizer.scale).collect(),
            bias: layer.quantizers.iter().map(|quantizer| quantizer.bias).collect(),
        })
        .collect();
    Array { format: plan.format.name().to_owned(), files, layers }
}

/// The record of positions as a document has it.
pub(super) fn positions_of(plan: &PositionPlan, file: String) -> Positions {
    let PositionPlan { precision, scale, bias } = *plan;
    Positions { format: precision.name().to_owned(), files: vec![file], scale, bias }
}

/// The document of `model` and of its textures, the same for the same. An id is given where the
/// arrays name files.
///
/// # Errors
/// [`FormatError::Invalid`] when a number in it is not finite.
pub(super) fn text_of(
    path: &Path,
    model: &Model,
    textures: Option<(Wrap, usize, Vec<Array>)>,
    positions: Option<Positions>,
) -> Result<Text, FormatError> {
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let named =
        textures.as_ref().is_some_and(|(_, _, arrays)| arrays.iter().any(|array| !array.files.is_empty()));
    let (wrap, levels, arrays) = match textures {
        Some((wrap, levels, arrays)) => (Some(wrap_record(wrap)), Some(levels), Some(arrays)),
        None => (None, None, None),
    };
    let mut record = AssetRecord {
        version: VERSION,
        id: None,
        basis: model.basis.clone(),
        layout: model.layout,
        space: model.space,
        lights: model.lights.clone(),
        error: model.figures.map(|figures| ErrorRecord {
            fit_rmse: finite(figures.fit_rmse),
            leave_one_out_rmse: finite(figures.leave_one_out_rmse),
        }),
        provenance: model.provenance.clone(),
        wrap,
        levels,
        arrays,
        positions,
        layers: None,
    };
    let mut line = serde_json::to_string(&record).map_err(|e| unwritable(path, &e))?;
    let id = fnv_1a(line.as_bytes());
    if named {
        record.id = Some(hexadecimal(id));
        line = serde_json::to_string(&record).map_err(|e| unwritable(path, &e))?;
    }
    if line.len() as u64 > LONGEST {
        let (bytes, lights) = (line.len(), model.lights.len());
        let problem =
            format!("metadata of {bytes} bytes ({lights} lights) exceed {LONGEST}; use fewer lights");
        return Err(FormatError::invalid(path, problem));
    }
    Ok(Text { line, id, record })
}

/// The document of the further file number `file` of the asset that begins with file `of`.
///
/// # Errors
/// As of [`text_of`].
pub(super) fn part_text_of(path: &Path, of: &str, file: usize, id: u64) -> Result<String, FormatError> {
    let record = PartRecord { version: VERSION, part_of: of.to_owned(), file, id: hexadecimal(id) };
    serde_json::to_string(&record).map_err(|e| unwritable(path, &e))
}

fn unwritable(path: &Path, error: &serde_json::Error) -> FormatError {
    FormatError::invalid(path, format!("its metadata can't be written: {error}"))
}

/// What a document says.
///
/// # Errors
/// [`FormatError::Unsupported`] for a version that is not ours, [`FormatError::Invalid`] for
/// anything that is not such a document.
pub(super) fn parse(path: &Path, text: &[u8]) -> Result<Document, FormatError> {
    let damaged =
        |problem: String| FormatError::invalid(path, format!("its metadata '{KEY}' are damaged: {problem}"));
    let invalid = |e: serde_json::Error| damaged(e.to_string());
    let Versioned { version, part_of } = serde_json::from_slice(text).map_err(invalid)?;
    if !(1..=VERSION).contains(&version) {
        let problem =
            format!("has metadata of version {version}; this relight reads versions 1 to {VERSION}");
        return Err(FormatError::unsupported(path, problem));
    }
    let id_of = |id: &str| u64::from_str_radix(id, 16).map_err(|_| damaged(format!("id '{id}'")));
    if part_of.is_some() {
        let PartRecord { part_of, file, id, .. } = serde_json::from_slice(text).map_err(invalid)?;
        return Ok(Document::Part(Part { of: Some(part_of), file, id: Some(id_of(&id)?) }));
    }
    let record: AssetRecord = serde_json::from_slice(text).map_err(invalid)?;
    let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let model = Model {
        basis: record.basis,
        layout: record.layout,
        space: record.space,
        lights: record.lights,
        figures: record.error.map(|error| FitFigures {
            fit_rmse: number(error.fit_rmse),
            leave_one_out_rmse: number(error.leave_one_out_rmse),
        }),
        provenance: record.provenance,
    };
    if !model.is_consistent() {
        return Err(damaged("layout 'shared' belongs to learned functions and to no others".to_owned()));
    }
    let only = |layers| vec![Array { layers, ..Array::default() }];
    let Some(arrays) = record.arrays.or(record.layers.map(only)) else {
        return Ok(Document::Asset(Box::new(model), None));
    };
    let positions = record.positions.map(plan_of_positions).transpose().map_err(damaged)?;
    check_arrays(&arrays, model.plane_count()).map_err(damaged)?;
    check_files(&arrays, positions.as_ref().map(|(_, file)| file.as_str())).map_err(damaged)?;
    let textures = Textures {
        id: record.id.as_deref().map(id_of).transpose()?,
        wrap: record.wrap.map_or(Wrap::Clamp, wrap_of),
        levels: record.levels,
        arrays,
        positions,
    };
    Ok(Document::Asset(Box::new(model), Some(textures)))
}

/// Every plane once, a finite scale and bias each.
fn check_arrays(arrays: &[Array], planes: usize) -> Result<(), String> {
    let mut seen = vec![false; planes];
    for (index, layer) in arrays.iter().flat_map(|array| &array.layers).enumerate() {
        let count = layer.planes.len();
        if count == 0 || layer.scale.len() != count || layer.bias.len() != count {
            return Err(format!("layer {index} lists {count} planes without a scale and a bias each"));
        }
        if layer.scale.iter().chain(&layer.bias).any(|value| !value.is_finite()) {
            return Err(format!("layer {index} has a scale or bias that is not finite"));
        }
        for &plane in &layer.planes {
            match seen.get_mut(plane) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(format!("layer {index} lists plane {plane} of {planes} out of turn")),
            }
        }
    }
    if seen.contains(&false) || arrays.iter().any(|array| array.layers.is_empty()) {
        return Err("its layers do not list every plane".to_owned());
    }
    Ok(())
}

/// Files that lie in the document's folder, each named once.
fn check_files(arrays: &[Array], positions: Option<&str>) -> Result<(), String> {
    let mut names: Vec<&str> =
        arrays.iter().flat_map(|array| &array.files).map(String::as_str).chain(positions).collect();
    if let Some(name) = names.iter().find(|name| !is_file_name(name)) {
        return Err(format!("'{}' is not the name of a file in its folder", name.escape_default()));
    }
    for (index, Array { files, layers, .. }) in arrays.iter().enumerate() {
        let alone = files.is_empty() && arrays.len() == 1;
        if !alone && files.len() != 1 && files.len() != layers.len() {
            let (files, layers) = (files.len(), layers.len());
            return Err(format!("array {index} of {layers} layers names {files} files"));
        }
    }
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(format!("it names file {} twice", pair[0])),
        None => Ok(()),
    }
}

/// How positions lie, and in which file.
fn plan_of_positions(positions: Positions) -> Result<(PositionPlan, String), String> {
    let Positions { format, files, scale, bias } = positions;
    let precision = [Precision::F16, Precision::F32].into_iter().find(|precision| precision.name() == format);
    let Some(precision) = precision else {
        return Err(format!("positions of '{}' are neither f16 nor f32", format.escape_default()));
    };
    if scale.iter().chain(&bias).any(|value| !value.is_finite()) {
        return Err("the positions have a scale or bias that is not finite".to_owned());
    }
    match <[String; 1]>::try_from(files) {
        Ok([file]) => Ok((PositionPlan { precision, scale, bias }, file)),
        Err(files) => Err(format!("the positions name {} files, not one", files.len())),
    }
}

/// Whether `name` is a file in the folder itself, on every system: no path leads elsewhere.
pub(super) fn is_file_name(name: &str) -> bool {
    let mut components = Path::new(name).components();
    let plain = matches!(components.next(), Some(Component::Normal(_))) && components.next().is_none();
    plain && name.len() <= 255 && !name.contains(['/', '\\', ':', '\0'])
}

/// The layers of an array as a packer has them.
pub(super) fn layer_plans(layers: &[Layer]) -> Vec<relight_texture::LayerPlan> {
    layers
        .iter()
        .map(|layer| relight_texture::LayerPlan {
            planes: layer.planes.clone(),
            quantizers: layer
                .scale
                .iter()
                .zip(&layer.bias)
                .map(|(&scale, &bias)| Quantizer { scale, bias })
                .collect(),
        })
        .collect()
}

fn wrap_record(wrap: Wrap) -> WrapRecord {
    match wrap {
        Wrap::Clamp => WrapRecord::Clamp,
        Wrap::Repeat => WrapRecord::Repeat,
        Wrap::Mirror => WrapRecord::Mirror,
    }
}

fn wrap_of(record: WrapRecord) -> Wrap {
    match record {
        WrapRecord::Clamp => Wrap::Clamp,
        WrapRecord::Repeat => Wrap::Repeat,
        WrapRecord::Mirror => Wrap::Mirror,
    }
}

fn hexadecimal(id: u64) -> String {
    format!("{id:016x}")
}

/// Fowler, Noll, Vo: a hash that tells documents apart, nothing more.
fn fnv_1a(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
