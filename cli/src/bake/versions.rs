//! What an asset was before its coefficients were quantised, and before its codes went into blocks or JPEG: files that are
//! made in the same pass and kept until it is known what each step lost.

use crate::budget::{BLOCK_CODING, JPEG, QUANTISATION};
use crate::failure::Failure;
use relight_core::CoefficientRange;
use relight_formats::{AssetFormat, AssetHeader, AssetWriter, WriteSettings};
use relight_texture::{
    ArrayPlan, BlockFormat, Coding, LayerPlan, Packing, Precision, Quantizer, TexelDomain, TexelFormat, Wrap,
};
use std::path::{Path, PathBuf};

/// An asset by the steps in which it came about.
pub(crate) struct Versions {
    /// The coefficients as they were fitted; the asset itself where it holds those.
    pub(crate) float: PathBuf,
    /// What was done to them, and the file after it; the last is the asset, where it isn't the first.
    pub(crate) steps: Vec<(&'static str, PathBuf)>,
}

/// A version that is being written.
type Writer = Box<dyn AssetWriter>;

impl Versions {
    /// Those of the asset at `output`, kept in `folder`, and what writes them.
    ///
    /// # Errors
    /// Those of creating files.
    pub(super) fn create(
        folder: &Path,
        output: &Path,
        format: &AssetFormat,
        header: &AssetHeader,
        settings: &WriteSettings,
    ) -> Result<(Self, Vec<Writer>), Failure> {
        let is_float = |format| matches!(format, TexelFormat::Plain { precision: Precision::F32, .. });
        if header.packing.formats().all(is_float) {
            return Ok((Self { float: output.to_owned(), steps: Vec::new() }, Vec::new()));
        }
        let plain = WriteSettings {
            // Blocks are not dithered.
            coding: Coding { dither: false, ..settings.coding },
            zstd: None,
            split: false,
            jpeg_quality: None,
            deepzoom: false,
            memory_limit: settings.memory_limit,
        };
        let mut writers = Vec::new();
        let mut create = |name: &str, format: &AssetFormat, packing: Packing| -> Result<PathBuf, Failure> {
            let path = folder.join(name).with_extension(format.extension);
            writers.push(format.create(&path, AssetHeader { packing, ..header.clone() }, &plain)?);
            Ok(path)
        };
        let textures = AssetFormat::by_path(Path::new("version.ktx2")).map_err(Failure::of_output)?;
        let planes = (0..header.model.plane_count()).map(|plane| (plane, Quantizer::PLAIN));
        let float = TexelFormat::Plain { precision: Precision::F32, channels: 1 };
        let float = create("float", textures, packing_of(vec![array(float, planes)]))?;
        let mut steps = Vec::new();
        let coded = if header.packing.formats().any(|format| matches!(format, TexelFormat::Block(_))) {
            Some((BLOCK_CODING, textures))
        } else if format.folder {
            Some((JPEG, textures))
        } else {
            // The same file without JPEG has the same codes.
            settings.jpeg_quality.map(|_| (JPEG, format))
        };
        match coded {
            Some((step, format)) => {
                let packing = match format.textures {
                    true => packing_of(header.packing.arrays.iter().map(codes_of).collect()),
                    false => header.packing.clone(),
                };
                steps.push((QUANTISATION, create("codes", format, packing)?));
                steps.push((step, output.to_owned()));
            }
            None => steps.push((QUANTISATION, output.to_owned())),
        }
        Ok((Self { float, steps }, writers))
    }
}

fn packing_of(arrays: Vec<ArrayPlan>) -> Packing {
    Packing { arrays, levels: 1, wrap: Wrap::Clamp }
}

/// Planes with their quantizers, a layer each: texels of four channels would take a third more of the disk.
fn array(format: TexelFormat, planes: impl Iterator<Item = (usize, Quantizer)>) -> ArrayPlan {
    let layer = |(plane, quantizer)| LayerPlan { planes: vec![plane], quantizers: vec![quantizer] };
    ArrayPlan { format, layers: planes.map(layer).collect() }
}

/// The planes of `plan` in plain texels: halves for BC6H, whose blocks interpolate those, otherwise 8-bit codes over the
/// same ranges.
fn codes_of(plan: &ArrayPlan) -> ArrayPlan {
    let domain = plan.format.domain();
    let precision = match plan.format {
        TexelFormat::Plain { precision, .. } => precision,
        TexelFormat::Block(BlockFormat::Bc6h | BlockFormat::Bc6hSigned) => Precision::F16,
        TexelFormat::Block(_) => Precision::U8,
    };
    let format = TexelFormat::Plain { precision, channels: 1 };
    let quantizer_of = |quantizer: Quantizer| {
        if domain == format.domain() {
            return quantizer;
        }
        let Quantizer { scale, bias } = quantizer;
        let least = if domain == TexelDomain::Signed { bias - scale } else { bias };
        precision.quantizer(CoefficientRange { min: least, max: bias + scale })
    };
    let planes = plan.layers.iter().flat_map(|layer| layer.planes.iter().zip(&layer.quantizers));
    array(format, planes.map(|(&plane, &quantizer)| (plane, quantizer_of(quantizer))))
}
