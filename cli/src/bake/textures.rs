//! From options and the planes' distributions to where every plane lies: formats, scale and bias.

use crate::budget::{BLOCK_CODING, JPEG, QUANTISATION};
use crate::failure::{Exit, Failure};
use crate::interrupt;
use crate::options::{WrapChoice, optional, words_of};
use clap::{Args, ValueEnum};
use rayon::prelude::*;
use relight_core::{
    CoefficientDistribution, CoefficientSample, CoefficientSpan, CpuLevel, Layout, Model, Stack,
};
use relight_fit::{PixelFit, coefficient_distributions, coefficient_sample};
use relight_formats::{AssetFormat, WriteSettings, plane_names};
use relight_texture::{
    ArrayPlan, BlockCoding, BlockFormat, Budget, Candidate, ChoiceError, Coding, Encoder, LayerPlan,
    PackReport, Packer, Packing, Precision, Quality, Quantizer, RangeChoice, RangeRule, TexelFormat, Wrap,
    choose_formats, choose_range, error_ceilings, full_levels, planes_of_layers,
};

/// How coefficients become textures.
#[derive(Args, Clone, Debug)]
pub(crate) struct TextureOptions {
    /// How coefficients are stored without blocks; u8 by default, f16 in .exr
    #[arg(long, value_name = "PRECISION", value_enum)]
    precision: Option<PrecisionChoice>,
    /// Block compression: none, bc1, bc3, bc4, bc4s, bc5, bc5s, bc6h, bc6hs, bc7, or auto (a format
    /// for each map by what its error does to relit pictures)
    #[arg(long, value_name = "FORMAT", default_value = "none", value_parser = block_of)]
    block: BlockChoice,
    /// With --block auto: the most bits a pixel that the textures may take; otherwise the cheapest
    /// formats are taken that cost about 0.3 dB
    #[arg(long, value_name = "BITS", value_parser = bits_of, allow_negative_numbers = true)]
    bits_per_pixel: Option<f64>,
    /// How hard blocks are searched: fast, normal, high or best
    #[arg(long, value_name = "QUALITY", default_value = "normal", value_parser = quality_of)]
    quality: Quality,
    /// Who searches: portable (same bytes on every machine) or ispc (kernels for bc7 and bc6h, faster for bc6h; bytes may
    /// differ between processors)
    #[arg(long, value_name = "ENCODER", default_value = "portable", value_parser = encoder_of)]
    encoder: Encoder,
    /// Range of each map's codes: min-error (clips outliers where that lowers the error), minmax,
    /// or unit (-1 to 1, as the panoramas paper)
    #[arg(long, value_name = "RULE", default_value = "min-error", value_parser = range_of_name)]
    range: RangeRule,
    /// Dither 8-bit codes by an ordered pattern
    #[arg(long)]
    dither: bool,
    /// Store mip levels down to 1 x 1, filtered from the coefficients
    #[arg(long)]
    mips: bool,
    /// What samplers shall do beyond the edge; stored for engines and shaders [default: clamp]
    #[arg(long, value_name = "MODE", value_enum)]
    wrap: Option<WrapChoice>,
    /// Compress .ktx2 with zstd, at a level from 1 to 19
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, require_equals = true, default_missing_value = "12", value_parser = clap::value_parser!(i32).range(1..=19))]
    zstd: Option<i32>,
    /// Compress the planes of .ptm by JPEG, at a quality from 1 to 100; those of .web always are, at 95 by default
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg_quality: Option<u8>,
    /// Cut the planes of .web into tiles (Deep Zoom, 256 x 256 with overlap), for large pictures
    #[arg(long)]
    deepzoom: bool,
    /// Write a file for each map, as three.js and Godot load them
    #[arg(long)]
    split: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BlockChoice {
    None,
    Only(BlockFormat),
    Auto,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PrecisionChoice {
    U8,
    F16,
    F32,
}

impl From<PrecisionChoice> for Precision {
    fn from(choice: PrecisionChoice) -> Self {
        match choice {
            PrecisionChoice::U8 => Self::U8,
            PrecisionChoice::F16 => Self::F16,
            PrecisionChoice::F32 => Self::F32,
        }
    }
}

fn block_of(text: &str) -> Result<BlockChoice, String> {
    match text {
        "none" => Ok(BlockChoice::None),
        "auto" => Ok(BlockChoice::Auto),
        name => BlockFormat::by_name(name).map(BlockChoice::Only).ok_or_else(|| {
            let names: Vec<_> = BlockFormat::all().map(BlockFormat::name).collect();
            format!("write none, auto or a format: {}", names.join(", "))
        }),
    }
}

fn bits_of(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(bits) if (0.1..=1e5).contains(&bits) => Ok(bits),
        _ => Err("write a number of bits from 0.1 to 100000".to_owned()),
    }
}

/// The value of that name, or a sentence that lists the names.
fn named<T>(text: &str, found: Option<T>, names: impl Iterator<Item = &'static str>) -> Result<T, String> {
    found.ok_or_else(|| format!("'{text}' is not one of {}", names.collect::<Vec<_>>().join(", ")))
}

fn quality_of(text: &str) -> Result<Quality, String> {
    named(text, Quality::by_name(text), Quality::all().map(Quality::name))
}

fn encoder_of(text: &str) -> Result<Encoder, String> {
    named(text, Encoder::by_name(text), Encoder::all().map(Encoder::name))
}

fn range_of_name(text: &str) -> Result<RangeRule, String> {
    named(text, RangeRule::by_name(text), RangeRule::ALL.into_iter().map(RangeRule::name))
}

/// Formats among which `--block auto` chooses for maps of three channels, and for single planes.
const AUTO: [&[TexelFormat]; 2] = [
    &[
        TexelFormat::Block(BlockFormat::Bc1),
        TexelFormat::Block(BlockFormat::Bc6h),
        TexelFormat::Block(BlockFormat::Bc7),
        TexelFormat::Plain { precision: Precision::U8, channels: 4 },
    ],
    &[TexelFormat::Block(BlockFormat::Bc4), TexelFormat::Plain { precision: Precision::U8, channels: 1 }],
];

/// Blocks of 4 x 4 pixels on which formats are tried.
const TRIAL_BLOCKS: usize = 1024;

/// A row of trial blocks.
const TRIAL_ROW: usize = 32;

/// What `auto` may cost on its own, in dB of the mean PSNR over lights.
const AUTO_LOSS: f64 = 0.2;

/// Each time that what was chosen costs too much, so much less is allowed ..
const SHARE_STEP: f64 = 0.7;

/// .. down to this.
const SMALLEST_SHARE: f64 = 0.01;

/// Coefficients are stored as they are.
const AS_IT_IS: RangeChoice = RangeChoice { quantizer: Quantizer::PLAIN, clipped: 0, rmse: 0.0 };

/// A format and the planes of each of its layers.
type ArrayLayers = (TexelFormat, Vec<Vec<usize>>);

/// On what formats are tried.
pub(crate) struct Trial {
    sample: CoefficientSample,
    /// Root mean square error of predicting each light from the others.
    left_out: Vec<f64>,
}

impl Trial {
    /// Of the coefficients that `fit` makes of `stack`; `left_out` are the errors of predicting each light from the others.
    ///
    /// # Errors
    /// Those of reading the stack.
    pub(crate) fn of(
        stack: &dyn Stack,
        fit: PixelFit<'_>,
        level: CpuLevel,
        left_out: Vec<f64>,
    ) -> Result<Self, Failure> {
        Ok(Self { sample: coefficient_sample(stack, fit, level, TRIAL_BLOCKS)?, left_out })
    }
}

/// The distributions of the coefficients that `fit` makes of `stack`, by which ranges are chosen.
///
/// # Errors
/// Those of reading the stack, and Ctrl-C.
pub(crate) fn distributions(
    stack: &dyn Stack,
    fit: PixelFit<'_>,
    level: CpuLevel,
) -> Result<Vec<CoefficientDistribution>, Failure> {
    coefficient_distributions::<Failure>(stack, fit, level, || Ok(interrupt::check()?))
}

/// Where every plane lies, and how its range was chosen.
pub(crate) struct Plan {
    pub(crate) packing: Packing,
    /// One a plane.
    pub(crate) ranges: Vec<RangeChoice>,
}

impl TextureOptions {
    /// These options with others for how planes are stored, by their names on the command line.
    ///
    /// # Errors
    /// Exit code 2 for names that there aren't.
    pub(crate) fn with(
        &self,
        precision: Option<&str>,
        block: Option<&str>,
        quality: Option<&str>,
    ) -> Result<Self, Failure> {
        let refused = |axis: &str, words: String| Failure::usage(format!("--axes {axis}: {words}"));
        let mut options = self.clone();
        if let Some(name) = precision {
            let found = PrecisionChoice::from_str(name, false).map_err(|_| {
                Failure::usage(format!("--axes precision: '{name}' is not one of u8, f16, f32"))
            })?;
            options.precision = Some(found);
        }
        if let Some(name) = block {
            options.block = block_of(name).map_err(|words| refused("block", words))?;
        }
        if let Some(name) = quality {
            options.quality = quality_of(name).map_err(|words| refused("quality", words))?;
        }
        Ok(options)
    }

    /// All that these options say of an asset of `format`, by name.
    pub(crate) fn named(&self, format: &AssetFormat) -> Vec<(&'static str, String)> {
        let precision = self.precision.map_or(format.precisions[0], Precision::from);
        let block = match self.block {
            BlockChoice::None => "none",
            BlockChoice::Auto => "auto",
            BlockChoice::Only(format) => format.name(),
        };
        vec![
            ("precision", precision.name().to_owned()),
            ("block", block.to_owned()),
            ("bits_per_pixel", optional(self.bits_per_pixel)),
            ("quality", self.quality.name().to_owned()),
            ("encoder", self.encoder.name().to_owned()),
            ("range", self.range.name().to_owned()),
            ("dither", self.dither.to_string()),
            ("mips", self.mips.to_string()),
            ("wrap", words_of(self.wrap.unwrap_or(WrapChoice::Clamp))),
            ("zstd", optional(self.zstd)),
            ("jpeg_quality", optional(self.jpeg_quality)),
            ("deepzoom", self.deepzoom.to_string()),
            ("split", self.split.to_string()),
        ]
    }

    /// Whether blocks or a precision are asked for.
    pub(crate) fn asks_for_storage(&self) -> bool {
        self.block != BlockChoice::None || self.precision.is_some()
    }

    /// How texels are made.
    ///
    /// # Errors
    /// Exit code 6 for an encoder that this program lacks.
    pub(crate) fn coding(&self) -> Result<Coding, Failure> {
        if !self.encoder.available() {
            let message = format!(
                "--encoder {} is not in this program; it comes with the cargo feature ispc on x86-64 and ARM64",
                self.encoder.name()
            );
            return Err(Failure::new(Exit::Unsupported, message));
        }
        let blocks = BlockCoding { quality: self.quality, encoder: self.encoder };
        Ok(Coding { blocks, dither: self.dither })
    }

    /// How files are written.
    ///
    /// # Errors
    /// As [`Self::coding`].
    pub(crate) fn settings(&self, memory_limit: u64) -> Result<WriteSettings, Failure> {
        Ok(WriteSettings {
            coding: self.coding()?,
            zstd: self.zstd,
            split: self.split,
            jpeg_quality: self.jpeg_quality,
            deepzoom: self.deepzoom,
            memory_limit,
        })
    }

    /// What lies beyond the edge, if the options say.
    pub(crate) fn wrap(&self) -> Option<Wrap> {
        self.wrap.map(WrapChoice::mode)
    }

    /// Whether ranges are chosen by the planes themselves, so that codes that fit one need not change.
    pub(crate) fn has_usual_ranges(&self) -> bool {
        self.range == RangeRule::default()
    }

    /// Whether formats are chosen by trial.
    pub(crate) fn tries(&self) -> bool {
        self.block == BlockChoice::Auto
    }

    /// Mip levels of such a picture.
    pub(crate) fn levels(&self, width: usize, height: usize) -> usize {
        if self.mips { full_levels(width, height) } else { 1 }
    }

    /// The formats that may be taken, the first the one for want of a trial; `usual` is the precision where
    /// none is asked for.
    ///
    /// # Errors
    /// Exit code 2 for options that exclude each other.
    pub(crate) fn formats(
        &self,
        usual: Precision,
        format: &AssetFormat,
        layout: Layout,
    ) -> Result<Vec<TexelFormat>, Failure> {
        if self.bits_per_pixel.is_some() && self.block != BlockChoice::Auto {
            return Err(Failure::usage("--bits-per-pixel belongs to --block auto"));
        }
        let precision = self.precision.map(Precision::from);
        if let (Some(precision), true) = (precision, self.block != BlockChoice::None) {
            let message = format!(
                "--precision {} and --block exclude each other: blocks have a precision of their own",
                precision.name()
            );
            return Err(Failure::usage(message));
        }
        Ok(match self.block {
            BlockChoice::Only(block) => vec![TexelFormat::Block(block)],
            BlockChoice::None => vec![format.plain_format(layout, precision.unwrap_or(usual))],
            BlockChoice::Auto => match layout {
                Layout::Rgb => AUTO[0].to_vec(),
                Layout::Grey => AUTO[1].to_vec(),
                Layout::Lrgb | Layout::Shared => AUTO.concat(),
            },
        })
    }

    /// Whether a step of the error budget may be there: `--block auto` may choose no blocks, and searches any.
    pub(crate) fn may_have_stage(&self, name: &str, format: &AssetFormat) -> bool {
        match name {
            QUANTISATION => self.block != BlockChoice::None || self.precision != Some(PrecisionChoice::F32),
            BLOCK_CODING => self.block != BlockChoice::None,
            JPEG => format.folder || self.jpeg_quality.is_some(),
            _ => true,
        }
    }

    /// Where every plane lies. `sample` is needed where [`Self::tries`] says so.
    ///
    /// # Errors
    /// Exit code 5 when no choice of formats stays within --bits-per-pixel; exit code 3 for a plane
    /// that is not finite.
    pub(crate) fn plan(
        &self,
        model: &Model,
        size: (usize, usize),
        formats: &[TexelFormat],
        distributions: &[CoefficientDistribution],
        sample: Option<&Trial>,
    ) -> Result<Plan, Failure> {
        let arrays = match sample {
            Some(trial) => self.chosen_arrays(model, formats, distributions, trial)?,
            None => vec![(formats[0], planes_of_layers(model, formats[0]))],
        };
        let mut ranges = vec![AS_IT_IS; model.plane_count()];
        for (format, layers) in &arrays {
            let chosen = self.ranges(model, *format, distributions)?;
            for &plane in layers.iter().flatten() {
                ranges[plane] = chosen[plane];
            }
        }
        let arrays = arrays.into_iter().map(|(format, layers)| array(format, layers, &ranges)).collect();
        let wrap = self.wrap().unwrap_or_default();
        Ok(Plan { packing: Packing { arrays, levels: self.levels(size.0, size.1), wrap }, ranges })
    }

    /// The range of each plane in `format`.
    fn ranges(
        &self,
        model: &Model,
        format: TexelFormat,
        distributions: &[CoefficientDistribution],
    ) -> Result<Vec<RangeChoice>, Failure> {
        if distributions.is_empty() {
            return Ok(vec![AS_IT_IS; model.plane_count()]);
        }
        let planes = distributions.iter().zip(error_ceilings(model)).enumerate();
        planes
            .map(|(plane, (distribution, ceiling))| {
                choose_range(distribution, format, self.range, ceiling).map_err(|error| {
                    let name = &plane_names(model)[plane];
                    Failure::new(Exit::BadInput, format!("plane {name}: {error}; raise the ridge"))
                })
            })
            .collect()
    }

    /// A format for each map by trial: layers of planes, by format.
    fn chosen_arrays(
        &self,
        model: &Model,
        formats: &[TexelFormat],
        distributions: &[CoefficientDistribution],
        trial: &Trial,
    ) -> Result<Vec<ArrayLayers>, Failure> {
        let coding = self.coding()?;
        let errors: Vec<Vec<f64>> = formats
            .iter()
            .map(|&format| {
                let ranges = self.ranges(model, format, distributions)?;
                let packing = Packing {
                    arrays: vec![array(format, planes_of_layers(model, format), &ranges)],
                    levels: 1,
                    wrap: Wrap::Clamp,
                };
                let report = packed_sample(model, packing, coding, &trial.sample);
                Ok(report.plane_relit_rmse.into_iter().map(|rmse| rmse * rmse).collect())
            })
            .collect::<Result<_, Failure>>()?;
        let maps = maps_of(model);
        let candidates: Vec<Vec<Candidate>> = maps
            .iter()
            .map(|planes| {
                let fitting = |format: &TexelFormat| AUTO[usize::from(planes.len() == 1)].contains(format);
                let of = |(format, errors): (&TexelFormat, &Vec<f64>)| Candidate {
                    format: *format,
                    bits: format.bits(),
                    error: planes.iter().map(|&plane| errors[plane]).sum(),
                };
                formats.iter().zip(&errors).filter(|(format, _)| fitting(format)).map(of).collect()
            })
            .collect();
        let arrays_of = |budget| {
            let chosen = choose_formats(&candidates, budget)?;
            let mut arrays: Vec<ArrayLayers> = formats.iter().map(|&format| (format, Vec::new())).collect();
            for ((planes, candidates), index) in maps.iter().zip(&candidates).zip(chosen) {
                let format = candidates[index].format;
                for (_, layers) in arrays.iter_mut().filter(|(array, _)| *array == format) {
                    layers.push(planes.clone());
                }
            }
            arrays.retain(|(_, layers)| !layers.is_empty());
            Ok(arrays)
        };
        let impossible =
            |error: ChoiceError| Failure::new(Exit::OverBudget, format!("--bits-per-pixel: {error}"));
        if let Some(bits) = self.bits_per_pixel {
            return arrays_of(Budget::BitsPerPixel(bits)).map_err(impossible);
        }
        // Candidates' errors add up as if those of different maps were independent. They are not
        // quite: what is chosen is tried as a whole, and less is allowed until it fits.
        let affordable = affordable_error(&trial.left_out, AUTO_LOSS);
        let mut allowed = affordable;
        loop {
            let arrays = arrays_of(Budget::Error(allowed)).map_err(impossible)?;
            let mut packed = Vec::new();
            for (format, layers) in &arrays {
                let ranges = self.ranges(model, *format, distributions)?;
                packed.push(array(*format, layers.clone(), &ranges));
            }
            let packing = Packing { arrays: packed, levels: 1, wrap: Wrap::Clamp };
            let relit_rmse = packed_sample(model, packing, coding, &trial.sample).relit_rmse;
            if relit_rmse * relit_rmse <= affordable || allowed < affordable * SMALLEST_SHARE {
                return Ok(arrays);
            }
            allowed *= SHARE_STEP;
        }
    }
}

/// A sentence where some engines want another size than the picture's.
pub(crate) fn size_note(packing: &Packing, width: usize, height: usize) -> Option<String> {
    let blocks = packing.formats().any(|format| format.unit_size() > 1);
    let filled = [width, height].map(|size| size.next_multiple_of(4));
    (blocks && filled != [width, height]).then(|| {
        format!(
            "{width} x {height} is no multiple of 4: blocks are filled up beyond the edge; WebGL, WebGPU and \
             Direct3D want the texture declared as {} x {}",
            filled[0], filled[1]
        )
    })
}

/// The maps among which `auto` distinguishes: the three planes of a function or of the base colour,
/// or a single plane.
fn maps_of(model: &Model) -> Vec<Vec<usize>> {
    let maps = model.maps();
    match model.layout {
        Layout::Rgb => (0..maps).map(|map| (3 * map..3 * map + 3).collect()).collect(),
        Layout::Grey => (0..maps).map(|map| vec![map]).collect(),
        Layout::Shared => (0..maps).collect::<Vec<_>>().chunks(3).map(<[usize]>::to_vec).collect(),
        Layout::Lrgb => (0..maps).map(|map| vec![map]).chain([(maps..maps + 3).collect()]).collect(),
    }
}

fn array(format: TexelFormat, layers: Vec<Vec<usize>>, ranges: &[RangeChoice]) -> ArrayPlan {
    let layers = layers
        .into_iter()
        .map(|planes| LayerPlan {
            quantizers: planes.iter().map(|&plane| ranges[plane].quantizer).collect(),
            planes,
        })
        .collect();
    ArrayPlan { format, layers }
}

/// The squared error beside those of predicting each light from the others, `left_out`, that takes
/// `loss` dB of their mean PSNR; at least the rounding of 8-bit pictures.
fn affordable_error(left_out: &[f64], loss: f64) -> f64 {
    let rounding = 1.0 / (12.0 * 255.0 * 255.0);
    let squares: Vec<f64> =
        left_out.iter().filter(|rmse| rmse.is_finite()).map(|rmse| (rmse * rmse).max(rounding)).collect();
    let loss_of = |error: f64| {
        let ratios = squares.iter().map(|square| 10.0 * libm::log10(1.0 + error / square));
        ratios.sum::<f64>() / squares.len() as f64
    };
    // The loss grows with the error: halve the interval until it is as narrow as it matters.
    let (mut low, mut high) = (0.0, squares.iter().copied().fold(rounding, f64::max));
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        *if loss_of(middle) <= loss { &mut low } else { &mut high } = middle;
    }
    low.max(rounding)
}

/// What storing the sample costs.
fn packed_sample(model: &Model, packing: Packing, coding: Coding, sample: &CoefficientSample) -> PackReport {
    let stride = model.layout.planes_per_map();
    let (width, rows) = (4 * TRIAL_ROW, sample.blocks.div_ceil(TRIAL_ROW));
    let packer = Packer::new(width, 4 * rows, model, packing, coding);
    let count = model.maps();
    (0..rows).into_par_iter().for_each(|row| {
        let pixels = 4 * width;
        let mut maps = vec![0.0; count * pixels * stride];
        let mut base_color = vec![0.0; if model.layout == Layout::Lrgb { 3 * pixels } else { 0 }];
        for (plane, blocks) in sample.planes.iter().enumerate() {
            for column in 0..TRIAL_ROW {
                // The last row is filled up with the last block.
                let block = (row * TRIAL_ROW + column).min(sample.blocks - 1);
                for (i, value) in blocks[block * 16..][..16].iter().enumerate() {
                    let pixel = i / 4 * width + 4 * column + i % 4;
                    match plane.checked_sub(count * stride) {
                        Some(channel) => base_color[3 * pixel + channel] = *value,
                        None => maps[(plane / stride * pixels + pixel) * stride + plane % stride] = *value,
                    }
                }
            }
        }
        let span = CoefficientSpan { first: row * pixels, pixels, maps: &maps, base_color: &base_color };
        let written: Result<(), std::convert::Infallible> = packer.write(&span, &|_, _| Ok(()));
        written.unwrap_or_else(|never| match never {});
    });
    let report: Result<_, std::convert::Infallible> = packer.finish(&|_, _| Ok(()));
    report.unwrap_or_else(|never| match never {})
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_affordable_error_takes_that_much_of_the_mean_psnr() {
        let left_out = [0.02, 0.3, 0.05, f64::INFINITY];
        let error = affordable_error(&left_out, 0.3);
        let psnr = |add: f64| {
            let of = |rmse: &f64| -10.0 * libm::log10(rmse * rmse + add);
            left_out[..3].iter().map(of).sum::<f64>() / 3.0
        };
        assert!((psnr(0.0) - psnr(error) - 0.3).abs() < 1e-6, "{error}");
        assert_eq!(affordable_error(&[0.0, 1e-9], 0.3), 1.0 / (12.0 * 255.0 * 255.0));
        assert_eq!(affordable_error(&[], 0.3), 1.0 / (12.0 * 255.0 * 255.0));
    }
}
