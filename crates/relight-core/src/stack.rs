//! The pictures of a capture as the fitter sees them: rows of samples, one row per light.

use std::fmt;
use std::ops::Range;

/// Why samples could not be had: the store behind the stack failed.
#[derive(Debug)]
pub struct StackError {
    /// What was being done, with the file's name.
    pub context: String,
    /// The operating system's word.
    pub source: std::io::Error,
}

impl fmt::Display for StackError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.context)
    }
}

impl std::error::Error for StackError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.source)
    }
}

/// All pictures of a capture, same size and channels, in light order.
///
/// A *sample* is one channel of one pixel; sample `s` of a picture is channel `s % channels` of
/// pixel `s / channels`, pixels in rows from the top left.
pub trait Stack: Sync {
    /// Number of pictures.
    fn lights(&self) -> usize;
    /// Pixels in a row.
    fn width(&self) -> usize;
    /// Rows.
    fn height(&self) -> usize;
    /// 1 (grey) or 3 (R, G, B).
    fn channels(&self) -> usize;

    /// Makes `samples` of every picture readable: those spilled to disk are read back.
    ///
    /// # Errors
    /// [`StackError`] when a spilled picture can't be read back.
    ///
    /// # Panics
    /// When `samples` lies outside the pictures.
    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError>;

    /// Pixels of one picture.
    fn pixels(&self) -> usize {
        self.width() * self.height()
    }
}

impl<S: Stack + ?Sized> Stack for &S {
    fn lights(&self) -> usize {
        (**self).lights()
    }

    fn width(&self) -> usize {
        (**self).width()
    }

    fn height(&self) -> usize {
        (**self).height()
    }

    fn channels(&self) -> usize {
        (**self).channels()
    }

    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
        (**self).rows(samples)
    }
}

/// A run of samples of all pictures, side by side.
pub trait StackRows {
    /// Writes samples `first .. first + out.len()` of picture `light`, counted from the run's
    /// start, as f32 in fitting space (0..1 for integer pictures).
    ///
    /// # Panics
    /// When `light` or the samples lie outside the run.
    fn copy(&self, light: usize, first: usize, out: &mut [f32]);
}
