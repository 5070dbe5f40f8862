//! The part of each picture that is used.

use crate::picture::Samples;
use std::fmt;
use std::str::FromStr;

/// A rectangle of pixels, written `WxH+X+Y`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Pixels in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// Columns left of it.
    pub x: usize,
    /// Rows above it.
    pub y: usize,
}

impl FromStr for Crop {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = || {
            let (width, rest) = text.split_once(['x', 'X'])?;
            let (height, rest) = rest.split_once('+')?;
            let (x, y) = rest.split_once('+')?;
            let number = |text: &str| {
                text.parse::<u32>().ok().filter(|_| !text.starts_with('+')).map(|number| number as usize)
            };
            Some(Self { width: number(width)?, height: number(height)?, x: number(x)?, y: number(y)? })
        };
        parsed().filter(|crop| crop.width > 0 && crop.height > 0).ok_or_else(|| {
            "write WxH+X+Y in whole pixels from the upper left corner, at least 1x1, such as 640x480+100+20"
                .to_owned()
        })
    }
}

impl fmt::Display for Crop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}+{}+{}", self.width, self.height, self.x, self.y)
    }
}

impl Crop {
    /// Whether it lies within pictures of `width` x `height` pixels.
    pub fn is_within(&self, width: usize, height: usize) -> bool {
        self.x + self.width <= width && self.y + self.height <= height
    }

    /// Its part of `values`, `channels` a pixel, rows of `width` pixels from the top.
    ///
    /// # Panics
    /// When it reaches beyond them.
    pub fn part_of<T: Copy>(&self, values: &[T], width: usize, channels: usize) -> Vec<T> {
        let mut part = Vec::with_capacity(self.width * self.height * channels);
        for row in values.chunks_exact(width * channels).skip(self.y).take(self.height) {
            part.extend_from_slice(&row[self.x * channels..(self.x + self.width) * channels]);
        }
        assert_eq!(part.len(), self.width * self.height * channels, "a part within the picture");
        part
    }

    /// Its part of a picture's samples, as [`Crop::part_of`].
    pub(crate) fn of_samples(&self, samples: &Samples, width: usize, channels: usize) -> Samples {
        match samples {
            Samples::U8(codes) => Samples::U8(self.part_of(codes, width, channels)),
            Samples::U16(codes) => Samples::U16(self.part_of(codes, width, channels)),
            Samples::F16(halves) => Samples::F16(self.part_of(halves, width, channels)),
            Samples::F32(floats) => Samples::F32(self.part_of(floats, width, channels)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_are_written_as_in_image_tools() {
        assert_eq!("12x3+4+0".parse(), Ok(Crop { width: 12, height: 3, x: 4, y: 0 }));
        for text in
            ["", "12x3", "12x3+4", "0x3+1+1", "3x0+1+1", "1x1+-1+0", "1x1+1+1+1", "1.5x1+0+0", "+1x1+0+0"]
        {
            assert!(text.parse::<Crop>().is_err(), "{text}");
        }
        let largest = "4294967295x4294967295+4294967295+4294967295".parse::<Crop>().unwrap();
        assert!(!largest.is_within(1 << 31, 1 << 31));
    }

    #[test]
    fn a_part_keeps_rows_columns_and_channels_apart() {
        let values: Vec<u16> = (0..5 * 4 * 3).collect();
        let crop = Crop { width: 2, height: 3, x: 3, y: 1 };
        let expected: Vec<u16> = [1, 2, 3].iter().flat_map(|y| (y * 15 + 9)..(y * 15 + 15)).collect();
        assert_eq!(crop.part_of(&values, 5, 3), expected);
        assert!(crop.is_within(5, 4) && !crop.is_within(4, 4) && !crop.is_within(5, 3));
    }
}
