//! `.ptm` with planes in JPEG: decoding them, and putting together those that were taken off others.

use super::exact_jpeg::decode_planes;
use super::plane_prediction::restore;
use super::ptm_header::{JpegPlane, PtmFile, PtmForm, file_role};
use super::{AssetHeader, plane_bytes};
use crate::FormatError;
use relight_core::Texels;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Reads the texels of the planes in the order of `Model::roles`, one JPEG file after another.
pub(super) fn read_planes(
    path: &Path,
    ptm: &mut PtmFile,
    memory_limit: u64,
) -> Result<Vec<Texels>, FormatError> {
    let AssetHeader { width, height, model, packing } = &ptm.header;
    let PtmForm::Jpeg { planes: stored, .. } = &ptm.form else { return Ok(Vec::new()) };
    let held: u64 = packing.formats().map(|format| plane_bytes(*width, *height, model, format)).sum();
    ptm.file.seek(SeekFrom::Start(ptm.offset)).map_err(|e| FormatError::io(path, "read", e))?;
    // The plane that is being decoded is among those held.
    let left = memory_limit.saturating_sub(held).saturating_add((*width as u64) * (*height as u64));
    let mut planes = Vec::with_capacity(stored.len());
    let mut sides = Vec::with_capacity(stored.len());
    for (i, plane) in stored.iter().enumerate() {
        let needed = plane.bytes + plane.side_bytes;
        if needed > left {
            return Err(FormatError::too_large(path, held.saturating_add(needed), memory_limit));
        }
        let jpeg = read_bytes(path, &mut ptm.file, plane.bytes)?;
        let codes =
            decode_planes(&jpeg, (*width, *height), 1, path, left - needed).map_err(|e| of_plane(e, i))?;
        sides.push(read_bytes(path, &mut ptm.file, plane.side_bytes)?);
        planes.push(codes);
    }
    for i in sequence(path, stored)? {
        if let Some(reference) = stored[i].reference {
            // Out of its place, so that another can be looked at.
            let mut plane = std::mem::take(&mut planes[i]);
            restore(&mut plane, &planes[reference], stored[i].inverted);
            planes[i] = plane;
        }
        put_right(path, &mut planes[i], &sides[i], i)?;
    }
    let mut texels = vec![Texels::U8(Vec::new()); planes.len()];
    for (i, mut plane) in planes.into_iter().enumerate() {
        turn_over(&mut plane, *width);
        texels[file_role(model.layout, i)] = Texels::U8(plane);
    }
    Ok(texels)
}

fn read_bytes(path: &Path, file: &mut impl Read, count: u64) -> Result<Vec<u8>, FormatError> {
    let mut bytes = vec![0; count as usize];
    file.read_exact(&mut bytes).map_err(|e| FormatError::io(path, "read", e))?;
    Ok(bytes)
}

/// Says in which plane an error of decoding lies.
fn of_plane(error: FormatError, plane: usize) -> FormatError {
    match error {
        FormatError::Invalid { path, problem } => {
            FormatError::Invalid { path, problem: format!("plane {plane}: {problem}") }
        }
        FormatError::Unsupported { path, problem } => {
            FormatError::Unsupported { path, problem: format!("plane {plane}: {problem}") }
        }
        other => other,
    }
}

/// The planes in an order in which each comes after the one that was taken off it.
fn sequence(path: &Path, planes: &[JpegPlane]) -> Result<Vec<usize>, FormatError> {
    let (mut order, mut placed) = (Vec::with_capacity(planes.len()), vec![false; planes.len()]);
    while order.len() < planes.len() {
        let ready = |i: &usize| !placed[*i] && planes[*i].reference.is_none_or(|reference| placed[reference]);
        let Some(next) = (0..planes.len()).find(ready) else {
            let stuck = placed.iter().position(|placed| !placed).unwrap_or_default();
            let problem = format!("plane {stuck} was taken off planes that were taken off it in turn");
            return Err(FormatError::invalid(path, problem));
        };
        placed[next] = true;
        order.push(next);
    }
    Ok(order)
}

/// Writes over pixels what the side information says of them: records of a pixel (32 bits, most significant
/// byte first, counted along the rows of the JPEG) and its code.
fn put_right(path: &Path, plane: &mut [u8], side: &[u8], number: usize) -> Result<(), FormatError> {
    for record in side.chunks_exact(5) {
        let pixel = u32::from_be_bytes([record[0], record[1], record[2], record[3]]);
        let pixels = plane.len();
        match plane.get_mut(pixel as usize) {
            Some(code) => *code = record[4],
            None => {
                let problem = format!(
                    "side information of plane {number} names pixel {pixel}, outside 0..{}",
                    pixels - 1
                );
                return Err(FormatError::invalid(path, problem));
            }
        }
    }
    Ok(())
}

/// From rows that begin at the bottom to rows that begin at the top.
fn turn_over(plane: &mut [u8], width: usize) {
    let height = plane.len() / width;
    let (upper, lower) = plane.split_at_mut(height / 2 * width);
    for (a, b) in upper.chunks_exact_mut(width).zip(lower.rchunks_exact_mut(width)) {
        a.swap_with_slice(b);
    }
}
