//! `.ptm`: the reader of PTM_1.1 and PTM_1.2, of pixels as bytes; planes in JPEG are read beside it.
//!
//! Source: FORMATS.md of this project.

use super::ptm::FUNCTIONS;
use super::ptm_header::{ColorMatrix, LUM_BYTES, PtmFile, PtmForm, open};
use super::{AssetHeader, Details, plane_bytes, plane_quantizers, ptm_jpeg_reader};
use crate::FormatError;
use crate::error::check_memory;
use half::f16;
use relight_core::{RelightingMap, RelightingMaps, Texels};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Reads a `.ptm` asset; see [`super::read_asset`].
pub(super) fn read(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    let mut ptm = open(path)?;
    let AssetHeader { width, height, model, packing } = &ptm.header;
    let needed = packing.formats().map(|format| plane_bytes(*width, *height, model, format)).sum();
    check_memory(needed, memory_limit, path)?;
    let texels = match &ptm.form {
        PtmForm::Jpeg { .. } => ptm_jpeg_reader::read_planes(path, &mut ptm, memory_limit)?,
        _ => read_pixels(&mut ptm).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => FormatError::invalid(path, "is cut short"),
            _ => FormatError::io(path, "read", e),
        })?,
    };
    let planes = plane_quantizers(&ptm.header)
        .into_iter()
        .zip(texels)
        .map(|(quantizer, texels)| RelightingMap { scale: quantizer.scale, bias: quantizer.bias, texels })
        .collect();
    let AssetHeader { width, height, model, .. } = ptm.header;
    Ok(RelightingMaps { width, height, model, planes })
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    let ptm = open(path)?;
    let words =
        |word: fn(&(f32, f64)) -> String| ptm.scale_bias.iter().map(word).collect::<Vec<_>>().join(" ");
    let mut rows = vec![
        ("version".to_owned(), ptm.version.clone()),
        ("form".to_owned(), ptm.format.clone()),
        ("scales".to_owned(), words(|(scale, _)| scale.to_string())),
        ("biases".to_owned(), words(|(_, bias)| bias.to_string())),
    ];
    if let PtmForm::Jpeg { quality, planes } = &ptm.form {
        let predicted = planes.iter().filter(|plane| plane.reference.is_some()).count();
        let side_bytes: u64 = planes.iter().map(|plane| plane.side_bytes).sum();
        rows.push(("JPEG quality".to_owned(), quality.to_string()));
        rows.push(("planes from others".to_owned(), format!("{predicted} of {}", planes.len())));
        rows.push(("side information bytes".to_owned(), side_bytes.to_string()));
    }
    Ok((ptm.header, Details { rows, ..Details::default() }))
}

/// Reads the texels of the planes in the order of `Model::roles`.
fn read_pixels(ptm: &mut PtmFile) -> io::Result<Vec<Texels>> {
    let AssetHeader { width, height, model, .. } = &ptm.header;
    let (width, height) = (*width, *height);
    ptm.file.seek(SeekFrom::Start(ptm.offset))?;
    let mut file = io::BufReader::with_capacity(1 << 20, &ptm.file);
    let codes = |count: usize| vec![vec![0u8; width * height]; count];
    let planes = match &ptm.form {
        PtmForm::Lum(matrix) => {
            // A constant's texel is the coefficient over its scale.
            let scales: Vec<f32> = plane_quantizers(&ptm.header).into_iter().map(|q| q.scale).collect();
            let luminance = ptm.scale_bias[FUNCTIONS - 1];
            let halves = read_luminance(&mut file, (width, height), matrix, luminance, &scales)?;
            return Ok(halves.into_iter().map(Texels::F16).collect());
        }
        PtmForm::Lrgb { interleaved: true } => {
            let mut planes = codes(model.plane_count());
            read_block(&mut file, width, &mut planes.iter_mut().collect::<Vec<_>>())?;
            planes
        }
        PtmForm::Lrgb { interleaved: false } => {
            let mut planes = codes(model.plane_count());
            let (functions, colors) = planes.split_at_mut(FUNCTIONS);
            read_block(&mut file, width, &mut functions.iter_mut().collect::<Vec<_>>())?;
            read_block(&mut file, width, &mut colors.iter_mut().collect::<Vec<_>>())?;
            planes
        }
        PtmForm::Rgb | PtmForm::Jpeg { .. } => {
            let mut planes = codes(model.plane_count());
            for channel in 0..3 {
                read_block(
                    &mut file,
                    width,
                    &mut planes.iter_mut().skip(channel).step_by(3).collect::<Vec<_>>(),
                )?;
            }
            planes
        }
    };
    Ok(planes.into_iter().map(Texels::U8).collect())
}

/// Reads a block with a byte of each of `planes` a pixel, rows from the bottom.
fn read_block(file: &mut impl Read, width: usize, planes: &mut [&mut Vec<u8>]) -> io::Result<()> {
    let (bytes, height) = (planes.len(), planes[0].len() / width);
    let mut row = vec![0; width * bytes];
    for y in (0..height).rev() {
        file.read_exact(&mut row)?;
        for (i, plane) in planes.iter_mut().enumerate() {
            for (code, pixel) in plane[y * width..][..width].iter_mut().zip(row.chunks_exact(bytes)) {
                *code = pixel[i];
            }
        }
    }
    Ok(())
}

/// Reads luminance functions and chrominance as planes of R, G, B: their texels.
///
/// R = m0 Y + m1 Cr + m2 Cb + m3 and Y = sum of coefficient x term, so that R's coefficients are m0 times
/// those of Y, and its constant has the rest besides.
fn read_luminance(
    file: &mut impl Read,
    (width, height): (usize, usize),
    matrix: &ColorMatrix,
    (scale, bias): (f32, f64),
    scales: &[f32],
) -> io::Result<Vec<Vec<f16>>> {
    let mut planes = vec![vec![f16::ZERO; width * height]; 3 * FUNCTIONS];
    let mut row = vec![0; width * LUM_BYTES];
    for y in (0..height).rev() {
        file.read_exact(&mut row)?;
        for (x, pixel) in row.chunks_exact(LUM_BYTES).enumerate() {
            let at = y * width + x;
            let constant = FUNCTIONS - 1;
            for (j, &code) in pixel[..constant].iter().enumerate() {
                for plane in &mut planes[3 * j..][..3] {
                    plane[at] = f16::from(code);
                }
            }
            let [luminance, cr, cb] = [0, 1, 2].map(|i| f64::from(pixel[constant + i]));
            let luminance = (luminance - bias) * f64::from(scale);
            for (channel, m) in matrix.iter().enumerate() {
                let role = 3 * constant + channel;
                let value = (m[0] * luminance + m[1] * cr + m[2] * cb + m[3]) / 255.0;
                planes[role][at] = f16::from_f64(value / f64::from(scales[role]));
            }
        }
    }
    Ok(planes)
}
