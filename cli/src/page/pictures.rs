//! Photographs beside which the page lays what was baked.

use super::shrink::{shrunk, shrunk_length};
use crate::failure::Failure;
use crate::options::Machine;
use crate::{interrupt, progress};
use rayon::prelude::*;
use relight_core::Space;
use relight_core::relighter::Picture;
use relight_formats::{OpenCapture, PagePicture};
use std::path::Path;

/// Pictures that are considered for a page.
const MOST: usize = 128;

/// Characters of pictures in a page.
const MOST_TEXT: usize = 4 << 20;

/// Quality of JPEG at which codes are off by 1 to 3 of 255.
pub(super) const QUALITY: u8 = 90;

/// Every so many pictures of all.
#[derive(Debug)]
pub(super) struct PagePictures {
    pub(super) every: usize,
    /// JPEG by index among the fitted and then the judging pictures.
    pub(super) list: Vec<(usize, String)>,
}

/// What pictures are to be like.
#[derive(Clone, Copy, Debug)]
pub(super) struct Likeness<'a> {
    /// The space in which pixels are averaged: that of the asset's planes.
    pub(super) space: Space,
    /// Pixels along a side of one of the page's.
    pub(super) factor: usize,
    pub(super) page: &'a Path,
}

/// As many pictures of `captures`, one after another, as the bounds allow, evenly chosen.
pub(super) fn page_pictures(
    captures: &[&OpenCapture],
    likeness: Likeness<'_>,
    machine: &Machine,
) -> Result<PagePictures, Failure> {
    let all: Vec<(&OpenCapture, usize)> =
        captures.iter().flat_map(|capture| (0..capture.infos.len()).map(move |i| (*capture, i))).collect();
    let made = |&index: &usize| -> Result<(usize, String), Failure> {
        interrupt::check()?;
        let (capture, i) = all[index];
        let picture = capture.photograph(i, machine.level, machine.memory)?;
        Ok((index, jpeg_of(picture, capture.is_float(), likeness)?))
    };
    let mut every = all.len().div_ceil(MOST).max(1);
    let mut list: Vec<(usize, String)> = Vec::new();
    let bar = progress::bar("page", all.len());
    let mut next = 0;
    while next < all.len() {
        let group: Vec<usize> = (next..all.len()).step_by(every).take(at_once(&all, machine)).collect();
        list.extend(group.par_iter().map(made).collect::<Result<Vec<_>, _>>()?);
        // What exceeds the bound before the last picture does so with it, too: groups of any size end in one choice.
        while list.len() > 1 && list.iter().map(|(_, uri)| uri.len()).sum::<usize>() > MOST_TEXT {
            every *= 2;
            list.retain(|(index, _)| index % every == 0);
        }
        let last = group.last().copied().unwrap_or(next);
        next = (last + 1).next_multiple_of(every);
        bar.set_position(next.min(all.len()) as u64);
    }
    bar.finish_and_clear();
    Ok(PagePictures { every, list })
}

/// How many pictures are decoded side by side within the memory.
fn at_once(all: &[(&OpenCapture, usize)], machine: &Machine) -> usize {
    let pixels = all.iter().map(|(capture, i)| capture.infos[*i].width * capture.infos[*i].height).max();
    // As decoded, as floats, and once more in the other space.
    let picture = pixels.unwrap_or(0) as u64 * 3 * 4 * 4;
    (machine.memory / picture.max(1)).clamp(1, machine.threads as u64) as usize
}

fn jpeg_of(picture: Picture, linear: bool, likeness: Likeness<'_>) -> Result<String, Failure> {
    let Likeness { space, factor, page } = likeness;
    let picture = match (linear, space) {
        (false, Space::Linear) => picture.linear_from(Space::Encoded),
        (true, Space::Encoded) => picture.encoded_from(Space::Linear),
        _ => picture,
    };
    let Picture { width, height, channels, samples } = picture;
    let small = shrunk((width, height), channels, factor, |y, row| {
        row.copy_from_slice(&samples[y * row.len()..][..row.len()]);
    });
    let size = (shrunk_length(width, factor), shrunk_length(height, factor));
    let small = Picture { width: size.0, height: size.1, channels, samples: small }.encoded_from(space);
    let codes: Vec<u8> =
        small.samples.iter().map(|value| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect();
    Ok(PagePicture { size, channels, codes: &codes }.jpeg_uri(page, QUALITY)?)
}
