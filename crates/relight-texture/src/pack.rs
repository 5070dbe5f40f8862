//! The packer: coefficients in, texels of every layer and mip level out, with what storing them cost.
//!
//! It knows where a texel lies within its layer, not where layers lie in a file: that is the
//! container's business. Working memory is a span a thread and, with mips, the planes of level 1.

use crate::mips::{halve, halve_rows};
use crate::texels::{Place, Row, TexelBuffer};
use crate::{
    BlockCoding, BlockFormat, LayerPlan, Packing, Precision, TexelFormat, decode_blocks, encode_blocks, level_size,
};
use half::f16;
use rayon::prelude::*;
use relight_core::{CoefficientSpan, Layout, Model};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Pixels that are turned into plain texels at a time: their texels stay in the L2 cache.
const PIECE: usize = 4096;

/// Pixels of a span that need not be whole rows of blocks.
const SPAN: usize = 8192;

/// How texels are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coding {
    /// How blocks are searched.
    pub blocks: BlockCoding,
    /// Whether 8-bit codes are dithered by an ordered pattern.
    pub dither: bool,
}

/// Where bytes belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelPlace {
    /// Index of the array.
    pub array: usize,
    /// Mip level, 0 the picture itself.
    pub level: usize,
    /// Index of the layer in its array.
    pub layer: usize,
    /// Bytes from the start of that layer in that level.
    pub offset: u64,
}

/// What storing cost.
#[derive(Clone, Debug, PartialEq)]
pub struct PackReport {
    /// Root mean square error of the stored coefficients of each plane, in the order of
    /// [`Model::roles`], over all pixels of level 0.
    pub rmse: Vec<f64>,
}

/// Takes runs of coefficients, in any order and from many threads, and hands texels on.
pub struct Packer {
    width: usize,
    height: usize,
    layout: Layout,
    functions: usize,
    packing: Packing,
    coding: Coding,
    written: AtomicUsize,
    /// Sums of squared errors by plane of the runs so far, with each run's first pixel: added up
    /// in the order of pixels, so that the figures don't depend on threads.
    errors: Mutex<Vec<(usize, Vec<f64>)>>,
    /// Planes of level 1, where there is one.
    halved: Option<Mutex<Vec<Vec<f32>>>>,
}

/// Pixels of a run such that [`Packer::write`] takes it: whole rows of blocks where the packing has
/// blocks or mips, about 8,192 otherwise.
pub fn span_pixels(width: usize, packing: &Packing) -> usize {
    if !packing.needs_rows() {
        return SPAN;
    }
    let rows = (SPAN / (4 * width)).max(1) * 4;
    rows * width
}

/// Bytes that a packer holds beside its spans: the planes of mip levels 1 and 2.
pub fn held_bytes(width: usize, height: usize, planes: usize, levels: usize) -> u64 {
    (1..levels.min(3))
        .map(|level| 4 * planes as u64 * level_size(width, level) as u64 * level_size(height, level) as u64)
        .sum()
}

impl Packer {
    /// A packer of `width` x `height` pixels of `model` by `packing`.
    ///
    /// # Panics
    /// When the packing does not hold every plane of the model once.
    pub fn new(width: usize, height: usize, model: &Model, packing: Packing, coding: Coding) -> Self {
        let mut planes: Vec<usize> =
            packing.arrays.iter().flat_map(|a| &a.layers).flat_map(|layer| layer.planes.clone()).collect();
        planes.sort_unstable();
        assert!(planes.into_iter().eq(0..model.plane_count()), "every plane once");
        let halved = (packing.levels > 1).then(|| {
            let texels = level_size(width, 1) * level_size(height, 1);
            Mutex::new(vec![vec![0.0; texels]; model.plane_count()])
        });
        Self {
            width,
            height,
            layout: model.layout,
            functions: model.basis.count(),
            packing,
            coding,
            written: AtomicUsize::new(0),
            errors: Mutex::new(Vec::new()),
            halved,
        }
    }

    /// Pixels that came so far.
    pub fn written(&self) -> usize {
        self.written.load(Ordering::Relaxed)
    }

    /// Turns a run into texels and hands them to `put`. Each pixel comes once; where
    /// [`Packing::needs_rows`] says so the run is whole rows, from a multiple of 4 on, a multiple
    /// of 4 in number unless it is the last.
    ///
    /// # Errors
    /// The first of `put`.
    ///
    /// # Panics
    /// When the span leaves the map, does not have its shapes or is not whole rows where it has to
    /// be.
    pub fn write<E>(
        &self,
        span: &CoefficientSpan<'_>,
        put: &dyn Fn(TexelPlace, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let planes = self.planes_of(span);
        let mut errors = vec![0.0; planes.len()];
        let level = Level { index: 0, width: self.width, first: span.first, pixels: span.pixels };
        self.for_each_layer(|place, format, layer| {
            self.put_layer(place, format, layer, &planes, level, Some(&mut errors), put)
        })?;
        if let Some(halved) = &self.halved {
            self.add_to_level_1(halved, &planes, span);
        }
        let mut all = self.errors.lock().unwrap_or_else(PoisonError::into_inner);
        all.push((span.first, errors));
        drop(all);
        self.written.fetch_add(span.pixels, Ordering::Relaxed);
        Ok(())
    }

    /// Makes the remaining mip levels and says what storing cost.
    ///
    /// # Errors
    /// The first of `put`.
    ///
    /// # Panics
    /// When pixels are missing.
    pub fn finish<E: Send>(
        mut self,
        put: &(dyn Fn(TexelPlace, &[u8]) -> Result<(), E> + Sync),
    ) -> Result<PackReport, E> {
        let pixels = self.width * self.height;
        assert_eq!(self.written(), pixels, "every pixel");
        let mut planes = self.halved.take().map(Mutex::into_inner).map(|p| p.unwrap_or_else(PoisonError::into_inner));
        for level in 1..self.packing.levels {
            let (width, height) = (level_size(self.width, level), level_size(self.height, level));
            let Some(halved) = &mut planes else { break };
            let level = Level { index: level, width, first: 0, pixels: width * height };
            let rows: Vec<_> =
                halved.iter().map(|plane| Row { samples: plane, stride: 1, channel: 0 }).collect();
            self.layers().into_par_iter().try_for_each(|(place, format, layer)| {
                let place = TexelPlace { level: level.index, ..place };
                self.put_layer(place, format, layer, &rows, level, None, put)
            })?;
            if level.index + 1 < self.packing.levels {
                halved.par_iter_mut().for_each(|plane| *plane = halve(plane, width, height));
            }
        }
        let mut errors = std::mem::take(&mut *self.errors.lock().unwrap_or_else(PoisonError::into_inner));
        errors.sort_by_key(|(first, _)| *first);
        let planes = errors.first().map_or(0, |(_, sums)| sums.len());
        let rmse = (0..planes)
            .map(|plane| (errors.iter().map(|(_, sums)| sums[plane]).sum::<f64>() / pixels as f64).sqrt())
            .collect();
        Ok(PackReport { rmse })
    }

    fn layers(&self) -> Vec<(TexelPlace, TexelFormat, &LayerPlan)> {
        let arrays = self.packing.arrays.iter().enumerate();
        arrays
            .flat_map(|(array, plan)| {
                plan.layers.iter().enumerate().map(move |(layer, layer_plan)| {
                    (TexelPlace { array, level: 0, layer, offset: 0 }, plan.format, layer_plan)
                })
            })
            .collect()
    }

    fn for_each_layer<E>(
        &self,
        mut work: impl FnMut(TexelPlace, TexelFormat, &LayerPlan) -> Result<(), E>,
    ) -> Result<(), E> {
        self.layers().into_iter().try_for_each(|(place, format, layer)| work(place, format, layer))
    }

    /// The planes of a run, in the order of [`Model::roles`].
    fn planes_of<'a>(&self, span: &CoefficientSpan<'a>) -> Vec<Row<'a>> {
        let stride = self.layout.planes_per_function();
        let base = if self.layout == Layout::Lrgb { 3 } else { 0 };
        assert!(span.first + span.pixels <= self.width * self.height, "the span leaves the map");
        assert_eq!(span.functions.len(), self.functions * span.pixels * stride, "functions");
        assert_eq!(span.base_color.len(), base * span.pixels, "base colour");
        if self.packing.needs_rows() {
            let (row, last) = (4 * self.width, span.first + span.pixels == self.width * self.height);
            assert!(span.first.is_multiple_of(row), "a span begins at a row of blocks");
            assert!(last || span.pixels.is_multiple_of(row), "a span is whole rows of blocks");
        }
        let functions = span.functions.chunks_exact((span.pixels * stride).max(1));
        let of = |samples: &'a [f32], stride| (0..stride).map(move |channel| Row { samples, stride, channel });
        functions.flat_map(|samples| of(samples, stride)).chain(of(span.base_color, base)).collect()
    }

    #[expect(clippy::too_many_arguments, reason = "one layer of one run: what, how, from where, to where")]
    fn put_layer<E>(
        &self,
        place: TexelPlace,
        format: TexelFormat,
        layer: &LayerPlan,
        planes: &[Row<'_>],
        level: Level,
        errors: Option<&mut [f64]>,
        put: &dyn Fn(TexelPlace, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let rows: Vec<Row<'_>> = layer.planes.iter().map(|&plane| planes[plane]).collect();
        match format {
            TexelFormat::Plain { precision, channels } => {
                self.put_plain(place, (precision, channels), layer, &rows, level, errors, put)
            }
            TexelFormat::Block(format) => self.put_blocks(place, format, layer, &rows, level, errors, put),
        }
    }

    #[expect(clippy::too_many_arguments, reason = "as `put_layer`")]
    fn put_plain<E>(
        &self,
        place: TexelPlace,
        (precision, channels): (Precision, usize),
        layer: &LayerPlan,
        rows: &[Row<'_>],
        level: Level,
        mut errors: Option<&mut [f64]>,
        put: &dyn Fn(TexelPlace, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut buffer = TexelBuffer::default();
        for start in (0..level.pixels).step_by(PIECE) {
            let end = (start + PIECE).min(level.pixels);
            let rows: Vec<_> = rows.iter().map(|row| row.slice(start, end)).collect();
            let first = level.first + start;
            let dither =
                self.coding.dither.then_some(Place { first, width: level.width, planes: &layer.planes });
            let bytes = buffer.texels((precision, channels), &rows, &layer.quantizers, dither);
            if let Some(errors) = errors.as_deref_mut() {
                for (channel, row) in rows.iter().enumerate() {
                    let quantizer = layer.quantizers[channel];
                    let texel_bytes = channels * precision.bytes();
                    let texels = bytes[channel * precision.bytes()..].chunks(texel_bytes);
                    errors[layer.planes[channel]] += match precision {
                        Precision::U8 => squared_error(*row, texels.map(|t| f32::from(t[0]) / 255.0), quantizer),
                        Precision::F16 => {
                            squared_error(*row, texels.map(|t| f16::from_le_bytes([t[0], t[1]]).to_f32()), quantizer)
                        }
                        Precision::F32 => 0.0,
                    };
                }
            }
            let offset = (first * channels * precision.bytes()) as u64;
            put(TexelPlace { offset, ..place }, bytes)?;
        }
        Ok(())
    }

    #[expect(clippy::too_many_arguments, reason = "as `put_layer`")]
    fn put_blocks<E>(
        &self,
        place: TexelPlace,
        format: BlockFormat,
        layer: &LayerPlan,
        rows: &[Row<'_>],
        level: Level,
        mut errors: Option<&mut [f64]>,
        put: &dyn Fn(TexelPlace, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let (channels, width) = (format.channels(), level.width);
        let block_rows = SPAN.div_ceil(4 * width) * 4 * width;
        let row_bytes = TexelFormat::Block(format).row_bytes(width);
        let (mut texels, mut decoded, mut blocks) = (Vec::new(), Vec::new(), Vec::new());
        for start in (0..level.pixels).step_by(block_rows) {
            let end = (start + block_rows).min(level.pixels);
            let rows: Vec<_> = rows.iter().map(|row| row.slice(start, end)).collect();
            texels.clear();
            texels.resize((end - start) * channels, 0.0);
            if channels == 4 {
                texels.chunks_exact_mut(4).for_each(|texel| texel[3] = 1.0);
            }
            for (channel, (row, quantizer)) in rows.iter().zip(&layer.quantizers).enumerate() {
                let per_unit = if quantizer.scale == 0.0 { 0.0 } else { 1.0 / quantizer.scale };
                for (texel, c) in texels.chunks_exact_mut(channels).zip(row.iter()) {
                    texel[channel] = (c - quantizer.bias) * per_unit;
                }
            }
            let height = (end - start) / width;
            blocks.resize(row_bytes as usize * height.div_ceil(4), 0);
            encode_blocks(format, self.coding.blocks, &texels, width, &mut blocks);
            if let Some(errors) = errors.as_deref_mut() {
                decoded.resize(texels.len(), 0.0);
                decode_blocks(format, &blocks, width, &mut decoded);
                for (channel, row) in rows.iter().enumerate() {
                    let values = decoded[channel..].iter().step_by(channels).copied();
                    errors[layer.planes[channel]] += squared_error(*row, values, layer.quantizers[channel]);
                }
            }
            let offset = ((level.first + start) / width / 4) as u64 * row_bytes;
            put(TexelPlace { offset, ..place }, &blocks)?;
        }
        Ok(())
    }

    /// Adds what a run contributes to level 1. A row there has its sources in at most two runs,
    /// and a + b is b + a: the sums don't depend on which comes first.
    fn add_to_level_1(&self, halved: &Mutex<Vec<Vec<f32>>>, planes: &[Row<'_>], span: &CoefficientSpan<'_>) {
        let (width, first_row) = (level_size(self.width, 1), span.first / self.width);
        let mut plane_samples = Vec::with_capacity(span.pixels);
        for (plane, row) in planes.iter().enumerate() {
            plane_samples.clear();
            plane_samples.extend(row.iter());
            let (to, rows) = halve_rows(&plane_samples, self.width, self.height, first_row);
            let mut halved = halved.lock().unwrap_or_else(PoisonError::into_inner);
            for (sum, part) in halved[plane][to * width..].iter_mut().zip(rows) {
                *sum += part;
            }
        }
    }
}

/// A run of pixels of a mip level.
#[derive(Clone, Copy)]
struct Level {
    index: usize,
    width: usize,
    first: usize,
    pixels: usize,
}

/// Sum of squared differences between coefficients and what their texels give back.
fn squared_error(row: Row<'_>, texels: impl Iterator<Item = f32>, quantizer: crate::Quantizer) -> f64 {
    let (scale, bias) = (quantizer.scale, quantizer.bias);
    row.iter().zip(texels).map(|(c, q)| f64::from(scale * q + bias - c)).map(|d| d * d).sum()
}
