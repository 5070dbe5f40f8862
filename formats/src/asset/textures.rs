//! The files of an asset of textures: which array lies in which, what they are called, and the
//! writer that puts every texel in its place.

use super::document::{self, Document, Text};
use super::positions::PIECE;
use super::texture::{LevelPlace, Shape, Texture};
use super::{
    AssetHeader, AssetPositions, AssetWriter, Created, Parts, WriteSettings, check_complete, check_finite,
};
use super::{dds, ktx2, ktx2_reader, textures_reader, zstandard};
use crate::output_file::finish_all;
use crate::positioned::write_all_at;
use crate::{FormatError, OutputFile};
use relight_core::CoefficientSpan;
use relight_texture::{PackReport, Packer, Packing, PositionPlan, TexelPlace};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A format of texture files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Container {
    /// Holds keys, the document among them.
    Ktx2,
    /// Holds texels alone: the document always stands in a manifest.
    Dds,
}

/// The extension of manifests.
pub(super) const MANIFEST: &str = "json";

impl Container {
    /// Reads what a file of this format is.
    pub(super) fn open(self, path: &Path) -> Result<Texture, FormatError> {
        match self {
            Self::Ktx2 => ktx2_reader::open(path),
            Self::Dds => dds::open(path),
        }
    }

    /// The bytes with which files begin.
    pub(super) const fn magic(self) -> &'static [u8] {
        match self {
            Self::Ktx2 => &::ktx2::MAGIC,
            Self::Dds => dds::MAGIC,
        }
    }

    /// Whether a manifest stands beside the textures.
    fn has_manifest(self, split: bool) -> bool {
        split || self == Self::Dds
    }
}

/// How many texture files hold the planes of such a packing.
fn file_count(packing: &Packing, split: bool) -> usize {
    if split { packing.layers() } else { packing.arrays.len() }
}

/// `stem.ktx2`, `stem_1.ktx2`, `stem_2.ktx2` .. and `stem_positions.ktx2` beside `path`, which is the
/// first of `count`.
fn texture_paths(path: &Path, count: usize, positions: bool) -> Vec<PathBuf> {
    let numbers = (1..count).map(|number| number.to_string());
    let further = numbers.chain(positions.then(|| "positions".to_owned())).map(|suffix| {
        let mut name = path.file_stem().unwrap_or_default().to_owned();
        name.push(format!("_{suffix}"));
        let mut sibling = path.with_file_name(name);
        if let Some(extension) = path.extension() {
            sibling.as_mut_os_string().push(".");
            sibling.as_mut_os_string().push(extension);
        }
        sibling
    });
    std::iter::once(path.to_owned()).chain(further).collect()
}

/// The files of such an asset, the first at `path`; see [`super::AssetFormat::outputs`].
pub(super) fn outputs(
    container: Container,
    path: &Path,
    packing: &Packing,
    parts: Parts,
) -> Result<Vec<PathBuf>, FormatError> {
    let mut files = texture_paths(path, file_count(packing, parts.split), parts.positions);
    if container.has_manifest(parts.split) {
        files.push(path.with_extension(MANIFEST));
    }
    let foreign = files.iter().skip(1).find(|file| file.exists() && !is_ours(container, file));
    match foreign {
        None => Ok(files),
        Some(file) => {
            let problem = format!(
                "would be replaced by a file of asset {}, of which it is no part; move it or write to another name",
                path.display()
            );
            Err(FormatError::invalid(file, problem))
        }
    }
}

/// Whether what stands at `file` is a manifest or a further file of an asset.
fn is_ours(container: Container, file: &Path) -> bool {
    if file.extension().is_some_and(|extension| extension == MANIFEST) {
        return textures_reader::read_manifest(file).is_ok();
    }
    matches!(container.open(file).map(|texture| texture.label), Ok(Some(Document::Part(_))))
}

/// A texture on its way to a file.
struct Output {
    file: OutputFile,
    shape: Shape,
    /// What its key says, where it has keys.
    text: String,
    /// Where its levels lie in [`TextureWriter::spool`] or else in `file`.
    places: Vec<LevelPlace>,
}

struct TextureWriter {
    header: AssetHeader,
    packer: Packer,
    files: OutputFiles,
}

/// All files of an asset on their way.
struct OutputFiles {
    outputs: Vec<Output>,
    /// Index of the file of each array's first layer.
    first_files: Vec<usize>,
    split: bool,
    manifest: Option<OutputFile>,
    /// With Zstandard: levels as they are until all are there, and the level of compression.
    spool: Option<(File, i32)>,
}

/// Starts an asset of textures; see [`super::AssetFormat::create`].
pub(super) fn create(
    container: Container,
    path: &Path,
    header: AssetHeader,
    settings: &WriteSettings,
    positions: Option<AssetPositions>,
) -> Created {
    let AssetHeader { width, height, model, packing } = &header;
    let WriteSettings { coding, zstd, split, .. } = *settings;
    check_finite(path, &header)?;
    let all = outputs(container, path, packing, Parts { split, positions: positions.is_some() })?;
    let planes = file_count(packing, split);
    let paths = &all[..planes + usize::from(positions.is_some())];
    let named = all.len() > 1;
    let names = if named { file_names(paths)? } else { Vec::new() };
    let (mut first_files, mut shapes, mut arrays) = (Vec::new(), Vec::new(), Vec::new());
    for plan in &packing.arrays {
        let files = if split { plan.layers.len() } else { 1 };
        let layers = if split { 1 } else { plan.layers.len() };
        let first = shapes.len();
        first_files.push(first);
        shapes.extend((0..files).map(|_| Shape {
            width: *width,
            height: *height,
            format: plan.format,
            levels: packing.levels,
            layers,
            array: !split,
        }));
        let names = if named { names[first..first + files].to_vec() } else { Vec::new() };
        arrays.push(document::array_of(plan, names));
    }
    let position_plan =
        positions.as_ref().map(|positions| PositionPlan::new(&positions.map, positions.precision));
    let positions_record = position_plan.as_ref().map(|plan| {
        let (width, height, format) = (*width, *height, plan.format());
        shapes.push(Shape { width, height, format, levels: 1, layers: 1, array: false });
        document::positions_of(plan, names[planes].clone())
    });
    let textures = Some((packing.wrap, packing.levels, arrays));
    let text = document::text_of(path, model, textures, positions_record)?;
    let manifest = match container.has_manifest(split) {
        true => Some(manifest(&path.with_extension(MANIFEST), &text)?),
        false => None,
    };
    let mut spooled = 0;
    let mut outputs = Vec::with_capacity(shapes.len());
    for (index, (path, shape)) in paths.iter().zip(shapes).enumerate() {
        let text_of_file = match (container, index) {
            (Container::Dds, _) => String::new(),
            (Container::Ktx2, 0) => text.line.clone(),
            (Container::Ktx2, _) => document::part_text_of(path, &names[0], index, text.id)?,
        };
        let head = match container {
            Container::Ktx2 => ktx2::head(path, &shape, Some(&text_of_file), None)?,
            Container::Dds => dds::head(path, &shape, index, text.id)?,
        };
        let file = OutputFile::create(path)?;
        let start = if zstd.is_some() { spooled } else { head.len() as u64 };
        let places = match container {
            Container::Ktx2 => ktx2::places(&shape, start),
            Container::Dds => dds::places(&shape),
        };
        match zstd {
            None => file.write_at(0, &head)?,
            // Room for the gaps between levels too.
            Some(_) => spooled += shape.bytes() + 16 * (shape.levels as u64 + 1),
        }
        outputs.push(Output { file, shape, text: text_of_file, places });
    }
    let spool = match zstd {
        Some(level) => Some((outputs[0].file.spool()?, level)),
        None => None,
    };
    let packer = Packer::new(*width, *height, model, packing.clone(), coding);
    let files = OutputFiles { outputs, first_files, split, manifest, spool };
    if let (Some(positions), Some(plan)) = (positions, position_plan) {
        files.put_positions(&files.outputs[planes], &positions, &plan)?;
    }
    Ok(Box::new(TextureWriter { header, packer, files }))
}

/// The names of files as manifests hold them.
fn file_names(paths: &[PathBuf]) -> Result<Vec<String>, FormatError> {
    let name = |path: &PathBuf| {
        let name =
            path.file_name().and_then(|name| name.to_str()).filter(|name| document::is_file_name(name));
        name.map(str::to_owned).ok_or_else(|| {
            FormatError::invalid(path, "is no name that other systems have too; use letters, digits, - and _")
        })
    };
    paths.iter().map(name).collect()
}

fn manifest(path: &Path, text: &Text) -> Result<OutputFile, FormatError> {
    let mut file = OutputFile::create(path)?;
    file.write_all(text.pretty(path)?.as_bytes())?;
    Ok(file)
}

impl OutputFiles {
    /// Writes `bytes` to their place.
    fn put(&self, place: TexelPlace, bytes: &[u8]) -> Result<(), FormatError> {
        let TexelPlace { array, level, layer, offset } = place;
        let (file, layer) = if self.split { (layer, 0) } else { (0, layer) };
        let output = &self.outputs[self.first_files[array] + file];
        self.put_at(
            output,
            output.places[level].offset + layer as u64 * output.places[level].stride + offset,
            bytes,
        )
    }

    /// Writes the texels of positions to `output`.
    fn put_positions(
        &self,
        output: &Output,
        positions: &AssetPositions,
        plan: &PositionPlan,
    ) -> Result<(), FormatError> {
        let (mut at, mut texels) = (output.places[0].offset, Vec::new());
        for points in positions.map.points.chunks(PIECE) {
            texels.clear();
            plan.append_texels(points, &mut texels);
            self.put_at(output, at, &texels)?;
            at += texels.len() as u64;
        }
        Ok(())
    }

    /// Writes `bytes` at `at` of a texture as it is before it is compressed.
    fn put_at(&self, output: &Output, at: u64, bytes: &[u8]) -> Result<(), FormatError> {
        match &self.spool {
            None => output.file.write_at(at, bytes),
            Some((spool, _)) => {
                write_all_at(spool, at, bytes).map_err(|e| FormatError::io(output.file.path(), "write", e))
            }
        }
    }

    /// Puts them in their places: the one by which the asset is named comes last, since until then
    /// it is the old asset.
    fn finish(self) -> Result<(), FormatError> {
        if let Some((spool, level)) = &self.spool {
            for Output { file, shape, text, places } in &self.outputs {
                zstandard::compress(file, shape, text, (spool, places), *level)?;
            }
        }
        let mut files: Vec<OutputFile> = self.outputs.into_iter().map(|output| output.file).collect();
        files.rotate_left(1);
        let first = files.pop();
        finish_all(files.into_iter().chain(self.manifest).chain(first))
    }
}

impl AssetWriter for TextureWriter {
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError> {
        self.packer.write(span, &|place, bytes| self.files.put(place, bytes))
    }

    fn finish(self: Box<Self>) -> Result<PackReport, FormatError> {
        let Self { header, packer, files } = *self;
        check_complete(files.outputs[0].file.path(), &header, packer.written())?;
        let report = packer.finish(&|place, bytes| files.put(place, bytes))?;
        files.finish()?;
        Ok(report)
    }
}
