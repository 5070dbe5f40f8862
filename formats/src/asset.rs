//! Assets: relightable maps in files, and the table of the formats that hold them.
//!
//! To add one: a file beside `asset/ptm.rs` and a row in [`ASSET_FORMATS`]. Reading, `info`, help
//! and the tests that go through the table take it from there.

mod document;
mod exr;
mod exr_reader;
mod ktx2;
mod ktx2_reader;
mod ptm;
mod ptm_reader;
mod texels;

use crate::FormatError;
use relight_core::CoefficientRange;
use relight_core::{CoefficientSpan, Layout, Model, RelightingMaps};
use relight_texture::{Precision, Quantizer};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// What is known of an asset before its first texel.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetHeader {
    /// Pixels in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// How planes and light become pixels.
    pub model: Model,
    /// How a coefficient is stored.
    pub precision: Precision,
}

/// Takes coefficients and makes a file of them; many threads may write at once.
pub trait AssetWriter: Sync + Send {
    /// Writes the coefficients of a run of pixels. Runs come in any order, each pixel once.
    ///
    /// # Errors
    /// [`FormatError::Io`], and [`FormatError::Invalid`] for a coefficient beyond what the format
    /// can hold.
    ///
    /// # Panics
    /// When the span's slices do not have the shapes of [`CoefficientSpan`] or it leaves the map.
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError>;

    /// Puts the file in its place. A writer that is dropped instead leaves nothing behind.
    ///
    /// # Errors
    /// [`FormatError::Io`], and [`FormatError::Invalid`] when pixels are missing.
    fn finish(self: Box<Self>) -> Result<(), FormatError>;
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
    /// The precisions that it holds.
    pub precisions: &'static [Precision],
    /// The precisions for which [`Self::create`] must know the planes' ranges.
    pub ranged: &'static [Precision],
    /// Whether its files are written as the spans come, rather than held until the last one.
    pub streamed: bool,
    /// The bytes with which its files begin.
    pub magic: &'static [u8],
    /// Why it can't hold a model whose layout and precision it does hold.
    refusal: fn(&Model) -> Option<String>,
    create: fn(&Path, AssetHeader, &[CoefficientRange], u64) -> Created,
    read: fn(&Path, u64) -> Result<RelightingMaps, FormatError>,
    summarize: fn(&Path) -> Result<(AssetHeader, Details), FormatError>,
}

/// What starting an asset gives.
type Created = Result<Box<dyn AssetWriter>, FormatError>;

/// Facts of a format's own, as name and value.
type Details = Vec<(String, String)>;

/// All asset formats, in the order in which they are listed to users.
pub static ASSET_FORMATS: [AssetFormat; 3] = [
    AssetFormat {
        name: "ktx2",
        extension: "ktx2",
        about: "KTX 2.0 array texture that GPUs load as it is",
        layouts: &[Layout::Rgb, Layout::Lrgb, Layout::Grey],
        precisions: &[Precision::U8, Precision::F16, Precision::F32],
        ranged: &[Precision::U8, Precision::F16],
        streamed: true,
        magic: &::ktx2::MAGIC,
        refusal: |_| None,
        create: ktx2::create,
        read: ktx2_reader::read,
        summarize: ktx2_reader::summarize,
    },
    AssetFormat {
        name: "exr",
        extension: "exr",
        about: "OpenEXR with a layer for each function, for compositing and inspection",
        layouts: &[Layout::Rgb, Layout::Lrgb, Layout::Grey],
        precisions: &[Precision::F16, Precision::F32],
        ranged: &[],
        streamed: false,
        magic: &[0x76, 0x2f, 0x31, 0x01],
        refusal: |_| None,
        create: exr::create,
        read: exr_reader::read,
        summarize: exr_reader::summarize,
    },
    AssetFormat {
        name: "ptm",
        extension: "ptm",
        about: "polynomial texture map of HP's tools (PTM_1.2), for RTI viewers",
        layouts: &[Layout::Rgb, Layout::Lrgb],
        precisions: &[Precision::U8],
        ranged: &[Precision::U8],
        streamed: true,
        magic: b"PTM_1.",
        refusal: ptm::refusal,
        create: ptm::create,
        read: ptm_reader::read,
        summarize: ptm_reader::summarize,
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

    /// Whether [`Self::create`] must know the planes' ranges.
    pub fn needs_ranges(&self, precision: Precision) -> bool {
        self.ranged.contains(&precision)
    }

    /// Bytes that a writer of this format holds until the asset is whole; 0 where it streams.
    pub fn held_bytes(&self, header: &AssetHeader) -> u64 {
        if self.streamed {
            return 0;
        }
        let (width, height) = (header.width as u64, header.height as u64);
        plane_bytes(width, height, header.model.plane_count(), header.precision).unwrap_or(u64::MAX)
    }

    /// Whether this format can hold such an asset; `path` is for the message alone.
    ///
    /// # Errors
    /// [`FormatError::Unsupported`] saying what it can't hold and what can;
    /// [`FormatError::Invalid`] for a map without pixels.
    pub fn check(&self, path: &Path, header: &AssetHeader) -> Result<(), FormatError> {
        let name = self.name;
        if header.width == 0 || header.height == 0 {
            let (width, height) = (header.width, header.height);
            return Err(FormatError::invalid(path, format!("a map of {width} x {height} has no pixels")));
        }
        let refusal = if !self.layouts.contains(&header.model.layout) {
            let layouts: Vec<_> = self.layouts.iter().map(|&layout| layout_name(layout)).collect();
            let (held, layout) = (layouts.join(" or "), layout_name(header.model.layout));
            Some(format!("{name} holds layout {held}, not {layout}; choose another, or write .ktx2"))
        } else if !self.precisions.contains(&header.precision) {
            let precisions: Vec<_> = self.precisions.iter().map(|precision| precision.name()).collect();
            let (held, precision) = (precisions.join(" or "), header.precision.name());
            Some(format!("{name} holds precision {held}, not {precision}; choose another, or write .ktx2"))
        } else {
            (self.refusal)(&header.model)
        };
        refusal.map_or(Ok(()), |problem| Err(FormatError::unsupported(path, problem)))
    }

    /// Starts an asset at `path`.
    ///
    /// `ranges` holds the least and largest coefficient of each plane in the order of
    /// [`Model::roles`] where [`Self::needs_ranges`] says so; otherwise it is not looked at.
    /// `memory_limit` is in bytes and concerns the formats that can't be streamed (exr).
    ///
    /// # Errors
    /// Those of [`Self::check`]; [`FormatError::Io`]; [`FormatError::TooLarge`] where the map must
    /// be held in memory and can't; [`FormatError::Invalid`] for a plane whose range is not finite.
    ///
    /// # Panics
    /// When ranges are needed and there is not one for each plane.
    pub fn create(
        &self,
        path: &Path,
        header: AssetHeader,
        ranges: &[CoefficientRange],
        memory_limit: u64,
    ) -> Result<Box<dyn AssetWriter>, FormatError> {
        self.check(path, &header)?;
        if self.needs_ranges(header.precision) {
            assert_eq!(ranges.len(), header.model.plane_count(), "one range for each plane");
        }
        (self.create)(path, header, ranges, memory_limit)
    }
}

/// Reads an asset of any format, told by its first bytes.
///
/// The planes take at most `memory_limit` bytes, with working space of some MiB beside them.
///
/// # Errors
/// [`FormatError::Unsupported`] for files that are no asset of ours, [`FormatError::Invalid`] for
/// damaged ones, [`FormatError::TooLarge`] and [`FormatError::Io`].
pub fn read_asset(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    (format_of(path)?.read)(path, memory_limit)
}

/// What an asset is, without its texels.
#[derive(Clone, Debug)]
pub struct AssetSummary {
    /// Its format.
    pub format: &'static AssetFormat,
    /// Size, model and precision.
    pub header: AssetHeader,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Facts of the format's own, as name and value.
    pub details: Vec<(String, String)>,
}

/// Reads what an asset is, without its texels.
///
/// # Errors
/// As of [`read_asset`], short of what only the texels show.
pub fn summarize_asset(path: &Path) -> Result<AssetSummary, FormatError> {
    let format = format_of(path)?;
    let (_, file_bytes) = open_measured(path)?;
    let (header, details) = (format.summarize)(path)?;
    Ok(AssetSummary { format, header, file_bytes, details })
}

/// [`summarize_asset`] in words: rows of a name and a value.
///
/// # Errors
/// As of [`summarize_asset`].
pub fn describe_asset(path: &Path) -> Result<Vec<(String, String)>, FormatError> {
    let AssetSummary { format, header, file_bytes, details } = summarize_asset(path)?;
    let AssetHeader { width, height, model, precision } = header;
    let mut rows: Vec<(String, String)> = Vec::new();
    let mut row = |name: &str, value: String| rows.push((name.to_owned(), value));
    row("format", format!("{} ({})", format.name, format.about));
    row("size", format!("{width} x {height}"));
    row("basis", format!("{}, {} functions", model.basis.family().name, model.basis.count()));
    row("layout", layout_name(model.layout).to_owned());
    row("space", format!("{:?}", model.space).to_lowercase());
    row("precision", precision.name().to_owned());
    row("planes", model.plane_count().to_string());
    let lights = model.lights.len();
    row("lights", if lights == 0 { "not recorded".to_owned() } else { lights.to_string() });
    if let Some(figures) = model.figures {
        row("fit rmse", figures.fit_rmse.to_string());
        row("leave-one-out rmse", figures.leave_one_out_rmse.to_string());
    }
    row("file bytes", file_bytes.to_string());
    rows.extend(details);
    Ok(rows)
}

/// The format whose magic bytes `path` begins with.
fn format_of(path: &Path) -> Result<&'static AssetFormat, FormatError> {
    let mut start = Vec::new();
    open(path)?.take(16).read_to_end(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    ASSET_FORMATS.iter().find(|format| start.starts_with(format.magic)).ok_or_else(|| {
        let known = known_extensions();
        FormatError::unsupported(path, format!("is no asset; relight reads those that it writes: {known}"))
    })
}

fn known_extensions() -> String {
    let known: Vec<_> = ASSET_FORMATS.iter().map(|format| format!(".{}", format.extension)).collect();
    known.join(", ")
}

fn layout_name(layout: Layout) -> &'static str {
    match layout {
        Layout::Grey => "grey",
        Layout::Rgb => "rgb",
        Layout::Lrgb => "lrgb",
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

/// Bytes that the planes of such an asset take in memory, and pixels of a plane, when the product
/// can be counted.
fn plane_bytes(width: u64, height: u64, planes: usize, precision: Precision) -> Option<u64> {
    width.checked_mul(height)?.checked_mul(planes as u64 * precision.bytes() as u64)
}

/// Refuses an asset whose planes take more than `limit` bytes.
fn check_memory(path: &Path, header: &AssetHeader, limit: u64) -> Result<(), FormatError> {
    let AssetHeader { width, height, model, precision } = header;
    let needed = plane_bytes(*width as u64, *height as u64, model.plane_count(), *precision);
    match needed {
        Some(needed) if needed <= limit && usize::try_from(needed).is_ok() => Ok(()),
        needed => Err(FormatError::too_large(path, needed.unwrap_or(u64::MAX), limit)),
    }
}

/// What each plane is called in messages and in EXR files, in the order of [`Model::roles`]:
/// `b03_uv.R`, `b03_uv.Y`, `base.R`.
fn plane_names(model: &Model) -> Vec<String> {
    let layer = |j: usize| {
        let label = model.basis.label(j);
        let word: String = label
            .chars()
            .map(|c| match c {
                '-' => 'n',
                c if c.is_ascii_alphanumeric() => c,
                _ => '_',
            })
            .collect();
        format!("b{j:02}_{word}")
    };
    let functions = 0..model.basis.count();
    let colored = |layer: String| ["R", "G", "B"].map(|channel| format!("{layer}.{channel}"));
    match model.layout {
        Layout::Rgb => functions.flat_map(|j| colored(layer(j))).collect(),
        Layout::Grey => functions.map(|j| layer(j) + ".Y").collect(),
        Layout::Lrgb => functions.map(|j| layer(j) + ".Y").chain(colored("base".to_owned())).collect(),
    }
}

/// A quantizer for each plane.
fn quantizers(
    path: &Path,
    header: &AssetHeader,
    ranges: &[CoefficientRange],
) -> Result<Vec<Quantizer>, FormatError> {
    let plain = CoefficientRange { min: 0.0, max: 1.0 };
    let ranges = (0..header.model.plane_count()).map(|plane| ranges.get(plane).copied().unwrap_or(plain));
    let quantizers: Vec<_> = ranges.map(|range| header.precision.quantizer(range)).collect();
    let finite = |q: &Quantizer| q.scale.is_finite() && q.bias.is_finite();
    if let Some(plane) = quantizers.iter().position(|q| !finite(q)) {
        let name = &plane_names(&header.model)[plane];
        let problem = format!("the coefficients of plane {name} are not finite; raise the ridge");
        return Err(FormatError::invalid(path, problem));
    }
    Ok(quantizers)
}

/// Panics unless `span` has its shapes and lies inside the map.
fn assert_shape(header: &AssetHeader, span: &CoefficientSpan<'_>) {
    let channels = header.model.layout.planes_per_function();
    let base = if header.model.layout == Layout::Lrgb { 3 * span.pixels } else { 0 };
    assert!(span.first + span.pixels <= header.width * header.height, "the span leaves the map");
    assert_eq!(span.functions.len(), header.model.basis.count() * span.pixels * channels, "functions");
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
