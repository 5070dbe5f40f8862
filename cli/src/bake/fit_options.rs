//! What is fitted and how: options of whoever fits pictures.

use crate::failure::Failure;
use crate::function_options::{FunctionOptions, family_of_name, size_of};
use crate::options::{ByteCount, optional, words_of};
use clap::{Args, ValueEnum};
use relight_core::basis::SrbfDesign;
use relight_core::metrics::psnr;
use relight_core::{Family, Layout, Space};
use relight_fit::{LearnedDesign, LightWeights, Ridge};
use relight_formats::OpenCapture;

/// Functions of light, what they are fitted to, and how many planes remain of them.
#[derive(Args, Clone, Debug)]
pub(crate) struct FitOptions {
    /// Family of functions: ptm, sh, hsh, srbf, or pca for planes learned from the pictures [default: ptm, or the
    /// cheapest that reaches a target]
    #[arg(long, value_name = "NAME")]
    basis: Option<String>,
    #[command(flatten)]
    functions: FunctionOptions,
    /// Three planes a function, or luminance planes and a base colour; of pca: planes of any colour, or of
    /// luminance or chrominance each
    #[arg(long, value_name = "COLOR", value_enum, default_value = "rgb")]
    color: Color,
    /// Store so many planes instead of all coefficients of ptm, sh, hsh or srbf: those that carry most of them
    #[arg(long, value_name = "N", value_parser = size_of, allow_negative_numbers = true)]
    pub(super) planes: Option<usize>,
    #[command(flatten)]
    pub(crate) targets: TargetOptions,
    /// Values to fit: auto takes 8/16-bit pictures encoded and float pictures linear
    #[arg(long, value_name = "SPACE", value_enum, default_value = "auto")]
    space: SpaceChoice,
    /// How strongly coefficients are held small: auto, or 0 to 1
    #[arg(long, value_name = "RIDGE", default_value = "auto", value_parser = ridge_of, allow_negative_numbers = true)]
    pub(super) ridge: Ridge,
    /// Follow most lights at each pixel instead of all, so that shadows and highlights are left out: the matte layer;
    /// for ptm, sh, hsh and srbf. Without a cache, bakes keep coefficients, 4 bytes each, in a folder beside the output meanwhile
    #[arg(long)]
    robust: bool,
    /// Weight of each light: by the area of its cell on the sphere, or all alike
    #[arg(long, value_name = "WEIGHTS", value_enum, default_value = "voronoi")]
    weights: Weights,
}

/// What is wanted, of which the cheapest choice is taken: of planes for --basis pca and --planes, otherwise of bases,
/// their sizes and blocks.
#[derive(Args, Clone, Copy, Debug, Default)]
pub(crate) struct TargetOptions {
    /// Take the fewest bytes whose mean PSNR on lights predicted from the others reaches this (dB): the fewest planes
    /// of --basis pca or --planes, otherwise the cheapest basis, size and block format
    #[arg(long, value_name = "DB", value_parser = decibels_of, allow_negative_numbers = true)]
    pub(crate) target_psnr: Option<f64>,
    /// The same by the mean root mean square error, 0 to 1
    #[arg(long, value_name = "RMSE", value_parser = error_of, conflicts_with = "target_psnr", allow_negative_numbers = true)]
    pub(crate) target_error: Option<f64>,
    /// Take no more bytes of texels than this, mip levels included, and the best that they hold; 8M, 512K
    #[arg(long, value_name = "BYTES")]
    pub(crate) budget_bytes: Option<ByteCount>,
}

impl TargetOptions {
    /// Whether one is given.
    pub(crate) fn any(&self) -> bool {
        self.target_psnr.is_some() || self.target_error.is_some() || self.budget_bytes.is_some()
    }

    /// Quality in the units of what is asked for: dB, or an error's negative, so that more is better.
    pub(crate) fn quality(&self, psnr: f64, rmse: f64) -> f64 {
        if self.target_error.is_some() { -rmse } else { psnr }
    }

    /// The quality to reach.
    pub(crate) fn least(&self) -> Option<f64> {
        self.target_psnr.or(self.target_error.map(|error| -error))
    }

    /// What is asked for, in words.
    pub(crate) fn words(&self) -> String {
        let within = self.budget_bytes.map(|budget| format!("{} bytes", budget.0));
        let reach = (self.target_psnr.map(|psnr| format!("{psnr} dB")))
            .or(self.target_error.map(|error| format!("an RMSE of {error}")));
        match (reach, within) {
            (Some(reach), Some(within)) => format!("{reach} within {within}"),
            (reach, within) => reach.or(within).unwrap_or_default(),
        }
    }

    /// The PSNR to reach, of which an error is another name where all lights err alike.
    fn psnr(&self) -> Option<f64> {
        self.target_psnr.or(self.target_error.map(psnr))
    }
}

/// How channels share planes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Color {
    Rgb,
    Lrgb,
    Ycc,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SpaceChoice {
    Auto,
    Encoded,
    Linear,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Weights {
    Voronoi,
    Uniform,
}

fn decibels_of(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(decibels) if (0.0..=120.0).contains(&decibels) => Ok(decibels),
        _ => Err("write decibels from 0 to 120".to_owned()),
    }
}

fn error_of(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(error) if error > 0.0 && error <= 1.0 => Ok(error),
        _ => Err("write an error above 0 and up to 1".to_owned()),
    }
}

fn ridge_of(text: &str) -> Result<Ridge, String> {
    match text.parse::<f64>() {
        _ if text == "auto" => Ok(Ridge::Auto),
        Ok(ridge) if (0.0..=1.0).contains(&ridge) => Ok(Ridge::Fixed(ridge)),
        _ => Err("write auto or a number from 0 to 1".to_owned()),
    }
}

impl FitOptions {
    /// The space of what is fitted.
    pub(crate) fn space(&self, capture: &OpenCapture) -> Space {
        match self.space {
            SpaceChoice::Encoded => Space::Encoded,
            SpaceChoice::Linear => Space::Linear,
            SpaceChoice::Auto if capture.is_float() => Space::Linear,
            SpaceChoice::Auto => Space::Encoded,
        }
    }

    pub(super) fn layout(&self, capture: &OpenCapture) -> Result<Layout, Failure> {
        let learned = self.learns()?;
        Ok(match self.color {
            Color::Rgb | Color::Ycc if learned => Layout::Shared,
            Color::Lrgb if learned => {
                return Err(Failure::usage(
                    "--color lrgb is not for --basis pca and --planes; use rgb or ycc",
                ));
            }
            Color::Ycc => {
                let message = format!(
                    "--color ycc belongs to --basis pca and --planes; {} alone has rgb and lrgb",
                    self.basis()
                );
                return Err(Failure::usage(message));
            }
            Color::Lrgb if self.robust => {
                return Err(Failure::usage("--robust has no --color lrgb; leave one of them out"));
            }
            Color::Lrgb => Layout::Lrgb,
            Color::Rgb if capture.is_grey() => Layout::Grey,
            Color::Rgb => Layout::Rgb,
        })
    }

    fn basis(&self) -> &str {
        self.basis.as_deref().unwrap_or("ptm")
    }

    /// All that these options say of the coefficients of `capture`'s pictures, by name.
    ///
    /// # Errors
    /// Those of options that exclude each other.
    pub(super) fn named(&self, capture: &OpenCapture) -> Result<Vec<(&'static str, String)>, Failure> {
        let TargetOptions { target_psnr, target_error, budget_bytes } = self.targets;
        let count = self.asked_count()?.map_or("usual".to_owned(), |count| count.to_string());
        let mut settings = vec![
            ("basis", self.family()?.name.to_owned()),
            ("k", count),
            ("color", words_of(self.color)),
            ("planes", optional(self.planes)),
            ("target_psnr", optional(target_psnr)),
            ("target_error", optional(target_error)),
            ("budget_bytes", optional(budget_bytes.map(|bytes| bytes.0))),
            ("space", format!("{:?}", self.space(capture)).to_lowercase()),
            (
                "ridge",
                match self.ridge {
                    Ridge::Auto => "auto".to_owned(),
                    Ridge::Fixed(ridge) => ridge.to_string(),
                },
            ),
            ("robust", self.robust.to_string()),
            ("weights", words_of(self.weights)),
        ];
        let srbf = self.srbf()?;
        if self.basis() == "srbf" {
            settings.extend([
                ("points", format!("{:?}", srbf.points).to_lowercase()),
                ("domain", format!("{:?}", srbf.domain).to_lowercase()),
                ("spread", format!("{:?}", srbf.spread).to_lowercase()),
                ("kernel", format!("{:?}", srbf.kernel).to_lowercase()),
            ]);
        }
        Ok(settings)
    }

    /// These options for `count` functions of `basis`, without a target.
    pub(crate) fn with(&self, basis: &str, count: usize) -> Self {
        let functions = self.functions.with_count(count);
        Self { basis: Some(basis.to_owned()), functions, targets: TargetOptions::default(), ..self.clone() }
    }

    /// Whether most lights decide at each pixel rather than all.
    pub(super) fn is_robust(&self) -> bool {
        self.robust
    }

    /// The basis that is asked for.
    pub(crate) fn asked_basis(&self) -> Option<&str> {
        self.basis.as_deref()
    }

    /// Whether a target chooses among bases rather than among planes of one.
    pub(crate) fn searches(&self) -> Result<bool, Failure> {
        Ok(self.targets.any() && !self.learns()?)
    }

    /// The most bytes that texels may take.
    pub(super) fn budget_bytes(&self) -> Option<u64> {
        self.targets.budget_bytes.map(|budget| budget.0)
    }

    /// Whether planes are learned.
    pub(super) fn learns(&self) -> Result<bool, Failure> {
        let learned = self.family()?.learned;
        if learned && self.planes.is_some() {
            return Err(Failure::usage("--planes is for ptm, sh, hsh and srbf; pca has -k"));
        }
        let learned = learned || self.planes.is_some();
        if learned && self.robust {
            return Err(Failure::usage(
                "--robust weighs the lights of each pixel, which planes that all pixels share don't have: leave out --robust, or --basis pca and --planes",
            ));
        }
        Ok(learned)
    }

    /// How `planes` planes at most are learned.
    pub(super) fn learned_design(&self, planes: usize) -> LearnedDesign {
        LearnedDesign { planes, opponent: self.color == Color::Ycc, target_psnr: self.targets.psnr() }
    }

    /// The number of functions asked for by -k, --order or --degree; `None` for the default.
    pub(crate) fn asked_count(&self) -> Result<Option<usize>, Failure> {
        self.functions.asked_count(self.family()?)
    }

    pub(super) fn family(&self) -> Result<&'static Family, Failure> {
        family_of_name(self.basis())
    }

    /// The choices of the SRBF family; an error when they are given for another one.
    pub(super) fn srbf(&self) -> Result<SrbfDesign, Failure> {
        self.functions.srbf(self.basis())
    }

    /// How lights weigh.
    pub(crate) fn weighting(&self) -> LightWeights {
        match self.weights {
            Weights::Voronoi => LightWeights::Voronoi,
            Weights::Uniform => LightWeights::Uniform,
        }
    }
}
