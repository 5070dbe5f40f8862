//! What is made of photographs when they are read: a part of them, as if all lamps had been alike and grey were grey.

use crate::bake::load;
use crate::failure::Failure;
use crate::options::{Machine, optional, words_of};
use clap::{Args, ValueEnum};
use relight_core::{LUMINANCE, Space, Stack};
use relight_fit::{ExposureTrial, FitError, Sample, exposure_factors, exposure_trial};
use relight_formats::{Crop, OpenCapture, place_of, read_intensity_file};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Options of the commands that read photographs.
#[derive(Args, Clone, Debug)]
pub(crate) struct PhotographOptions {
    /// Use only this part of each picture: pixels from the upper left corner, such as 640x480+100+20
    #[arg(long, value_name = "WxH+X+Y")]
    crop: Option<Crop>,
    /// How bright each picture's lamp was: lines 'name factor' or 'name r g b', or numbers alone in order; linear light is
    /// divided by it
    #[arg(long, value_name = "FILE", conflicts_with = "exposure")]
    intensities: Option<PathBuf>,
    /// auto finds out how bright each picture's lamp was, from the surface itself
    #[arg(long, value_name = "EXPOSURE", value_enum)]
    exposure: Option<Exposure>,
    /// A grey card's linear R,G,B, or auto:X,Y,RADIUS, where one is in the whole pictures: makes it grey, as bright as it was
    #[arg(long, value_name = "R,G,B|auto:X,Y,RADIUS")]
    white_balance: Option<WhiteBalance>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Exposure {
    /// Lamps were alike
    Stored,
    /// From the pictures themselves
    Auto,
}

/// What is grey.
#[derive(Clone, Copy, Debug, PartialEq)]
enum WhiteBalance {
    /// Linear light of a grey card.
    Card([f64; 3]),
    /// A disc of pixels.
    Patch { x: usize, y: usize, radius: usize },
}

impl FromStr for WhiteBalance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(patch) = text.strip_prefix("auto:") {
            let numbers: Vec<usize> =
                patch.split(',').filter_map(|number| number.trim().parse().ok()).collect();
            return match numbers[..] {
                [x, y, radius @ 1..=1000] if patch.split(',').count() == 3 && x.max(y) < 1 << 32 => {
                    Ok(Self::Patch { x, y, radius })
                }
                _ => Err("write auto:X,Y,RADIUS in whole pixels, the radius 1 to 1000".to_owned()),
            };
        }
        let numbers: Vec<f64> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
        match numbers[..] {
            [r, g, b] if numbers.iter().all(|v| (1e-6..=1e6).contains(v)) && text.split(',').count() == 3 => {
                Ok(Self::Card([r, g, b]))
            }
            _ => Err("write R,G,B, linear values from 1e-6 to 1e6, or auto:X,Y,RADIUS".to_owned()),
        }
    }
}

/// Factors within this of 1 are not worth a word.
const NOTED: f64 = 0.02;

impl PhotographOptions {
    /// The files that are read.
    pub(crate) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.intensities.iter()
    }

    /// These options without the names of files, which count by their contents.
    pub(crate) fn without_names(&self) -> Self {
        Self { intensities: None, ..self.clone() }
    }

    /// All that these options say but for files, by name.
    pub(crate) fn named(&self) -> Vec<(&'static str, String)> {
        let white_balance = match self.white_balance {
            None => "none".to_owned(),
            Some(WhiteBalance::Card([r, g, b])) => format!("{r},{g},{b}"),
            Some(WhiteBalance::Patch { x, y, radius }) => format!("auto:{x},{y},{radius}"),
        };
        let exposure = self.exposure.unwrap_or(Exposure::Stored);
        vec![
            ("crop", optional(self.crop)),
            ("exposure", words_of(exposure)),
            ("white_balance", white_balance),
        ]
    }

    /// How bright the lamps of `capture`'s pictures were, where a file says so.
    ///
    /// # Errors
    /// What is wrong with that.
    pub(crate) fn intensities(&self, capture: &OpenCapture) -> Result<Option<Vec<[f64; 3]>>, Failure> {
        let Some(path) = &self.intensities else { return Ok(None) };
        Ok(Some(read_intensity_file(path)?.factors_of(capture)?))
    }

    /// Whether something is found out from all pictures, those that are left out too.
    pub(crate) fn look_at_judges(&self) -> bool {
        self.exposure == Some(Exposure::Auto)
            || matches!(self.white_balance, Some(WhiteBalance::Patch { .. }))
    }

    /// These options less what is found out from the pictures themselves.
    pub(crate) fn without_estimates(&self) -> Self {
        let told = |balance: &WhiteBalance| matches!(balance, WhiteBalance::Card(_));
        Self { exposure: None, white_balance: self.white_balance.filter(told), ..self.clone() }
    }

    /// The part that is used.
    pub(crate) fn crop(&self) -> Option<Crop> {
        self.crop
    }

    /// Sets what `capture`'s pictures are to become; pictures that are read for that may spill into `spill_folder`.
    ///
    /// # Errors
    /// Exit code 2 for parts outside the pictures and colours of grey ones, and what reading gives.
    pub(crate) fn apply(
        &self,
        capture: &mut OpenCapture,
        machine: &Machine,
        spill_folder: &Path,
    ) -> Result<(), Failure> {
        let size = capture.size();
        if let Some(crop) = self.crop {
            check_within(&format!("--crop {crop}"), crop, size)?;
            capture.crop = Some(crop);
        }
        let factors = match (self.intensities(capture)?, self.exposure) {
            (Some(factors), _) => Some(factors),
            (None, Some(Exposure::Auto)) => estimated(capture, machine, spill_folder)?,
            (None, _) => None,
        };
        if let Some(factors) = factors {
            capture.gains = factors.iter().map(|factor| factor.map(|factor| (1.0 / factor) as f32)).collect();
        }
        if let Some(white_balance) = self.white_balance {
            if capture.is_grey() {
                return Err(Failure::usage(
                    "--white-balance is for pictures in colour; these have one channel",
                ));
            }
            let grey = match white_balance {
                WhiteBalance::Card(grey) => grey,
                WhiteBalance::Patch { x, y, radius } => {
                    patch(capture, (x, y, radius), size, machine, spill_folder)?
                }
            };
            let luminance: f64 =
                grey.iter().zip(LUMINANCE).map(|(value, weight)| value * f64::from(weight)).sum();
            if capture.gains.is_empty() {
                capture.gains = vec![[1.0; 3]; capture.infos.len()];
            }
            for gain in &mut capture.gains {
                for (gain, grey) in gain.iter_mut().zip(grey) {
                    *gain = (f64::from(*gain) * luminance / grey) as f32;
                }
            }
        }
        Ok(())
    }

    /// Sets the same for pictures to judge by, which another light file names; `all` are those that [`Self::apply`] was for.
    ///
    /// # Errors
    /// Exit code 2 where exposures were found out for other pictures.
    pub(crate) fn apply_to_judges(&self, judges: &mut OpenCapture, all: &OpenCapture) -> Result<(), Failure> {
        judges.crop = all.crop;
        if all.gains.is_empty() {
            return Ok(());
        }
        let places: Vec<_> = all.capture.pictures.iter().map(|path| place_of(path)).collect();
        let same = |path: &PathBuf| {
            let place = place_of(path)?;
            places.iter().position(|other| other.as_ref() == Some(&place))
        };
        let same: Vec<Option<usize>> = judges.capture.pictures.iter().map(same).collect();
        if let (Some(path), None) = (&self.intensities, same.iter().copied().collect::<Option<Vec<usize>>>())
        {
            // White balance is one for all pictures: what a gain is beyond its factor.
            let intensities = read_intensity_file(path)?;
            let of_all = intensities.factors_of(all)?;
            let balance = [0, 1, 2].map(|c| f64::from(all.gains[0][c]) * of_all[0][c]);
            let of_judges = intensities.factors_of(judges)?;
            judges.gains =
                of_judges.iter().map(|factor| [0, 1, 2].map(|c| (balance[c] / factor[c]) as f32)).collect();
            return Ok(());
        }
        let is_one_for_all = all.gains.iter().all(|gain| *gain == all.gains[0]);
        judges.gains = same
            .iter()
            .zip(&judges.capture.pictures)
            .map(|(same, path)| match same {
                Some(index) => Ok(all.gains[*index]),
                None if is_one_for_all => Ok(all.gains[0]),
                None => Err(Failure::usage(format!(
                    "{}: is held out but no picture of {}, so --exposure auto can't tell its factor; give --intensities",
                    path.display(),
                    all.capture.light_file.display()
                ))),
            })
            .collect::<Result<_, _>>()?;
        Ok(())
    }
}

fn check_within(option: &str, crop: Crop, (width, height): (usize, usize)) -> Result<(), Failure> {
    if crop.is_within(width, height) {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "{option} reaches beyond the pictures of {width} x {height} pixels; give a part within them"
    )))
}

/// Exposure factors from the pictures themselves, where these show that lamps varied, with a note of what was found.
fn estimated(
    capture: &mut OpenCapture,
    machine: &Machine,
    spill_folder: &Path,
) -> Result<Option<Vec<[f64; 3]>>, Failure> {
    let full_scale = capture.full_scale(Space::Linear);
    // The sample's values and ratios.
    let kept_back = capture.infos.len() as u64 * (8192 * 3 * 4 + 4096 * 12);
    let stack = load(capture, Space::Linear, machine, kept_back, spill_folder)?;
    let found =
        exposure_factors(&stack, &capture.capture.lights.directions(), &full_scale).map_err(|error| {
            match error {
                FitError::TooFewForNormals { .. } | FitError::CoplanarLights { .. } => {
                    Failure::usage(format!("--exposure auto: {error}; or give --intensities"))
                }
                error => error.into(),
            }
        })?;
    let sample = Sample::of(&stack).map_err(FitError::from)?;
    let factors: Vec<f64> = found.iter().map(|factor| factor.unwrap_or(1.0)).collect();
    let trial = exposure_trial(&capture.capture.lights, &sample, &factors)?;
    let words = words_of_trial(&factors, trial);
    if !trial.is_some_and(ExposureTrial::is_accepted) {
        capture.capture.notes.push(words);
        return Ok(None);
    }
    let names = || capture.capture.lights.lights.iter().map(|light| light.name.as_str());
    let odd: Vec<String> = names()
        .zip(&found)
        .filter_map(|(name, factor)| Some((name, (*factor)?)))
        .filter(|(_, factor)| (factor - 1.0).abs() > NOTED)
        .map(|(name, factor)| format!("{name} {factor:.3}"))
        .collect();
    let untold: Vec<&str> =
        names().zip(&found).filter(|(_, factor)| factor.is_none()).map(|(name, _)| name).collect();
    let mut notes = vec![words];
    if !odd.is_empty() {
        notes.push(format!(
            "exposure: {} of {} pictures are more than 2 % off and are divided by their factors: {}",
            odd.len(),
            found.len(),
            odd.join(", ")
        ));
    }
    if !untold.is_empty() {
        notes.push(format!(
            "exposure: too little is lit to tell a factor, so 1 is taken: {}",
            untold.join(", ")
        ));
    }
    capture.capture.notes.extend(notes);
    Ok(Some(factors.into_iter().map(|factor| [factor; 3]).collect()))
}

/// Whether factors are taken, and why.
fn words_of_trial(factors: &[f64], trial: Option<ExposureTrial>) -> String {
    let least = factors.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = factors.iter().copied().fold(0.0, f64::max);
    let found = format!("exposure: the factors found, {least:.3} to {largest:.3},");
    let Some(trial) = trial else {
        return format!(
            "{found} are not taken: the lights are too few to tell whether they help; give --intensities"
        );
    };
    let errors = format!(
        "they change pictures by {:.2} %, and the error of predicting these from one another from {:.2} % to {:.2} %",
        100.0 * trial.variation,
        100.0 * trial.stored,
        100.0 * trial.divided
    );
    let are_alike = factors.iter().all(|factor| (factor - 1.0).abs() <= NOTED);
    match (trial.is_accepted(), are_alike) {
        (true, _) => format!("{found} are taken: {errors}"),
        (false, true) => format!("{found} are not taken: lamps were alike"),
        (false, false) => format!(
            "{found} are not taken: {errors}; flat and glossy surfaces make such factors of even lamps, --intensities \
             sets others"
        ),
    }
}

/// Mean linear light of a disc of the whole pictures, all of them together, where no channel is saturated.
fn patch(
    capture: &OpenCapture,
    (x, y, radius): (usize, usize, usize),
    size: (usize, usize),
    machine: &Machine,
    spill_folder: &Path,
) -> Result<[f64; 3], Failure> {
    let option = format!("--white-balance auto:{x},{y},{radius}");
    let edge = 2 * radius + 1;
    let beyond = || {
        Failure::usage(format!(
            "{option} reaches beyond the pictures of {} x {} pixels; give a disc within them",
            size.0, size.1
        ))
    };
    let (Some(left), Some(top)) = (x.checked_sub(radius), y.checked_sub(radius)) else {
        return Err(beyond());
    };
    let square = Crop { width: edge, height: edge, x: left, y: top };
    if !square.is_within(size.0, size.1) {
        return Err(beyond());
    }
    let mut cut = capture.clone();
    cut.crop = Some(square);
    let full_scale = cut.full_scale(Space::Linear);
    let stack = load(&cut, Space::Linear, machine, 0, spill_folder)?;
    let rows = stack.rows(0..edge * edge * 3).map_err(FitError::from)?;
    let mut values = vec![0.0f32; edge * edge * 3];
    let (mut sums, mut count) = ([0.0f64; 3], 0usize);
    for light in 0..stack.lights() {
        rows.copy(light, 0, &mut values);
        for (at, pixel) in values.chunks_exact(3).enumerate() {
            let (column, row) = ((at % edge).abs_diff(radius), (at / edge).abs_diff(radius));
            let mut limits = full_scale.iter().skip(3 * light);
            let is_saturated = pixel.iter().any(|value| limits.next().is_some_and(|limit| value >= limit));
            if column * column + row * row <= radius * radius && !is_saturated {
                sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += f64::from(*value));
                count += 1;
            }
        }
    }
    let grey = sums.map(|sum| sum / count.max(1) as f64);
    if grey.iter().any(|value| *value <= 1e-6) {
        return Err(Failure::usage(format!(
            "{option}: a channel is black or saturated in all pictures there; give a patch that is grey and lit"
        )));
    }
    Ok(grey)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balances_are_three_numbers_or_a_disc() {
        assert_eq!("0.5, 0.25,1e2".parse(), Ok(WhiteBalance::Card([0.5, 0.25, 100.0])));
        assert_eq!("auto:3,40,5".parse(), Ok(WhiteBalance::Patch { x: 3, y: 40, radius: 5 }));
        for text in [
            "",
            "1,2",
            "1,2,3,4",
            "1,x,2,3",
            "0,1,1",
            "1,nan,1",
            "-1,1,1",
            "auto:1,2",
            "auto:1,2,0",
            "auto:-1,2,3",
            "auto:1.5,2,3",
        ] {
            assert!(text.parse::<WhiteBalance>().is_err(), "{text}");
        }
    }
}
