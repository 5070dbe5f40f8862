//! A capture opened for work: its lights matched to pictures whose headers were read and agree.

use crate::FormatError;
use crate::content::content_hash;
use crate::crop::Crop;
use crate::gain::Gain;
use crate::light_file::{Capture, light_file_in, match_pictures, read_light_file};
use crate::picture::{PictureInfo, decode, probe};
use rayon::prelude::*;
use relight_core::relighter::Picture;
use relight_core::{CpuLevel, Space};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::Path;

/// A capture, what its pictures' headers say, and what is to be made of the pictures.
#[derive(Clone, Debug)]
pub struct OpenCapture {
    /// Lights and pictures, in the order of the light file.
    pub capture: Capture,
    /// The pictures' headers, in the same order; all of one size, all integer or all float.
    pub infos: Vec<PictureInfo>,
    /// The part of every picture that is used, within them; `None` for all of it.
    pub crop: Option<Crop>,
    /// What the linear light of each picture's channels is multiplied by when values are taken from it, in the same order,
    /// finite and above 0 (the first alone counts for grey ones); empty where pictures are used as stored.
    pub gains: Vec<[f32; 3]>,
    /// The place of each picture in the light file, from 0: other orders keep it.
    pub listed: Vec<usize>,
}

/// Opens the `.lp` file `input`, or the one in folder `input`.
///
/// # Errors
/// [`FormatError`] when the light file is damaged, a picture is missing, or the pictures differ in
/// size, mix integers with floats, or are turned in different ways.
pub fn open_capture(input: &Path) -> Result<OpenCapture, FormatError> {
    let file = read_light_file(&light_file_in(input)?)?;
    let mut capture = match_pictures(&file)?;
    let infos = capture.pictures.par_iter().map(|path| probe(path)).collect::<Result<Vec<_>, _>>()?;
    let notes = check_headers(&capture, &infos)?;
    capture.notes.extend(notes);
    let listed = (0..infos.len()).collect();
    Ok(OpenCapture { capture, infos, crop: None, gains: Vec::new(), listed })
}

impl OpenCapture {
    /// Width and height of what is used of each picture, in pixels.
    pub fn size(&self) -> (usize, usize) {
        let whole = self.infos.first().map_or((0, 0), |info| (info.width, info.height));
        self.crop.map_or(whole, |crop| (crop.width, crop.height))
    }

    /// Indices of the pictures in the order of the light file.
    pub fn as_listed(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.listed.len()).collect();
        order.sort_by_key(|&i| self.listed[i]);
        order
    }

    /// Channels of the pictures once they are alike: 1 or 3.
    pub fn channels(&self) -> usize {
        self.infos.iter().map(|info| info.channels).max().unwrap_or(1)
    }

    /// The values in `space` at which pictures saturate, for each picture those of its [`OpenCapture::channels`]; empty
    /// for floats, which don't.
    pub fn full_scale(&self, space: Space) -> Vec<f32> {
        if self.is_float() {
            return Vec::new();
        }
        let channels = self.channels();
        let mut values = vec![1.0; self.infos.len() * channels];
        for (values, factors) in values.chunks_exact_mut(channels).zip(&self.gains) {
            if let Some(gain) = Gain::new(*factors, channels, space) {
                (0..channels).for_each(|channel| values[channel] = gain.full_scale(channel));
            }
        }
        values
    }

    /// Decodes picture `index`: its part and its gains, as values of its own space (encoded for integers, linear for floats).
    ///
    /// `memory_limit` bounds the decoder, in bytes.
    ///
    /// # Errors
    /// As [`decode`], and when the picture is another than its header said.
    ///
    /// # Panics
    /// When there is no picture `index`.
    pub fn photograph(
        &self,
        index: usize,
        level: CpuLevel,
        memory_limit: u64,
    ) -> Result<Picture, FormatError> {
        let path = &self.capture.pictures[index];
        let picture = decode(path, level, memory_limit)?;
        if picture.info != self.infos[index] {
            return Err(FormatError::changed(path));
        }
        let channels = picture.info.channels;
        let space = if self.is_float() { Space::Linear } else { Space::Encoded };
        let kept = match self.crop {
            Some(crop) => crop.of_samples(&picture.samples, picture.info.width, channels),
            None => picture.samples,
        };
        let (width, height) = self.size();
        let mut samples = vec![0.0; width * height * channels];
        match self.gains.get(index).and_then(|factors| Gain::new(*factors, channels, space)) {
            Some(gain) => gain.copy(&kept, level, 0, 0, &mut samples),
            None => kept.copy_to(space, level, 0, &mut samples),
        }
        Ok(Picture { width, height, channels, samples })
    }

    /// Whether the pictures hold floats (linear light) rather than sRGB-encoded integers.
    pub fn is_float(&self) -> bool {
        self.infos.iter().any(|info| info.sample_type.is_float())
    }

    /// Whether all pictures have one channel.
    pub fn is_grey(&self) -> bool {
        self.infos.iter().all(|info| info.channels == 1)
    }

    /// The same capture with only the pictures at `indices`.
    ///
    /// # Panics
    /// When an index is out of range.
    pub fn select(&self, indices: &[usize]) -> Self {
        let capture = Capture {
            light_file: self.capture.light_file.clone(),
            lights: relight_core::LightSet {
                lights: indices.iter().map(|&i| self.capture.lights.lights[i].clone()).collect(),
            },
            pictures: indices.iter().map(|&i| self.capture.pictures[i].clone()).collect(),
            vectors: indices.iter().map(|&i| self.capture.vectors[i]).collect(),
            notes: Vec::new(),
        };
        Self {
            capture,
            infos: indices.iter().map(|&i| self.infos[i].clone()).collect(),
            crop: self.crop,
            gains: if self.gains.is_empty() {
                Vec::new()
            } else {
                indices.iter().map(|&i| self.gains[i]).collect()
            },
            listed: indices.iter().map(|&i| self.listed[i]).collect(),
        }
    }

    /// The same capture in the order of its lights' directions, of pictures under one light in that of their contents: what is
    /// computed of it does not depend on the order of the light file.
    ///
    /// # Errors
    /// [`FormatError::Io`] for a picture under the light of another that can't be read.
    pub fn by_direction(&self) -> Result<Self, FormatError> {
        let direction = |i: usize| self.capture.lights.lights[i].direction.components();
        let compare = |a: usize, b: usize| {
            let pairs = direction(a).into_iter().zip(direction(b));
            pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
        };
        let mut order: Vec<usize> = (0..self.infos.len()).collect();
        order.sort_by(|&a, &b| compare(a, b));
        for alike in order.chunk_by_mut(|&a, &b| compare(a, b).is_eq()).filter(|alike| alike.len() > 1) {
            let mut keyed = alike
                .iter()
                .map(|&i| Ok((content_hash(&self.capture.pictures[i])?, i)))
                .collect::<Result<Vec<_>, FormatError>>()?;
            keyed.sort_unstable();
            alike.iter_mut().zip(keyed).for_each(|(place, (_, i))| *place = i);
        }
        let mut sorted = self.select(&order);
        sorted.capture.notes.clone_from(&self.capture.notes);
        Ok(sorted)
    }
}

/// Checks that the pictures go together; what is worth saying comes back.
fn check_headers(capture: &Capture, infos: &[PictureInfo]) -> Result<Vec<String>, FormatError> {
    let pairs = || capture.pictures.iter().zip(infos);
    let Some((first_path, first)) = pairs().next() else { return Ok(Vec::new()) };
    for (path, info) in pairs() {
        if (info.width, info.height) != (first.width, first.height) {
            let problem = format!(
                "is {} x {} pixels where {} is {} x {}; a capture needs pictures of one size, so crop or rescale",
                info.width,
                info.height,
                first_path.display(),
                first.width,
                first.height
            );
            return Err(FormatError::invalid(path, problem));
        }
        if info.sample_type.is_float() != first.sample_type.is_float() {
            let kind = |float| if float { "floats (linear)" } else { "integers (encoded)" };
            let problem = format!(
                "holds {} where {} holds {}; convert one kind to the other",
                kind(info.sample_type.is_float()),
                first_path.display(),
                kind(first.sample_type.is_float())
            );
            return Err(FormatError::invalid(path, problem));
        }
        if info.orientation != first.orientation {
            let problem = format!(
                "has EXIF orientation {} where {} has {}; turn the pixels alike in all pictures",
                info.orientation.unwrap_or(1),
                first_path.display(),
                first.orientation.unwrap_or(1)
            );
            return Err(FormatError::invalid(path, problem));
        }
    }
    let mut notes = Vec::new();
    let count = |test: fn(&PictureInfo) -> bool| infos.iter().filter(|info| test(info)).count();
    let alpha = count(|info| info.alpha);
    if alpha > 0 {
        notes.push(format!("{alpha} of {} pictures have an alpha channel, which is ignored", infos.len()));
    }
    let grey = count(|info| info.channels == 1);
    if grey > 0 && grey < infos.len() {
        notes.push(format!("{grey} of {} pictures are grey and are taken as R = G = B", infos.len()));
    }
    if let Some(turned) = first.orientation {
        notes.push(format!("EXIF orientation {turned} is ignored: pixels and lights are used as stored"));
    }
    let mut profiles = BTreeMap::new();
    for profile in infos.iter().filter_map(|info| info.color_profile.as_deref()) {
        *profiles.entry(profile).or_insert(0) += 1;
    }
    for (profile, pictures) in profiles {
        notes.push(format!(
            "{pictures} pictures carry the colour profile '{profile}': values are used as stored, so relit \
             pictures are in that profile and not tagged with it"
        ));
    }
    Ok(notes)
}
