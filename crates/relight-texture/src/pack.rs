//! The packer: coefficients in, texels of every layer and mip level out, with what storing them cost.
//!
//! It knows where a texel lies within its layer, not where layers lie in a file: that is the
//! container's business. Working memory is a span a thread and, with mips, the planes of level 1.

use crate::mips::MipFilter;
use crate::storing::{PackReport, PlaneErrors, StoringErrors};
use crate::texels::{Place, Row, TexelBuffer};
use crate::{
    ArrayPlan, BlockCoding, BlockFormat, LayerPlan, Packing, Precision, Quantizer, TexelFormat,
    decode_blocks, encode_blocks, level_size,
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

/// Takes the bytes of a place, from any thread.
pub type Put<'a, E> = &'a (dyn Fn(TexelPlace, &[u8]) -> Result<(), E> + Sync);

/// Takes runs of coefficients, in any order and from many threads, and hands texels on.
pub struct Packer {
    width: usize,
    height: usize,
    layout: Layout,
    functions: usize,
    packing: Packing,
    coding: Coding,
    written: AtomicUsize,
    errors: StoringErrors,
    /// Level 1, where there is one, channels interleaved as in the spans.
    halved: Option<Mutex<Vec<Vec<f32>>>>,
}

/// Pixels of a run such that [`Packer::write`] takes it: whole rows of blocks where the packing
/// [needs rows](crate::needs_rows), 8,192 otherwise.
pub fn span_pixels(width: usize, needs_rows: bool) -> usize {
    if needs_rows { span_rows(width) * width } else { SPAN }
}

/// Rows of blocks that make about 8,192 pixels, in rows of pixels.
fn span_rows(width: usize) -> usize {
    (SPAN / (4 * width)).max(1) * 4
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
            Mutex::new(strides(model).map(|stride| vec![0.0; texels * stride]).collect())
        });
        Self {
            width,
            height,
            layout: model.layout,
            functions: model.basis.count(),
            packing,
            coding,
            written: AtomicUsize::new(0),
            errors: StoringErrors::new(model),
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
    pub fn write<E>(&self, span: &CoefficientSpan<'_>, put: Put<'_, E>) -> Result<(), E> {
        let planes = self.planes_of(span);
        let mut errors: Vec<PlaneErrors> = vec![PlaneErrors::default(); planes.len()];
        let run = Run { planes: &planes, width: self.width, first: span.first, pixels: span.pixels };
        for layer in self.layers(0) {
            self.put_layer(&layer, &run, Some(&mut errors), put)?;
        }
        if let Some(halved) = &self.halved {
            self.add_to_level_1(halved, span);
        }
        self.errors.add(span.first, errors);
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
    pub fn finish<E: Send>(mut self, put: Put<'_, E>) -> Result<PackReport, E> {
        let pixels = self.width * self.height;
        assert_eq!(self.written(), pixels, "every pixel");
        let mut halved =
            self.halved.take().map(|level| level.into_inner().unwrap_or_else(PoisonError::into_inner));
        for level in 1..self.packing.levels {
            let (width, height) = (level_size(self.width, level), level_size(self.height, level));
            let Some(samples) = &mut halved else { break };
            let strides: Vec<usize> =
                samples.iter().map(|samples| samples.len() / (width * height)).collect();
            let rows: Vec<_> = samples
                .iter()
                .zip(&strides)
                .flat_map(|(samples, &stride)| rows_of(samples, stride))
                .collect();
            let run = Run { planes: &rows, width, first: 0, pixels: width * height };
            self.layers(level)
                .into_par_iter()
                .try_for_each(|layer| self.put_layer(&layer, &run, None, put))?;
            if level + 1 < self.packing.levels {
                samples.par_iter_mut().zip(strides).for_each(|(samples, stride)| {
                    let next = level_size(width, 1) * level_size(height, 1) * stride;
                    let finer = std::mem::replace(samples, vec![0.0; next]);
                    MipFilter::new(width, height, stride).add_rows(0, &finer, samples);
                });
            }
        }
        Ok(self.errors.report(pixels))
    }

    /// The layers of all arrays at mip level `level`.
    fn layers(&self, level: usize) -> Vec<Layer<'_>> {
        let arrays = self.packing.arrays.iter().enumerate();
        arrays
            .flat_map(|(array, ArrayPlan { format, layers })| {
                layers.iter().enumerate().map(move |(layer, plan)| Layer {
                    place: TexelPlace { array, level, layer, offset: 0 },
                    format: *format,
                    plan,
                })
            })
            .collect()
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
        let functions = functions.flat_map(|samples| rows_of(samples, stride));
        functions.chain(rows_of(span.base_color, base)).collect()
    }

    fn put_layer<E>(
        &self,
        layer: &Layer<'_>,
        run: &Run<'_>,
        errors: Option<&mut [PlaneErrors]>,
        put: Put<'_, E>,
    ) -> Result<(), E> {
        match layer.format {
            TexelFormat::Plain { precision, channels } => {
                self.put_plain(layer, (precision, channels), run, errors, put)
            }
            TexelFormat::Block(format) => self.put_blocks(layer, format, run, errors, put),
        }
    }

    fn put_plain<E>(
        &self,
        layer: &Layer<'_>,
        (precision, channels): (Precision, usize),
        run: &Run<'_>,
        mut plane_errors: Option<&mut [PlaneErrors]>,
        put: Put<'_, E>,
    ) -> Result<(), E> {
        let LayerPlan { planes, quantizers } = layer.plan;
        let texel_bytes = channels * precision.bytes();
        let mut buffer = TexelBuffer::default();
        for start in (0..run.pixels).step_by(PIECE) {
            let rows = run.rows(planes, start, (start + PIECE).min(run.pixels));
            let first = run.first + start;
            let dither = self.coding.dither.then_some(Place { first, width: run.width, planes });
            let bytes = buffer.texels((precision, channels), &rows, quantizers, dither);
            if let Some(plane_errors) = plane_errors.as_deref_mut() {
                for (channel, row) in rows.iter().enumerate() {
                    let texels = bytes[channel * precision.bytes()..].chunks(texel_bytes);
                    let of_plane = &mut plane_errors[planes[channel]];
                    match precision {
                        Precision::U8 => {
                            let values = texels.map(|texel| f32::from(texel[0]) / 255.0);
                            of_plane.add(first, errors(*row, values, quantizers[channel]));
                        }
                        Precision::F16 => {
                            let values =
                                texels.map(|texel| f16::from_le_bytes([texel[0], texel[1]]).to_f32());
                            of_plane.add(first, errors(*row, values, quantizers[channel]));
                        }
                        // Exact but for the rounding of f32 itself.
                        Precision::F32 => of_plane.add(first, row.iter().map(|_| 0.0)),
                    }
                }
            }
            put(TexelPlace { offset: (first * texel_bytes) as u64, ..layer.place }, bytes)?;
        }
        Ok(())
    }

    fn put_blocks<E>(
        &self,
        layer: &Layer<'_>,
        format: BlockFormat,
        run: &Run<'_>,
        mut plane_errors: Option<&mut [PlaneErrors]>,
        put: Put<'_, E>,
    ) -> Result<(), E> {
        let LayerPlan { planes, quantizers } = layer.plan;
        let (channels, width) = (format.channels(), run.width);
        let row_bytes = layer.format.row_bytes(width);
        let piece = span_rows(width) * width;
        let (mut texels, mut decoded, mut blocks) = (Vec::new(), Vec::new(), Vec::new());
        for start in (0..run.pixels).step_by(piece) {
            let end = (start + piece).min(run.pixels);
            let rows = run.rows(planes, start, end);
            texels.clear();
            texels.resize((end - start) * channels, 0.0);
            if channels == 4 {
                texels.chunks_exact_mut(4).for_each(|texel| texel[3] = 1.0);
            }
            for (channel, (row, quantizer)) in rows.iter().zip(quantizers).enumerate() {
                for (texel, c) in texels.chunks_exact_mut(channels).zip(row.iter()) {
                    texel[channel] = quantizer.texel(format.domain(), c);
                }
            }
            let height = (end - start) / width;
            blocks.resize(row_bytes as usize * height.div_ceil(4), 0);
            encode_blocks(format, self.coding.blocks, &texels, width, &mut blocks);
            if let Some(plane_errors) = plane_errors.as_deref_mut() {
                decoded.resize(texels.len(), 0.0);
                decode_blocks(format, &blocks, width, &mut decoded);
                for (channel, row) in rows.iter().enumerate() {
                    let values = decoded[channel..].iter().step_by(channels).copied();
                    let errors = errors(*row, values, quantizers[channel]);
                    plane_errors[planes[channel]].add(run.first + start, errors);
                }
            }
            let offset = ((run.first + start) / width / 4) as u64 * row_bytes;
            put(TexelPlace { offset, ..layer.place }, &blocks)?;
        }
        Ok(())
    }

    /// Adds what a run contributes to level 1. A row there has its sources in at most two runs,
    /// and a + b is b + a: the sums don't depend on which comes first.
    fn add_to_level_1(&self, halved: &Mutex<Vec<Vec<f32>>>, span: &CoefficientSpan<'_>) {
        let (first_row, rows) = (span.first / self.width, span.pixels / self.width);
        let width = level_size(self.width, 1);
        let stride = self.layout.planes_per_function();
        let functions = span.functions.chunks_exact(span.pixels * stride);
        let base = (!span.base_color.is_empty()).then_some(span.base_color);
        for (group, samples) in functions.chain(base).enumerate() {
            let stride = samples.len() / span.pixels;
            let filter = MipFilter::new(self.width, self.height, stride);
            let next_rows = filter.rows_from(first_row..first_row + rows);
            let mut part = vec![0.0; next_rows.len() * width * stride];
            filter.add_rows(first_row, samples, &mut part);
            let mut halved = halved.lock().unwrap_or_else(PoisonError::into_inner);
            for (sum, part) in halved[group][next_rows.start * width * stride..].iter_mut().zip(part) {
                *sum += part;
            }
        }
    }
}

/// Channels that are interleaved in each of a span's groups of samples: the functions, then the
/// base colour where there is one.
fn strides(model: &Model) -> impl Iterator<Item = usize> {
    let base = (model.layout == Layout::Lrgb).then_some(3);
    std::iter::repeat_n(model.layout.planes_per_function(), model.basis.count()).chain(base)
}

/// The planes of samples that interleave `stride` of them.
fn rows_of(samples: &[f32], stride: usize) -> impl Iterator<Item = Row<'_>> {
    (0..stride).map(move |channel| Row { samples, stride, channel })
}

/// A layer at a mip level.
struct Layer<'a> {
    place: TexelPlace,
    format: TexelFormat,
    plan: &'a LayerPlan,
}

/// A run of pixels of a mip level.
struct Run<'a> {
    planes: &'a [Row<'a>],
    width: usize,
    first: usize,
    pixels: usize,
}

impl<'a> Run<'a> {
    /// Pixels `start` to `end` of the run in the planes of a layer.
    fn rows(&self, planes: &[usize], start: usize, end: usize) -> Vec<Row<'a>> {
        planes.iter().map(|&plane| self.planes[plane].slice(start, end)).collect()
    }
}

/// What texels give back less the coefficients.
fn errors<'a>(
    row: Row<'a>,
    texels: impl Iterator<Item = f32> + 'a,
    quantizer: Quantizer,
) -> impl Iterator<Item = f32> + 'a {
    let Quantizer { scale, bias } = quantizer;
    row.iter().zip(texels).map(move |(c, q)| scale * q + bias - c)
}
