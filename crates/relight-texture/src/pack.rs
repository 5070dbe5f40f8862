//! The packer: coefficients in, texels of every layer and mip level out, with what storing them cost.
//!
//! It knows where a texel lies within its layer, not where layers lie in a file: that is the
//! container's business. Working memory is a span a thread and, with mips, the planes of level 1.

use crate::cost::mean_products;
use crate::feedback::Feedback;
use crate::loops::{add_purpose, gather, texel_errors, texels as texels_of};
use crate::mips::MipFilter;
use crate::storing::{PackReport, PlaneErrors, StoringErrors};
use crate::texels::{Place, Row, TexelBuffer};
use crate::{
    ArrayPlan, BlockCoding, BlockFormat, LayerPlan, Packing, Precision, Quantizer, TexelFormat,
    decode_blocks, encode_blocks, level_size,
};
use half::f16;
use rayon::prelude::*;
use relight_core::{CoefficientSpan, CpuLevel, Layout, Model, Spare};
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
    maps: usize,
    packing: Packing,
    coding: Coding,
    /// The layers as (array, layer), by their first planes: the order in which they are stored.
    order: Vec<(usize, usize)>,
    /// Where there are blocks.
    feedback: Option<Feedback>,
    scratch: Spare<FeedbackScratch>,
    written: AtomicUsize,
    errors: StoringErrors,
    level: CpuLevel,
    /// Level 1, where there is one, channels interleaved as in the spans.
    halved: Option<Mutex<Vec<Vec<f32>>>>,
}

/// What errors are handed on in.
#[derive(Default)]
struct FeedbackScratch {
    /// By plane.
    errors: Vec<f32>,
    /// By plane of a layer, what it is given to store.
    given: Vec<f32>,
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

/// Bytes that [`Packer::write`] works with for a span of `pixels` in blocks of `formats`: the errors of
/// all planes, and a layer on its way to its texels.
pub fn working_bytes(mut formats: impl Iterator<Item = TexelFormat>, planes: usize, pixels: usize) -> u64 {
    /// Planes in a layer, as coefficients, texels, errors and decoded.
    const LAYER: u64 = 4 * 4;
    let feedback = formats.any(|format| format.unit_size() > 1);
    if feedback { 4 * (planes as u64 + LAYER) * pixels as u64 } else { 0 }
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
        let mut order: Vec<(usize, usize)> = packing
            .arrays
            .iter()
            .enumerate()
            .flat_map(|(array, plan)| (0..plan.layers.len()).map(move |layer| (array, layer)))
            .collect();
        let planes_of =
            |&(array, layer): &(usize, usize)| packing.arrays[array].layers[layer].planes.as_slice();
        order.sort_by_key(|layer| planes_of(layer)[0]);
        let feedback = packing.formats().any(|format| format.unit_size() > 1).then(|| {
            let layers: Vec<_> = order.iter().map(planes_of).collect();
            Feedback::new(model, &mean_products(model), &layers)
        });
        let errors = StoringErrors::new(model);
        let errors = match &feedback {
            Some(feedback) => errors.with_energy(&feedback.energy),
            None => errors,
        };
        let halved = (packing.levels > 1).then(|| {
            let texels = level_size(width, 1) * level_size(height, 1);
            Mutex::new(strides(model).map(|stride| vec![0.0; texels * stride]).collect())
        });
        Self {
            width,
            height,
            layout: model.layout,
            maps: model.maps(),
            packing,
            coding,
            order,
            feedback,
            scratch: Spare::default(),
            written: AtomicUsize::new(0),
            errors,
            level: CpuLevel::detect(),
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
        let run = Run { planes: &planes, width: self.width, first: span.first, pixels: span.pixels };
        let errors = self.put_run(0, &run, put)?;
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
            let pixels = width * height;
            let band = span_rows(width) * width;
            (0..pixels.div_ceil(band)).into_par_iter().try_for_each(|index| {
                let (start, end) = (index * band, ((index + 1) * band).min(pixels));
                let rows: Vec<_> = rows.iter().map(|row| row.slice(start, end)).collect();
                let run = Run { planes: &rows, width, first: start, pixels: end - start };
                self.put_run(level, &run, put).map(drop)
            })?;
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

    /// The layers of all arrays at mip level `level`, in the order in which they are stored.
    fn layers(&self, level: usize) -> impl Iterator<Item = Layer<'_>> {
        self.order.iter().map(move |&(array, layer)| {
            let ArrayPlan { format, layers } = &self.packing.arrays[array];
            let place = TexelPlace { array, level, layer, offset: 0 };
            Layer { place, format: *format, plan: &layers[layer] }
        })
    }

    /// The planes of a run, in the order of [`Model::roles`].
    fn planes_of<'a>(&self, span: &CoefficientSpan<'a>) -> Vec<Row<'a>> {
        let stride = self.layout.planes_per_map();
        let base = if self.layout == Layout::Lrgb { 3 } else { 0 };
        assert!(span.first + span.pixels <= self.width * self.height, "the span leaves the map");
        assert_eq!(span.maps.len(), self.maps * span.pixels * stride, "maps");
        assert_eq!(span.base_color.len(), base * span.pixels, "base colour");
        if self.packing.needs_rows() {
            let (row, last) = (4 * self.width, span.first + span.pixels == self.width * self.height);
            assert!(span.first.is_multiple_of(row), "a span begins at a row of blocks");
            assert!(last || span.pixels.is_multiple_of(row), "a span is whole rows of blocks");
        }
        let functions = span.maps.chunks_exact((span.pixels * stride).max(1));
        let functions = functions.flat_map(|samples| rows_of(samples, stride));
        functions.chain(rows_of(span.base_color, base)).collect()
    }

    /// Stores the layers of a run one after another and says by how much.
    fn put_run<E>(&self, level: usize, run: &Run<'_>, put: Put<'_, E>) -> Result<Vec<PlaneErrors>, E> {
        let mut told = vec![PlaneErrors::default(); run.planes.len()];
        let Some(feedback) = &self.feedback else {
            for layer in self.layers(level) {
                let planes = &layer.plan.planes;
                let rows: Vec<_> = planes.iter().map(|&plane| run.planes[plane]).collect();
                let mut tell = |channel: usize, first: usize, errors: &[f32]| {
                    told[planes[channel]].add_all(self.level, first, errors);
                };
                self.put_layer(&layer, run, &rows, put, &mut tell)?;
            }
            return Ok(told);
        };
        let pixels = run.pixels;
        let FeedbackScratch { mut errors, mut given } = self.scratch.take();
        // Layers write theirs before later ones read them.
        errors.resize(run.planes.len() * pixels, 0.0);
        for layer in self.layers(level) {
            let planes = &layer.plan.planes;
            given.resize(planes.len() * pixels, 0.0);
            for (&plane, given) in planes.iter().zip(given.chunks_exact_mut(pixels)) {
                gather(self.level, run.planes[plane], given);
                let errors = |plane: usize| &errors[plane * pixels..][..pixels];
                feedback.apply(plane, errors, given, self.level);
            }
            let rows: Vec<_> = rows_of_planes(&given, pixels).collect();
            let mut tell = |channel: usize, first: usize, of_given: &[f32]| {
                let start = planes[channel] * pixels + first - run.first;
                errors[start..start + of_given.len()].copy_from_slice(of_given);
            };
            self.put_layer(&layer, run, &rows, put, &mut tell)?;
            for (&plane, given) in planes.iter().zip(given.chunks_exact(pixels)) {
                let errors = &mut errors[plane * pixels..][..pixels];
                told[plane].add_given(self.level, errors);
                add_purpose(self.level, given, run.planes[plane], errors);
                told[plane].add_all(self.level, run.first, errors);
            }
        }
        self.scratch.give(FeedbackScratch { errors, given });
        Ok(told)
    }

    fn put_layer<E>(
        &self,
        layer: &Layer<'_>,
        run: &Run<'_>,
        rows: &[Row<'_>],
        put: Put<'_, E>,
        tell: Tell<'_>,
    ) -> Result<(), E> {
        match layer.format {
            TexelFormat::Plain { precision, channels } => {
                self.put_plain(layer, (precision, channels), run, rows, put, tell)
            }
            TexelFormat::Block(format) => self.put_blocks(layer, format, run, rows, put, tell),
        }
    }

    fn put_plain<E>(
        &self,
        layer: &Layer<'_>,
        (precision, channels): (Precision, usize),
        run: &Run<'_>,
        rows: &[Row<'_>],
        put: Put<'_, E>,
        tell: Tell<'_>,
    ) -> Result<(), E> {
        let LayerPlan { planes, quantizers } = layer.plan;
        let texel_bytes = channels * precision.bytes();
        let (mut buffer, mut errors) = (TexelBuffer::default(), Vec::new());
        for start in (0..run.pixels).step_by(PIECE) {
            let end = (start + PIECE).min(run.pixels);
            let rows: Vec<_> = rows.iter().map(|row| row.slice(start, end)).collect();
            let first = run.first + start;
            let dither = self.coding.dither.then_some(Place { first, width: run.width, planes });
            let bytes = buffer.texels((precision, channels), &rows, quantizers, dither);
            for (channel, row) in rows.iter().enumerate() {
                let texels = bytes[channel * precision.bytes()..].chunks(texel_bytes);
                errors.clear();
                match precision {
                    Precision::U8 if dither.is_none() => {
                        errors.resize(row.len(), 0.0);
                        row.code_errors(quantizers[channel], &mut errors);
                    }
                    Precision::U8 => {
                        let values = texels.map(|texel| f32::from(texel[0]) / 255.0);
                        errors.extend(errors_of(*row, values, quantizers[channel]));
                    }
                    Precision::F16 => {
                        let values = texels.map(|texel| f16::from_le_bytes([texel[0], texel[1]]).to_f32());
                        errors.extend(errors_of(*row, values, quantizers[channel]));
                    }
                    // Exact but for the rounding of f32 itself.
                    Precision::F32 => errors.resize(row.len(), 0.0),
                }
                tell(channel, first, &errors);
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
        rows: &[Row<'_>],
        put: Put<'_, E>,
        tell: Tell<'_>,
    ) -> Result<(), E> {
        debug_assert!(rows.iter().all(|row| row.stride == 1), "blocks are made of what feedback gives");
        let quantizers = &layer.plan.quantizers;
        let (channels, width) = (format.channels(), run.width);
        let row_bytes = layer.format.row_bytes(width);
        let piece = span_rows(width) * width;
        let (mut texels, mut decoded, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        let mut blocks = Vec::new();
        for start in (0..run.pixels).step_by(piece) {
            let end = (start + piece).min(run.pixels);
            let rows: Vec<_> = rows.iter().map(|row| row.slice(start, end)).collect();
            texels.resize((end - start) * channels, 0.0);
            if rows.len() < channels {
                texels.fill(0.0);
            }
            if channels == 4 {
                texels.chunks_exact_mut(4).for_each(|texel| texel[3] = 1.0);
            }
            for (channel, (row, quantizer)) in rows.iter().zip(quantizers).enumerate() {
                let (how, place) = ((*quantizer, format.domain()), (channel, channels));
                texels_of(self.level, how, row.samples, place, &mut texels);
            }
            let height = (end - start) / width;
            blocks.resize(row_bytes as usize * height.div_ceil(4), 0);
            encode_blocks(format, self.coding.blocks, &texels, width, &mut blocks);
            decoded.resize(texels.len(), 0.0);
            decode_blocks(format, &blocks, width, &mut decoded);
            for (channel, row) in rows.iter().enumerate() {
                errors.resize(end - start, 0.0);
                let place = (channel, channels);
                texel_errors(self.level, quantizers[channel], &decoded, place, row.samples, &mut errors);
                tell(channel, run.first + start, &errors);
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
        let stride = self.layout.planes_per_map();
        let functions = span.maps.chunks_exact(span.pixels * stride);
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

/// Channels that are interleaved in each of a span's groups of samples: the maps, then the
/// base colour where there is one.
fn strides(model: &Model) -> impl Iterator<Item = usize> {
    let base = (model.layout == Layout::Lrgb).then_some(3);
    std::iter::repeat_n(model.layout.planes_per_map(), model.maps()).chain(base)
}

/// The planes of samples that interleave `stride` of them.
fn rows_of(samples: &[f32], stride: usize) -> impl Iterator<Item = Row<'_>> {
    (0..stride).map(move |channel| Row { samples, stride, channel })
}

/// Takes what a channel's texels give back, from a pixel on, less the coefficients that they were made of.
type Tell<'a> = &'a mut dyn FnMut(usize, usize, &[f32]);

/// The planes of samples that hold one after another.
fn rows_of_planes(samples: &[f32], pixels: usize) -> impl Iterator<Item = Row<'_>> {
    samples.chunks_exact(pixels).flat_map(|plane| rows_of(plane, 1))
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

/// What texels give back less the coefficients.
fn errors_of<'a>(
    row: Row<'a>,
    texels: impl Iterator<Item = f32> + 'a,
    quantizer: Quantizer,
) -> impl Iterator<Item = f32> + 'a {
    let Quantizer { scale, bias } = quantizer;
    row.iter().zip(texels).map(move |(c, q)| scale * q + bias - c)
}
