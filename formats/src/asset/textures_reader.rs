//! Reading the files of an asset of textures: by its first file or by its manifest.
//!
//! Levels and layers are streamed: beside what is asked for, a reader holds some hundred KiB.

use super::document::{self, Array, Document, Part, Textures};
use super::texture::{Shape, Storage, Texture, read_exact};
use super::textures::{Container, MANIFEST};
use super::unpack::Unpacker;
use super::{AssetHeader, Details, open_measured, positions};
use crate::FormatError;
use crate::error::check_memory;
use relight_core::{Model, PositionMap, RelightingMaps};
use relight_texture::{ArrayPlan, PackedMaps, Packing, PositionPlan};
use std::io::Read;
use std::path::{Path, PathBuf};

/// An asset whose files are open, each checked against the document.
struct Asset {
    header: AssetHeader,
    /// By array: one file of all its layers, or one a layer.
    textures: Vec<Vec<Texture>>,
    manifest: Option<PathBuf>,
    positions: Option<UnopenedPositions>,
}

/// Positions that nobody asked for yet.
struct UnopenedPositions {
    plan: PositionPlan,
    /// The name of their file.
    file: String,
    /// As of [`Textures::id`].
    id: Option<u64>,
}

/// What a manifest says.
pub(super) fn read_manifest(path: &Path) -> Result<(Box<Model>, Textures), FormatError> {
    let (file, bytes) = open_measured(path)?;
    if bytes > document::LONGEST * 2 {
        return Err(FormatError::invalid(path, format!("is no manifest: {bytes} bytes exceed any")));
    }
    let mut text = Vec::new();
    file.take(document::LONGEST * 2).read_to_end(&mut text).map_err(|e| FormatError::io(path, "read", e))?;
    match document::parse(path, &text)? {
        Document::Asset(model, Some(textures)) if !textures.arrays[0].files.is_empty() => {
            Ok((model, textures))
        }
        _ => Err(FormatError::invalid(path, "is no manifest of an asset: it lists no files")),
    }
}

/// Opens an asset by its first file or its manifest.
fn open(container: Container, path: &Path) -> Result<Asset, FormatError> {
    if is_manifest(path)? {
        let (model, textures) = read_manifest(path)?;
        return assemble(container, path, *model, textures, None, Some(path.to_owned()));
    }
    let mut first = container.open(path)?;
    match (first.label.take(), container) {
        (Some(Document::Asset(model, Some(textures))), _) => {
            assemble(container, path, *model, textures, Some(first), None)
        }
        (Some(Document::Part(part)), Container::Dds) if part.file == 0 => {
            let manifest = path.with_extension(MANIFEST);
            if !manifest.exists() {
                let name = manifest.file_name().unwrap_or_default().display();
                let problem =
                    format!("its manifest {name}, which says what its layers are, is missing beside it");
                return Err(FormatError::invalid(path, problem));
            }
            let (model, textures) = read_manifest(&manifest)?;
            check_id(path, Some(&Document::Part(part)), textures.id)?;
            assemble(container, path, *model, textures, Some(first), Some(manifest))
        }
        (Some(Document::Part(Part { of, file, .. })), _) => {
            let whole =
                of.map_or_else(|| "that asset's first file or manifest".to_owned(), |of| format!("'{of}'"));
            let problem = format!("is further file {file} of an asset; name {whole} instead");
            Err(FormatError::unsupported(path, problem))
        }
        (Some(Document::Asset(_, None)), _) => {
            Err(FormatError::invalid(path, format!("its key '{}' lists no layers", document::KEY)))
        }
        (None, Container::Ktx2) => {
            let problem = format!("has no key '{}': it is a texture, but no asset of relight", document::KEY);
            Err(FormatError::unsupported(path, problem))
        }
        (None, Container::Dds) => Err(FormatError::unsupported(
            path,
            "is a texture, but no asset of relight: it has no mark of ours",
        )),
    }
}

/// Whether a file is JSON, by its first byte.
pub(super) fn is_manifest(path: &Path) -> Result<bool, FormatError> {
    let mut start = [0];
    let count = super::open(path)?.read(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    Ok(count == 1 && start[0] == b'{')
}

/// The first file that a manifest lists.
pub(super) fn first_file(manifest: &Path) -> Result<PathBuf, FormatError> {
    let (_, textures) = read_manifest(manifest)?;
    existing(manifest, &textures.arrays[0].files[0])
}

/// The place of file `name` beside `path`.
fn existing(path: &Path, name: &str) -> Result<PathBuf, FormatError> {
    let file = path.with_file_name(name);
    if file.exists() {
        return Ok(file);
    }
    let problem = format!("its file {name} is missing beside it; an asset's files stay together");
    Err(FormatError::invalid(path, problem))
}

/// Opens the files of `textures` and holds them against it. `first` is the one at `path`, where
/// that is a texture.
fn assemble(
    container: Container,
    path: &Path,
    model: Model,
    document: Textures,
    first: Option<Texture>,
    manifest: Option<PathBuf>,
) -> Result<Asset, FormatError> {
    let invalid = |problem: String| Err(FormatError::invalid(path, problem));
    let mut first = first;
    let mut textures: Vec<Vec<Texture>> = Vec::new();
    let mut arrays = Vec::new();
    for (index, Array { format, files, layers }) in document.arrays.iter().enumerate() {
        let mut of_array = Vec::new();
        for name in files {
            of_array.push(match first.take() {
                Some(first) => first,
                None => open_named(container, path, name, document.id)?,
            });
        }
        // A single file does not name itself.
        of_array.extend(first.take_if(|_| files.is_empty()));
        let shapes = of_array.iter().map(|texture| texture.shape);
        let count: usize = shapes.clone().map(|shape| shape.layers).fold(0, usize::saturating_add);
        let (Some(shape), true) = (shapes.clone().next(), count == layers.len()) else {
            return invalid(format!(
                "has {count} layers in array {index} where its metadata list {}",
                layers.len()
            ));
        };
        let one = &textures.first().unwrap_or(&of_array)[0].shape;
        let sizes = (one.width, one.height, document.levels.unwrap_or(one.levels));
        let odd = of_array.iter().find(|texture| {
            let other = &texture.shape;
            (other.width, other.height, other.levels) != sizes || other.format != shape.format
        });
        if let Some(Texture { path: other, shape, format_name, .. }) = odd {
            let (width, height, levels) = sizes;
            let problem = format!(
                "holds {} x {} texels of {format_name} in {} levels where the asset's other files or its \
                 metadata have {width} x {height} in {levels}",
                shape.width, shape.height, shape.levels
            );
            return Err(FormatError::invalid(other, problem));
        }
        let version_1 = format.is_empty();
        if !version_1 && shape.format.name() != format {
            let found = shape.format.name();
            return invalid(format!("has texels of {found} where its metadata say {format}"));
        }
        let channels = shape.format.channels();
        if let Some(layer) = layers.iter().position(|layer| layer.planes.len() > channels) {
            let planes = layers[layer].planes.len();
            return invalid(format!("layer {layer} lists {planes} planes in {channels} channels"));
        }
        arrays.push(ArrayPlan { format: shape.format, layers: document::layer_plans(layers) });
        textures.push(of_array);
    }
    let shape = textures[0][0].shape;
    let packing = Packing { arrays, levels: shape.levels, wrap: document.wrap };
    let header = AssetHeader { width: shape.width, height: shape.height, model, packing };
    let id = document.id;
    let positions = document.positions.map(|(plan, file)| UnopenedPositions { plan, file, id });
    Ok(Asset { header, textures, manifest, positions })
}

/// Opens file `name` of the asset at `path`.
fn open_named(
    container: Container,
    path: &Path,
    name: &str,
    id: Option<u64>,
) -> Result<Texture, FormatError> {
    let file = existing(path, name)?;
    let texture = container.open(&file)?;
    check_id(&file, texture.label.as_ref(), id)?;
    Ok(texture)
}

/// Refuses a file of another asset than `id`. A file that says nothing of an asset has been through
/// another program and is taken at its name.
fn check_id(file: &Path, label: Option<&Document>, id: Option<u64>) -> Result<(), FormatError> {
    let found = match label {
        Some(Document::Part(part)) => part.id,
        Some(Document::Asset(_, textures)) => textures.as_ref().and_then(|textures| textures.id),
        None => return Ok(()),
    };
    if found == id {
        return Ok(());
    }
    Err(FormatError::invalid(file, "belongs to another asset than its neighbours; bake them together again"))
}

/// Reads level 0 as maps; see [`super::read_asset`].
pub(super) fn read(
    container: Container,
    path: &Path,
    memory_limit: u64,
) -> Result<RelightingMaps, FormatError> {
    let Asset { header, textures, .. } = open(container, path)?;
    let AssetHeader { width, height, model, packing } = header;
    let spare = Unpacker::spare_memory(path, (width, height), &packing, memory_limit)?;
    let mut unpacker = Unpacker::new(width, height, model.plane_count());
    for (plan, textures) in packing.arrays.iter().zip(&textures) {
        let mut layers = plan.layers.iter();
        for texture in textures {
            texture.for_each_layer(0, spare, |_, bytes| match layers.next() {
                Some(layer) => unpacker.add(&texture.path, plan.format, layer, bytes),
                None => Ok(()),
            })?;
        }
    }
    Ok(RelightingMaps { width, height, model, planes: unpacker.into_maps() })
}

/// Reads all levels as they are; see [`super::read_packed`].
pub(super) fn read_packed(
    container: Container,
    path: &Path,
    memory_limit: u64,
) -> Result<PackedMaps, FormatError> {
    let Asset { header, textures, .. } = open(container, path)?;
    let AssetHeader { width, height, model, packing } = header;
    let all = textures.iter().flatten();
    let needed = all.map(|texture| texture.shape.bytes()).fold(0, u64::saturating_add);
    check_memory(needed, memory_limit, path)?;
    let spare = memory_limit - needed;
    let mut texels = Vec::with_capacity(textures.len());
    for textures in &textures {
        let mut levels = Vec::with_capacity(packing.levels);
        for level in 0..packing.levels {
            let bytes: u64 = textures.iter().map(|texture| texture.shape.level_bytes(level)).sum();
            let mut all = vec![0; bytes as usize];
            let mut rest = &mut all[..];
            for texture in textures {
                texture.for_each_layer(level, spare, |_, from| {
                    let layer = rest.split_off_mut(..texture.shape.layer_bytes(level) as usize);
                    layer.map_or(Ok(()), |layer| read_exact(&texture.path, from, layer))
                })?;
            }
            levels.push(all);
        }
        texels.push(levels);
    }
    Ok(PackedMaps { width, height, model, packing, texels })
}

/// Reads the positions; see [`super::read_positions`].
pub(super) fn read_positions(
    container: Container,
    path: &Path,
    memory_limit: u64,
) -> Result<Option<PositionMap>, FormatError> {
    let Asset { header, positions, .. } = open(container, path)?;
    let Some(UnopenedPositions { plan, file, id }) = positions else { return Ok(None) };
    let texture = open_named(container, path, &file, id)?;
    let Shape { width, height, format, levels, layers, .. } = texture.shape;
    if (width, height, format, levels, layers) != (header.width, header.height, plan.format(), 1, 1) {
        let problem = format!(
            "holds {layers} x {width} x {height} texels of {} in {levels} levels where positions of its asset \
             are 1 x {} x {} of {} in 1",
            texture.format_name,
            header.width,
            header.height,
            plan.precision.name()
        );
        return Err(FormatError::invalid(&texture.path, problem));
    }
    positions::read(&texture, &plan, memory_limit).map(Some)
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(container: Container, path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    let Asset { header, textures, manifest, positions } = open(container, path)?;
    let mut details = Details::default();
    let mut formats: Vec<&str> = Vec::new();
    for texture in textures.iter().flatten() {
        details.file_bytes += texture.file_bytes;
        details.files.push(texture.path.clone());
        if formats.last() != Some(&texture.format_name.as_str()) {
            formats.push(&texture.format_name);
        }
    }
    if let Some(UnopenedPositions { plan, file, .. }) = positions {
        let file = existing(path, &file)?;
        let (_, bytes) = open_measured(&file)?;
        details.file_bytes += bytes;
        details.files.push(file);
        details.positions = Some(plan);
    }
    if let Some(manifest) = manifest {
        let (_, bytes) = open_measured(&manifest)?;
        details.file_bytes += bytes;
        details.files.push(manifest);
    }
    let layers: Vec<_> = header.packing.arrays.iter().map(|array| array.layers.len().to_string()).collect();
    let compressed = matches!(textures[0][0].storage, Storage::Zstandard(_));
    let mut row = |name: &str, value: String| details.rows.push((name.to_owned(), value));
    row("texel format", formats.join(", "));
    row("layers", layers.join(" + "));
    row("levels", header.packing.levels.to_string());
    row("wrap", format!("{:?}", header.packing.wrap).to_lowercase());
    row("supercompression", if compressed { "zstandard" } else { "none" }.to_owned());
    Ok((header, details))
}
