//! Assets: relightable maps in files, and the table of the formats that hold them.
//!
//! To add one: a file beside `asset/ptm.rs` and a row in [`ASSET_FORMATS`]. Reading, `info`, help
//! and the tests that go through the table take it from there.

mod dds;
mod document;
mod exact_jpeg;
mod exr;
mod exr_reader;
mod function_table;
mod header_words;
mod jpeg_planes;
mod ktx2;
mod ktx2_reader;
mod planar;
mod plane_prediction;
mod planes;
mod positions;
mod ptm;
mod ptm_header;
mod ptm_jpeg;
mod ptm_jpeg_reader;
mod ptm_reader;
mod recognize;
mod rti;
mod rti_reader;
mod summary;
mod texture;
mod textures;
mod textures_reader;
mod unpack;
mod web;
mod web_functions;
mod web_info;
mod web_jpeg;
mod web_reader;
mod web_tiles;
mod zstandard;

pub use function_table::write_function_table;
pub(crate) use planar::coefficients;
pub use planes::plane_names;
pub use positions::AssetPositions;
pub(crate) use recognize::is_asset;
pub use summary::{AssetSummary, describe_asset, summarize_asset};

use crate::{FormatError, OutputFile};
use planes::{check_finite, plane_bytes, plane_quantizers};
use recognize::{format_of, known_extensions};
use relight_core::{CoefficientSpan, Layout, Model, PositionMap, RelightingMaps};
use relight_texture::{
    Coding, PackReport, PackedMaps, Packing, Precision, TexelDomain, TexelFormat, full_levels,
};
use std::fs::File;
use std::path::{Path, PathBuf};
use summary::Details;
use textures::Container;

/// What is known of an asset before its first texel.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetHeader {
    /// Pixels in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// How planes and light become pixels.
    pub model: Model,
    /// Where every plane lies, and by which scale and bias.
    pub packing: Packing,
}

/// What is known of an asset before its pictures are read: enough to refuse it.
#[derive(Clone, Copy, Debug)]
pub struct AssetPlan<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// How planes and light become pixels.
    pub model: &'a Model,
    /// The texel formats that its planes will or may have.
    pub formats: &'a [TexelFormat],
    /// Mip levels, 1 for none but the picture itself.
    pub levels: usize,
}

/// How files are written.
#[derive(Clone, Copy, Debug)]
pub struct WriteSettings {
    /// How texels are made.
    pub coding: Coding,
    /// Zstandard's level for supercompression, 1 to 19; `None` for none.
    pub zstd: Option<i32>,
    /// Whether every layer is a file of its own rather than every array.
    pub split: bool,
    /// Quality of planes in JPEG, 1 to 100; `None` for bytes as they are.
    pub jpeg_quality: Option<u8>,
    /// Whether planes in JPEG are cut into the tiles of Deep Zoom, in folders only.
    pub deepzoom: bool,
    /// Bytes; concerns the formats that can't be streamed (exr, planes in JPEG).
    pub memory_limit: u64,
}

/// Takes coefficients and makes files of them; many threads may write at once.
pub trait AssetWriter: Sync + Send {
    /// Writes the coefficients of a run of pixels. Runs come in any order, each pixel once; where
    /// [`Packing::needs_rows`] says so they are whole rows of blocks, as
    /// [`Packer::write`](relight_texture::Packer::write) has it.
    ///
    /// # Errors
    /// [`FormatError::Io`], and [`FormatError::Invalid`] for a coefficient beyond what the format
    /// can hold.
    ///
    /// # Panics
    /// When the span's slices do not have the shapes of [`CoefficientSpan`] or it leaves the map.
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError>;

    /// Puts the files in their places and says what storing cost. A writer that is dropped instead
    /// leaves nothing behind.
    ///
    /// # Errors
    /// [`FormatError::Io`], and [`FormatError::Invalid`] when pixels are missing.
    fn finish(self: Box<Self>) -> Result<PackReport, FormatError>;
}

/// A row of the table of asset formats.
#[derive(Clone, Copy, Debug)]
pub struct AssetFormat {
    /// The name on the command line.
    pub name: &'static str,
    /// The file name extension, without the dot.
    pub extension: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// The layouts that it holds.
    pub layouts: &'static [Layout],
    /// The precisions of plain texels that it holds, the default first.
    pub precisions: &'static [Precision],
    /// Whether it holds textures: blocks, mip levels, several arrays, a file a layer. Otherwise it
    /// holds planes one by one.
    pub textures: bool,
    /// How it holds positions, the default first; nothing where it holds none.
    pub positions: &'static [Precision],
    /// Whether its textures can be compressed once more, by Zstandard.
    pub zstd: bool,
    /// Whether its planes can be JPEG files within it.
    pub jpeg: bool,
    /// Whether it is a folder of files, planes in JPEG among them.
    pub folder: bool,
    /// Whether it stores a scale and bias for each plane.
    pub scaled: bool,
    /// Whether its files are written as the spans come, rather than held until the last one; planes in JPEG
    /// never are.
    pub streamed: bool,
    /// The bytes with which its files begin.
    pub magic: &'static [u8],
    /// Why it can't hold a model whose layout and texels it does hold.
    refusal: fn(&Model) -> Option<String>,
    create: fn(&Path, AssetHeader, &WriteSettings, Option<AssetPositions>) -> Created,
    outputs: fn(&Path, &Packing, Parts) -> Result<Vec<PathBuf>, FormatError>,
    read: fn(&Path, u64) -> Result<RelightingMaps, FormatError>,
    read_packed: fn(&Path, u64) -> Result<PackedMaps, FormatError>,
    read_positions: fn(&Path, u64) -> Result<Option<PositionMap>, FormatError>,
    summarize: fn(&Path) -> Result<(AssetHeader, Details), FormatError>,
}

/// Which files an asset has beside its first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    /// Whether every layer is a file of its own rather than every array.
    pub split: bool,
    /// Whether there are positions.
    pub positions: bool,
}

/// What starting an asset gives.
type Created = Result<Box<dyn AssetWriter>, FormatError>;

/// All asset formats, in the order in which they are listed to users.
pub static ASSET_FORMATS: [AssetFormat; 6] = [
    AssetFormat {
        name: "ktx2",
        extension: "ktx2",
        about: "KTX 2.0 array texture that GPUs load as it is",
        layouts: &[Layout::Rgb, Layout::Lrgb, Layout::Grey, Layout::Shared],
        precisions: &[Precision::U8, Precision::F16, Precision::F32],
        textures: true,
        positions: &[Precision::F16, Precision::F32],
        zstd: true,
        jpeg: false,
        folder: false,
        scaled: true,
        streamed: true,
        magic: Container::Ktx2.magic(),
        refusal: |_| None,
        create: |path, header, settings, positions| {
            textures::create(Container::Ktx2, path, header, settings, positions)
        },
        outputs: |path, packing, parts| textures::outputs(Container::Ktx2, path, packing, parts),
        read: |path, limit| textures_reader::read(Container::Ktx2, path, limit),
        read_packed: |path, limit| textures_reader::read_packed(Container::Ktx2, path, limit),
        read_positions: |path, limit| textures_reader::read_positions(Container::Ktx2, path, limit),
        summarize: |path| textures_reader::summarize(Container::Ktx2, path),
    },
    AssetFormat {
        name: "dds",
        extension: "dds",
        about: "DDS array texture (DX10) with a JSON manifest beside it",
        layouts: &[Layout::Rgb, Layout::Lrgb, Layout::Grey, Layout::Shared],
        precisions: &[Precision::U8, Precision::F16, Precision::F32],
        textures: true,
        positions: &[Precision::F16, Precision::F32],
        zstd: false,
        jpeg: false,
        folder: false,
        scaled: true,
        streamed: true,
        magic: Container::Dds.magic(),
        refusal: |_| None,
        create: |path, header, settings, positions| {
            textures::create(Container::Dds, path, header, settings, positions)
        },
        outputs: |path, packing, parts| textures::outputs(Container::Dds, path, packing, parts),
        read: |path, limit| textures_reader::read(Container::Dds, path, limit),
        read_packed: |path, limit| textures_reader::read_packed(Container::Dds, path, limit),
        read_positions: |path, limit| textures_reader::read_positions(Container::Dds, path, limit),
        summarize: |path| textures_reader::summarize(Container::Dds, path),
    },
    AssetFormat {
        name: "exr",
        extension: "exr",
        about: "OpenEXR with a layer for each function, for compositing and inspection",
        layouts: &[Layout::Rgb, Layout::Lrgb, Layout::Grey, Layout::Shared],
        precisions: &[Precision::F16, Precision::F32],
        textures: false,
        positions: &[Precision::F32],
        zstd: false,
        jpeg: false,
        folder: false,
        scaled: false,
        streamed: false,
        magic: &[0x76, 0x2f, 0x31, 0x01],
        refusal: |_| None,
        create: exr::create,
        outputs: |path, _, _| Ok(vec![path.to_owned()]),
        read: exr_reader::read,
        read_packed: |path, limit| planar::read_packed(path, limit, exr_reader::summarize, exr_reader::read),
        read_positions: exr_reader::read_positions,
        summarize: exr_reader::summarize,
    },
    AssetFormat {
        name: "ptm",
        extension: "ptm",
        about: "polynomial texture map of HP's tools (PTM_1.2), for RTI viewers",
        layouts: &[Layout::Rgb, Layout::Lrgb],
        precisions: &[Precision::U8],
        textures: false,
        positions: &[],
        zstd: false,
        jpeg: true,
        folder: false,
        scaled: true,
        streamed: true,
        magic: b"PTM_1.",
        refusal: ptm::refusal,
        create: |path, header, settings, _| ptm::create(path, header, settings),
        outputs: |path, _, _| Ok(vec![path.to_owned()]),
        read: ptm_reader::read,
        read_packed: |path, limit| planar::read_packed(path, limit, ptm_reader::summarize, ptm_reader::read),
        read_positions: |_, _| Ok(None),
        summarize: ptm_reader::summarize,
    },
    AssetFormat {
        name: "rti",
        extension: "rti",
        about: "hemispherical harmonics of RTI tools (HSH1.2), for RTI viewers",
        layouts: &[Layout::Rgb, Layout::Lrgb],
        precisions: &[Precision::U8],
        textures: false,
        positions: &[],
        zstd: false,
        jpeg: false,
        folder: false,
        scaled: true,
        streamed: true,
        magic: b"#HSH",
        refusal: rti::refusal,
        create: |path, header, _, _| rti::create(path, header),
        outputs: |path, _, _| Ok(vec![path.to_owned()]),
        read: rti_reader::read,
        read_packed: |path, limit| planar::read_packed(path, limit, rti_reader::summarize, rti_reader::read),
        read_positions: |_, _| Ok(None),
        summarize: rti_reader::summarize,
    },
    AssetFormat {
        name: "web",
        extension: "web",
        about: "folder of info.json and JPEG planes of CNR relight, for OpenLIME in browsers",
        layouts: &[Layout::Rgb, Layout::Lrgb, Layout::Shared],
        precisions: &[Precision::U8],
        textures: false,
        positions: &[],
        zstd: false,
        jpeg: true,
        folder: true,
        scaled: true,
        streamed: false,
        magic: b"{",
        refusal: web::refusal,
        create: |path, header, settings, _| web::create(path, header, settings),
        outputs: |path, _, _| Ok(vec![path.to_owned()]),
        read: web_reader::read,
        read_packed: |path, limit| planar::read_packed(path, limit, web_reader::summarize, web_reader::read),
        read_positions: |_, _| Ok(None),
        summarize: web_reader::summarize,
    },
];

impl AssetFormat {
    /// The format of that name.
    pub fn by_name(name: &str) -> Option<&'static Self> {
        ASSET_FORMATS.iter().find(|format| format.name == name)
    }

    /// The format that `path`'s extension names, in any case.
    ///
    /// # Errors
    /// [`FormatError::Unsupported`] naming the extensions that exist.
    pub fn by_path(path: &Path) -> Result<&'static Self, FormatError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        ASSET_FORMATS.iter().find(|format| format.extension.eq_ignore_ascii_case(extension)).ok_or_else(
            || {
                let known = known_extensions();
                FormatError::unsupported(path, format!("no asset format has this extension; use {known}"))
            },
        )
    }

    /// The plain texels in which it stores planes of `layout`: textures have four channels for
    /// colours and for luminance, everything else has one.
    pub fn plain_format(&self, layout: Layout, precision: Precision) -> TexelFormat {
        let channels = if self.textures && layout != Layout::Grey { 4 } else { 1 };
        TexelFormat::Plain { precision, channels }
    }

    /// Whether the planes' quantizers in texels of `format` follow from their ranges.
    pub fn needs_ranges(&self, format: TexelFormat) -> bool {
        self.scaled && format.domain() != TexelDomain::Float
    }

    /// Bytes that a writer of this format holds until the asset is whole; 0 where it streams.
    pub fn held_bytes(&self, plan: &AssetPlan<'_>, settings: &WriteSettings) -> u64 {
        let AssetPlan { width, height, model, formats, levels } = *plan;
        if self.folder {
            return web::held_bytes(width, height, model);
        }
        if settings.jpeg_quality.is_some() {
            return ptm_jpeg::held_bytes(width, height, model.plane_count());
        }
        if self.streamed {
            return relight_texture::held_bytes(width, height, model.plane_count(), levels);
        }
        formats.iter().map(|&format| plane_bytes(width, height, model, format)).max().unwrap_or(0)
    }

    /// Whether this format can hold such an asset; `path` is for the message alone.
    ///
    /// # Errors
    /// [`FormatError::Unsupported`] saying what it can't hold and what can;
    /// [`FormatError::Invalid`] for a map without pixels.
    pub fn check(
        &self,
        path: &Path,
        plan: &AssetPlan<'_>,
        settings: &WriteSettings,
    ) -> Result<(), FormatError> {
        let AssetPlan { width, height, model, formats, levels } = *plan;
        let (name, invalid) = (self.name, |problem| Err(FormatError::invalid(path, problem)));
        if width == 0 || height == 0 {
            return invalid(format!("a map of {width} x {height} has no pixels"));
        }
        let most = full_levels(width, height);
        if !(1..=most).contains(&levels) {
            return invalid(format!(
                "{levels} mip levels are outside 1..{most} of {width} x {height} pixels"
            ));
        }
        let odd = formats.iter().find(|&&format| !self.holds(format));
        let refusal = if !self.layouts.contains(&model.layout) {
            let layouts: Vec<_> = self.layouts.iter().map(|&layout| layout_name(layout)).collect();
            let (held, layout) = (layouts.join(" or "), layout_name(model.layout));
            Some(format!("{name} holds layout {held}, not {layout}; choose another, or write .ktx2"))
        } else if let Some(TexelFormat::Plain { precision, .. }) = odd {
            let precisions: Vec<_> = self.precisions.iter().map(|precision| precision.name()).collect();
            let (held, precision) = (precisions.join(" or "), precision.name());
            Some(format!("{name} holds precision {held}, not {precision}; choose another, or write .ktx2"))
        } else if let Some(TexelFormat::Block(block)) = odd {
            Some(format!("{name} holds no blocks such as {}; write .ktx2 or .dds", block.name()))
        } else if levels > 1 && !self.textures {
            Some(format!("{name} holds no mip levels; write .ktx2 or .dds"))
        } else if settings.split && !self.textures {
            Some(format!("{name} holds all maps in one file; write .ktx2 or .dds to split them"))
        } else if settings.deepzoom && !self.folder {
            Some(format!("{name} holds no tiles of Deep Zoom; write .web"))
        } else if settings.zstd.is_some() && !self.zstd {
            Some(format!("{name} knows no Zstandard; write .ktx2"))
        } else if let Some(level) = settings.zstd.filter(|level| !zstandard::LEVELS.contains(level)) {
            let (least, most) = (zstandard::LEVELS.start(), zstandard::LEVELS.end());
            Some(format!("Zstandard's level {level} is outside {least}..{most}"))
        } else if let Some(quality) = settings.jpeg_quality.or(self.folder.then_some(web::USUAL_QUALITY)) {
            self.refusal_of_jpeg(plan, quality).or_else(|| (self.refusal)(model))
        } else {
            (self.refusal)(model)
        };
        refusal.map_or(Ok(()), |problem| Err(FormatError::unsupported(path, problem)))
    }

    /// Why it can't hold planes in JPEG of such a quality.
    fn refusal_of_jpeg(&self, plan: &AssetPlan<'_>, quality: u8) -> Option<String> {
        let AssetPlan { width, height, .. } = *plan;
        let largest = usize::from(u16::MAX);
        if !self.jpeg {
            Some(format!("{} holds no planes in JPEG; write .ptm or .web", self.name))
        } else if !(1..=100).contains(&quality) {
            Some(format!("JPEG quality {quality} is outside 1..100"))
        } else {
            let problem = format!(
                "{width} x {height} is outside 1..{largest} of JPEG; write .ptm without it, or .ktx2"
            );
            (width.max(height) > largest).then_some(problem)
        }
    }

    /// Whether texels of `format` are among those that it holds.
    fn holds(&self, format: TexelFormat) -> bool {
        match format {
            TexelFormat::Plain { precision, .. } => self.precisions.contains(&precision),
            TexelFormat::Block(_) => self.textures,
        }
    }

    /// Fails where nothing of this format can be written to `path`; leaves no trace.
    ///
    /// # Errors
    /// As of [`OutputFile::create`]; of a folder also where another than such an asset stands at `path`.
    pub fn check_writable(&self, path: &Path) -> Result<(), FormatError> {
        if self.folder { web::create_folder(path).map(drop) } else { OutputFile::create(path).map(drop) }
    }

    /// All files that an asset at `path` will have: `path` first, then further textures
    /// `stem_1.ktx2`, `stem_2.ktx2` .., `stem_positions.ktx2` and the manifest `stem.json` where there
    /// are such. What stands at `path` is always replaced; at the other names, only files of an asset are.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] naming a file that would be replaced and is none of an asset.
    pub fn outputs(&self, path: &Path, packing: &Packing, parts: Parts) -> Result<Vec<PathBuf>, FormatError> {
        (self.outputs)(path, packing, parts)
    }

    /// Starts an asset at `path`, without positions.
    ///
    /// # Errors
    /// As of [`Self::create_with_positions`].
    ///
    /// # Panics
    /// As there.
    pub fn create(
        &self,
        path: &Path,
        header: AssetHeader,
        settings: &WriteSettings,
    ) -> Result<Box<dyn AssetWriter>, FormatError> {
        self.create_with_positions(path, header, settings, None)
    }

    /// Starts an asset at `path`, with the positions of its pixels where some are given.
    ///
    /// # Errors
    /// Those of [`Self::check`], [`Self::check_positions`] and [`Self::outputs`]; [`FormatError::Io`];
    /// [`FormatError::TooLarge`] where the map must be held in memory and can't;
    /// [`FormatError::Invalid`] for a plane whose scale or bias is not finite and for positions of
    /// another size.
    ///
    /// # Panics
    /// When the packing does not hold every plane of the model once, or an array without planes.
    pub fn create_with_positions(
        &self,
        path: &Path,
        header: AssetHeader,
        settings: &WriteSettings,
        positions: Option<AssetPositions>,
    ) -> Result<Box<dyn AssetWriter>, FormatError> {
        let formats: Vec<_> = header.packing.formats().collect();
        let AssetHeader { width, height, ref model, ref packing } = header;
        self.check(
            path,
            &AssetPlan { width, height, model, formats: &formats, levels: packing.levels },
            settings,
        )?;
        if let Some(positions) = &positions {
            self.check_map(path, (width, height), positions)?;
        }
        (self.create)(path, header, settings, positions)
    }
}

/// Reads an asset of any format, told by its first bytes; of textures the first file or the
/// manifest, of a web folder itself or its `info.json`. Blocks are decoded, mip levels after the first left aside.
///
/// The planes take at most `memory_limit` bytes, with working space of some MiB beside them.
///
/// # Errors
/// [`FormatError::Unsupported`] for files that are no asset of ours, [`FormatError::Invalid`] for
/// damaged ones and missing companions, [`FormatError::TooLarge`] and [`FormatError::Io`].
pub fn read_asset(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    (format_of(path)?.read)(path, memory_limit)
}

/// Reads an asset as a GPU takes it: all levels, blocks as they are. Formats that hold planes one by
/// one give an array of single-channel texels, a layer a plane.
///
/// The texels take at most `memory_limit` bytes, with working space of some MiB beside them.
///
/// # Errors
/// As of [`read_asset`].
pub fn read_packed(path: &Path, memory_limit: u64) -> Result<PackedMaps, FormatError> {
    (format_of(path)?.read_packed)(path, memory_limit)
}

/// Reads the positions of an asset, `None` where it has none. Nothing else reads them: an asset's
/// planes are read without.
///
/// The points take at most `memory_limit` bytes, with working space of some MiB beside them.
///
/// # Errors
/// As of [`read_asset`].
pub fn read_positions(path: &Path, memory_limit: u64) -> Result<Option<PositionMap>, FormatError> {
    (format_of(path)?.read_positions)(path, memory_limit)
}

fn layout_name(layout: Layout) -> &'static str {
    match layout {
        Layout::Grey => "grey",
        Layout::Rgb => "rgb",
        Layout::Lrgb => "lrgb",
        Layout::Shared => "shared",
    }
}

fn open(path: &Path) -> Result<File, FormatError> {
    File::open(path).map_err(|e| FormatError::io(path, "read", e))
}

/// The file and its length in bytes.
fn open_measured(path: &Path) -> Result<(File, u64), FormatError> {
    let file = open(path)?;
    let length = file.metadata().map_err(|e| FormatError::io(path, "read", e))?.len();
    Ok((file, length))
}

/// Panics unless `span` has its shapes and lies inside the map.
fn assert_shape(header: &AssetHeader, span: &CoefficientSpan<'_>) {
    let channels = header.model.layout.planes_per_map();
    let base = if header.model.layout == Layout::Lrgb { 3 * span.pixels } else { 0 };
    assert!(span.first + span.pixels <= header.width * header.height, "the span leaves the map");
    assert_eq!(span.maps.len(), header.model.maps() * span.pixels * channels, "maps");
    assert_eq!(span.base_color.len(), base, "base colour");
}

/// Refuses to finish a map of which only `written` pixels came.
fn check_complete(path: &Path, header: &AssetHeader, written: usize) -> Result<(), FormatError> {
    let pixels = header.width * header.height;
    if written == pixels {
        return Ok(());
    }
    Err(FormatError::invalid(path, format!("{written} of {pixels} pixels were written")))
}
