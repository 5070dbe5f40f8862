//! The pictures of a capture in memory, the rest in an unlinked temporary file.
//!
//! Each picture is decoded once and kept as stored (8-bit pictures take 1 byte a sample); what
//! exceeds the memory allowed is written to the temporary file whole and read back span by span.

use crate::FormatError;
use crate::capture_folder::OpenCapture;
use crate::gain::{GAIN_BYTES, Gain};
use crate::picture::{PictureInfo, SampleType, Samples, decode};
use crate::positioned::{read_exact_at, write_all_at};
use rayon::prelude::*;
use relight_core::{CpuLevel, Space, Stack, StackError, StackRows};
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// How a stack is loaded.
pub struct StackSettings<'a> {
    /// Values are handed out in this space; integer pictures are taken to be sRGB-encoded, float
    /// pictures to be linear.
    pub space: Space,
    /// Bytes that the process may take.
    pub memory: u64,
    /// Bytes of these that others need beside the stack.
    pub kept_back: u64,
    /// Pictures decoded at a time, at most.
    pub threads: usize,
    /// Where the temporary file goes when the memory does not suffice.
    pub spill_folder: &'a Path,
    /// Instruction set of the decoders.
    pub level: CpuLevel,
    /// Set from outside to call the work off.
    pub cancel: &'a AtomicBool,
    /// Called after each picture with the number done so far.
    pub progress: &'a (dyn Fn(usize) + Sync),
}

/// A capture's pictures, decoded.
pub struct PictureStack {
    width: usize,
    height: usize,
    channels: usize,
    space: Space,
    level: CpuLevel,
    pictures: Vec<Place>,
    /// One a picture, `None` where samples are taken as they are; empty where all are.
    gains: Vec<Option<Gain>>,
    spill: Option<File>,
    spill_folder: PathBuf,
}

/// Where a picture's samples are.
enum Place {
    Memory(Samples),
    Spilled { offset: u64, sample_type: SampleType },
}

/// What a decoder holds for each byte of the picture: the picture, its file, and for progressive
/// JPEG two bytes a coefficient.
pub const DECODER_SHARE: u64 = 4;

/// What the smallest decoder is allowed.
const DECODER_LEAST: u64 = 4 << 20;

/// Memory kept back for code, tables and the allocator.
pub const RESERVE: u64 = 48 << 20;

impl PictureStack {
    /// Decodes the pictures of `capture`, keeps the part that it asks for, and hands values out with its gains.
    ///
    /// # Errors
    /// [`FormatError`] naming the picture that can't be read; [`FormatError::TooLarge`] when not
    /// even one decoder fits the memory; [`FormatError::Cancelled`].
    pub fn load(capture: &OpenCapture, settings: &StackSettings<'_>) -> Result<Self, FormatError> {
        let (paths, infos) = (&capture.capture.pictures, &capture.infos);
        let (width, height) = capture.size();
        let channels = infos.iter().map(|info| info.channels).max().unwrap_or(1);
        let largest = infos.iter().map(PictureInfo::bytes).max().unwrap_or(0);
        let decoder = (largest * DECODER_SHARE).max(DECODER_LEAST);
        let kept_back = settings.kept_back.saturating_add(capture.gains.len() as u64 * GAIN_BYTES);
        let available = settings.memory.saturating_sub(kept_back.saturating_add(RESERVE));
        if decoder > available {
            let path = paths.first().and_then(|path| path.parent()).unwrap_or(Path::new(""));
            return Err(FormatError::too_large(
                path,
                kept_back.saturating_add(decoder + RESERVE),
                settings.memory,
            ));
        }
        // A quarter for decoders, so that most of the memory holds pictures.
        let decoders = (available / 4 / decoder.max(1)).clamp(1, settings.threads.max(1) as u64) as usize;
        let room = AtomicU64::new(available - decoder * decoders as u64);

        let spill = Spill { folder: settings.spill_folder, file: Mutex::new(None), end: AtomicU64::new(0) };
        let done = AtomicUsize::new(0);
        let next = AtomicUsize::new(0);
        let places: Vec<Mutex<Option<Place>>> = paths.iter().map(|_| Mutex::new(None)).collect();
        let worker = |_| -> Result<(), FormatError> {
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(path) = paths.get(i) else { return Ok(()) };
                if settings.cancel.load(Ordering::Relaxed) {
                    return Err(FormatError::Cancelled);
                }
                let picture = decode(path, settings.level, decoder)?;
                if picture.info != infos[i] {
                    return Err(FormatError::changed(path));
                }
                let samples = match capture.crop {
                    Some(crop) => {
                        crop.of_samples(&picture.samples, picture.info.width, picture.info.channels)
                    }
                    None => picture.samples,
                };
                let samples = samples.widened(picture.info.channels, channels);
                let bytes = samples.bytes();
                let fits =
                    room.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |room| room.checked_sub(bytes));
                let place = match fits {
                    Ok(_) => Place::Memory(samples),
                    Err(_) => spill.write(&samples)?,
                };
                *places[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(place);
                (settings.progress)(done.fetch_add(1, Ordering::Relaxed) + 1);
            }
        };
        (0..decoders).into_par_iter().with_max_len(1).try_for_each(worker)?;
        let pictures = places
            .into_iter()
            .filter_map(|place| place.into_inner().unwrap_or_else(PoisonError::into_inner))
            .collect();
        let file = spill.file.into_inner().unwrap_or_else(PoisonError::into_inner);
        let spill_folder = settings.spill_folder.to_owned();
        let (space, level) = (settings.space, settings.level);
        let gains = capture.gains.iter().map(|factors| Gain::new(*factors, channels, space)).collect();
        Ok(Self { width, height, channels, space, level, pictures, gains, spill: file, spill_folder })
    }

    /// Bytes in the temporary file.
    pub fn spilled_bytes(&self) -> u64 {
        let spilled = self.pictures.iter().filter(|place| matches!(place, Place::Spilled { .. })).count();
        let samples = (self.pixels() * self.channels) as u64;
        let size = self.pictures.iter().map(|place| place.sample_type().bytes() as u64).max().unwrap_or(0);
        spilled as u64 * samples * size
    }
}

/// The temporary file, made when the first picture needs it.
struct Spill<'a> {
    folder: &'a Path,
    file: Mutex<Option<File>>,
    end: AtomicU64,
}

impl Spill<'_> {
    fn write(&self, samples: &Samples) -> Result<Place, FormatError> {
        let failed = |source| {
            FormatError::io(self.folder, "write a temporary file (set TMPDIR or raise --memory) in", source)
        };
        let offset = self.end.fetch_add(samples.bytes(), Ordering::Relaxed);
        let file = {
            let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
            let opened = match file.take() {
                Some(opened) => opened,
                None => tempfile::tempfile_in(self.folder).map_err(failed)?,
            };
            file.insert(opened).try_clone().map_err(failed)?
        };
        write_all_at(&file, offset, samples.as_bytes()).map_err(failed)?;
        Ok(Place::Spilled { offset, sample_type: samples.sample_type() })
    }
}

impl Place {
    fn sample_type(&self) -> SampleType {
        match self {
            Self::Memory(samples) => samples.sample_type(),
            Self::Spilled { sample_type, .. } => *sample_type,
        }
    }
}

impl Stack for PictureStack {
    fn lights(&self) -> usize {
        self.pictures.len()
    }

    fn width(&self) -> usize {
        self.width
    }

    fn height(&self) -> usize {
        self.height
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
        let row = |place: &'_ Place| match place {
            // Reborrowed below: a row in memory is no copy.
            Place::Memory(_) => Ok(None),
            Place::Spilled { offset, sample_type } => {
                let mut row = Samples::zeroed(*sample_type, samples.len());
                let at = offset + (samples.start * sample_type.bytes()) as u64;
                let file = self.spill.as_ref().ok_or_else(|| std::io::Error::other("no temporary file"));
                file.and_then(|file| read_exact_at(file, at, row.as_bytes_mut())).map_err(|source| {
                    StackError {
                        context: format!(
                            "cannot read back a temporary file in {}",
                            self.spill_folder.display()
                        ),
                        source,
                    }
                })?;
                Ok(Some(row))
            }
        };
        let spilled = self.pictures.iter().map(row).collect::<Result<Vec<_>, _>>()?;
        Ok(Box::new(SpanRows { stack: self, start: samples.start, spilled }))
    }
}

/// A span of all pictures: views of those in memory, copies of those read back.
struct SpanRows<'a> {
    stack: &'a PictureStack,
    start: usize,
    spilled: Vec<Option<Samples>>,
}

impl StackRows for SpanRows<'_> {
    fn copy(&self, light: usize, first: usize, out: &mut [f32]) {
        let PictureStack { space, level, channels, .. } = *self.stack;
        let channel = (self.start + first) % channels;
        let (samples, first) = match (&self.stack.pictures[light], &self.spilled[light]) {
            (Place::Memory(samples), _) => (samples, self.start + first),
            (Place::Spilled { .. }, Some(samples)) => (samples, first),
            (Place::Spilled { .. }, None) => unreachable!("every spilled row was read back"),
        };
        match self.stack.gains.get(light) {
            Some(Some(gain)) => gain.copy(samples, level, first, channel, out),
            _ => samples.copy_to(space, level, first, out),
        }
    }
}
