//! Assets with a value of their own in every plane and pixel, and ways to write them.

use relight_core::basis::Learned;
use relight_core::sphere::Octahedral;
use relight_core::{
    Basis, CoefficientRange, CoefficientSpan, Design, Direction, Family, FitFigures, Layout, LightSet, Model,
    Space,
};
use relight_formats::asset::{AssetFormat, AssetHeader, AssetWriter, WriteSettings};
use relight_formats::{FormatError, write_whole};
use relight_texture::{
    ArrayPlan, Coding, LayerPlan, PackReport, PackedMaps, Packer, Packing, Precision, Quantizer, TexelDomain,
    TexelFormat, Wrap, level_size, planes_of_layers, span_pixels,
};
use std::path::Path;
use std::sync::Mutex;

pub(crate) const LIMIT: u64 = 64 << 20;
pub(crate) const LAYOUTS: [Layout; 4] = [Layout::Rgb, Layout::Lrgb, Layout::Grey, Layout::Shared];
pub(crate) const PRECISIONS: [Precision; 3] = [Precision::U8, Precision::F16, Precision::F32];
pub(crate) const PLAIN: WriteSettings = WriteSettings {
    coding: Coding {
        blocks: relight_texture::BlockCoding {
            quality: relight_texture::Quality::Fast,
            encoder: relight_texture::Encoder::Portable,
        },
        dither: false,
    },
    zstd: None,
    split: false,
    jpeg_quality: None,
    deepzoom: false,
    memory_limit: LIMIT,
};

/// Steele, Lea, Flood, *Fast splittable pseudorandom number generators*.
pub(crate) struct SplitMix(pub(crate) u64);

impl SplitMix {
    pub(crate) fn next(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % below as u64) as usize
    }
}

/// A family and number of functions that the format of that name holds.
pub(crate) fn basis_of(format: &str) -> (&'static str, usize) {
    match format {
        "ptm" | "web" => ("ptm", 6),
        "rti" => ("hsh", 9),
        _ => ("srbf", 7),
    }
}

/// Planes with a value of their own in every pixel; base colours in 0..1.
pub(crate) struct Lopsided {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) model: Model,
    pub(crate) planes: Vec<Vec<f32>>,
}

pub(crate) fn lopsided(family: &str, count: usize, layout: Layout, size: (usize, usize)) -> Lopsided {
    let (width, height) = size;
    let light = |i: usize| Direction::new(i as f64 - 20.3, 7.1 - 0.37 * i as f64, 9.0 + i as f64).unwrap();
    let lights = LightSet::from_directions((0..41).map(light).collect());
    let basis = match layout {
        Layout::Shared => Basis::Learned(learned(family, count)),
        _ => Family::by_name(family).unwrap().build(&Design::new(count, &lights)).unwrap(),
    };
    let figures = Some(FitFigures { fit_rmse: 0.012_345_678_9, leave_one_out_rmse: 0.1 / 3.0 });
    let lights = lights.directions();
    let model = Model { basis, layout, space: Space::Encoded, lights, figures, provenance: None };
    let pixels = width * height;
    let value = |plane: usize, pixel: usize| {
        let unit = ((pixel * 7919 + plane * 104_729) % 100_003) as f32 / 100_003.0;
        let is_base = layout == Layout::Lrgb && plane >= count;
        if is_base { unit } else { (unit - 0.3) * (plane + 1) as f32 / 3.0 }
    };
    let planes = (0..model.plane_count()).map(|p| (0..pixels).map(|x| value(p, x)).collect()).collect();
    Lopsided { width, height, model, planes }
}

/// Learned functions with a value of its own in every place of the table.
fn learned(origin: &str, planes: usize) -> Learned {
    let square = Octahedral { nodes: 5, hemisphere: true };
    let table = (0..square.count() * 3 * (planes + 1)).map(|i| i as f32 * 0.125 - 9.0).collect();
    Learned::new(origin.to_owned(), planes, 3, square, table).unwrap()
}

impl Lopsided {
    pub(crate) fn range(&self, plane: usize) -> CoefficientRange {
        let one = |&c| CoefficientRange { min: c, max: c };
        self.planes[plane].iter().map(one).fold(CoefficientRange::EMPTY, CoefficientRange::union)
    }

    /// What spans a plane's range in texels of `format`.
    pub(crate) fn quantizer(&self, plane: usize, format: TexelFormat) -> Quantizer {
        let range = self.range(plane);
        match format.domain() {
            TexelDomain::Unit => Quantizer::over(range),
            TexelDomain::Signed => Quantizer { scale: range.min.abs().max(range.max.abs()), bias: 0.0 },
            TexelDomain::Half => Precision::F16.quantizer(range),
            TexelDomain::Float => Precision::F32.quantizer(range),
        }
    }

    /// One array of `format`.
    pub(crate) fn packing(&self, format: TexelFormat, levels: usize) -> Packing {
        let layers = planes_of_layers(&self.model, format)
            .into_iter()
            .map(|planes| {
                let quantizers = planes.iter().map(|&plane| self.quantizer(plane, format)).collect();
                LayerPlan { planes, quantizers }
            })
            .collect();
        Packing { arrays: vec![ArrayPlan { format, layers }], levels, wrap: Wrap::Mirror }
    }

    /// Arrays of each of `formats`, which take the layers of the first in turn; the first format has
    /// the fewest channels. The layers' order is turned around, so that no plane lies where it
    /// would by default.
    pub(crate) fn packing_of_several(&self, formats: &[TexelFormat], levels: usize) -> Packing {
        let mut arrays: Vec<_> =
            formats.iter().map(|&format| ArrayPlan { format, layers: Vec::new() }).collect();
        for (i, planes) in planes_of_layers(&self.model, formats[0]).into_iter().rev().enumerate() {
            let format = formats[i % formats.len()];
            let quantizers = planes.iter().map(|&plane| self.quantizer(plane, format)).collect();
            arrays[i % formats.len()].layers.push(LayerPlan { planes, quantizers });
        }
        Packing { arrays, levels, wrap: Wrap::Repeat }
    }

    /// The packing of plain texels in the format that `path` names.
    pub(crate) fn plain(&self, path: &Path, precision: Precision) -> Packing {
        let format = AssetFormat::by_path(path)
            .map_or(TexelFormat::Plain { precision, channels: 4 }, |format| {
                format.plain_format(self.model.layout, precision)
            });
        self.packing(format, 1)
    }

    pub(crate) fn header(&self, packing: Packing) -> AssetHeader {
        AssetHeader { width: self.width, height: self.height, model: self.model.clone(), packing }
    }

    /// The slices of a [`CoefficientSpan`] of pixels `first..end`.
    pub(crate) fn span(&self, first: usize, end: usize) -> (Vec<f32>, Vec<f32>) {
        let functions = self.model.maps();
        let interleaved = |planes: &[Vec<f32>]| -> Vec<f32> {
            (first..end).flat_map(|x| planes.iter().map(move |plane| plane[x])).collect()
        };
        let channels = if self.model.layout == Layout::Rgb { 3 } else { 1 };
        let rows = self.planes[..functions * channels].chunks(channels).flat_map(interleaved).collect();
        (rows, interleaved(&self.planes[functions * channels..]))
    }

    /// Hands all pixels to `write` from three threads in runs of uneven lengths, shuffled by `seed`.
    fn for_each_run(
        &self,
        packing: &Packing,
        seed: u64,
        write: &(dyn Fn(&CoefficientSpan<'_>) -> Result<(), FormatError> + Sync),
    ) -> Result<(), FormatError> {
        let (mut random, mut runs, mut first) = (SplitMix(seed), Vec::new(), 0);
        let pixels = self.width * self.height;
        let unit = if packing.needs_rows() { span_pixels(self.width, true).min(4 * self.width) } else { 1 };
        while first < pixels {
            let length = 1 + random.next(pixels / unit / 3 + 2);
            let end = (first + length * unit).min(pixels);
            runs.push((first, end));
            first = end;
        }
        for i in (1..runs.len()).rev() {
            runs.swap(i, random.next(i + 1));
        }
        std::thread::scope(|scope| {
            let run = |runs: Vec<(usize, usize)>| {
                scope.spawn(move || {
                    runs.iter().try_for_each(|&(first, end)| {
                        let (functions, base_color) = self.span(first, end);
                        let pixels = end - first;
                        let (functions, base_color) = (&functions[..], &base_color[..]);
                        write(&CoefficientSpan { first, pixels, maps: functions, base_color })
                    })
                })
            };
            let threads = runs.chunks(runs.len().div_ceil(3)).map(|runs| run(runs.to_vec()));
            let threads: Vec<_> = threads.collect();
            threads.into_iter().try_for_each(|thread| thread.join().unwrap())
        })
    }

    /// Hands all pixels to `writer`.
    pub(crate) fn fill(
        &self,
        writer: &dyn AssetWriter,
        packing: &Packing,
        seed: u64,
    ) -> Result<(), FormatError> {
        self.for_each_run(packing, seed, &|span| writer.write(span))
    }

    pub(crate) fn write(
        &self,
        path: &Path,
        packing: &Packing,
        settings: &WriteSettings,
        seed: u64,
    ) -> Result<PackReport, FormatError> {
        let format = AssetFormat::by_path(path)?;
        let writer = format.create(path, self.header(packing.clone()), settings)?;
        self.fill(&*writer, packing, seed)?;
        writer.finish()
    }

    /// Plain texels of `precision`.
    pub(crate) fn write_plain(&self, path: &Path, precision: Precision) -> Result<PackReport, FormatError> {
        self.write(path, &self.plain(path, precision), &PLAIN, 1)
    }

    /// What a GPU would get: the packer's bytes, put in order here.
    pub(crate) fn packed(&self, packing: &Packing, coding: Coding) -> PackedMaps {
        let layer_bytes = |array: usize, level: usize| {
            let format = packing.arrays[array].format;
            format.layer_bytes(level_size(self.width, level), level_size(self.height, level)) as usize
        };
        let texels = (0..packing.arrays.len()).map(|array| {
            let layers = packing.arrays[array].layers.len();
            (0..packing.levels).map(|level| vec![0; layers * layer_bytes(array, level)]).collect::<Vec<_>>()
        });
        let texels = Mutex::new(texels.collect::<Vec<_>>());
        let put = |place: relight_texture::TexelPlace, bytes: &[u8]| {
            let start = place.layer * layer_bytes(place.array, place.level) + place.offset as usize;
            let level = &mut texels.lock().unwrap()[place.array][place.level];
            level[start..start + bytes.len()].copy_from_slice(bytes);
            Ok(())
        };
        let packer = Packer::new(self.width, self.height, &self.model, packing.clone(), coding);
        self.for_each_run(packing, 9, &|span| packer.write(span, &put)).unwrap();
        packer.finish::<FormatError>(&put).unwrap();
        let (model, packing) = (self.model.clone(), packing.clone());
        let texels = texels.into_inner().unwrap();
        PackedMaps { width: self.width, height: self.height, model, packing, texels }
    }
}

/// The layer at `index` of a level that holds `layers`.
pub(crate) fn layer_of(level: &[u8], layers: usize, index: usize) -> &[u8] {
    let bytes = level.len() / layers;
    &level[index * bytes..(index + 1) * bytes]
}

/// Puts `with` where `what` stands in the file at `path`; both have the same length.
pub(crate) fn replace_in_file(path: &Path, what: &[u8], with: &[u8]) {
    let mut bytes = std::fs::read(path).unwrap();
    let at = bytes.windows(what.len()).position(|window| window == what).unwrap();
    bytes[at..at + with.len()].copy_from_slice(with);
    write_whole(path, &bytes).unwrap();
}

/// The names of the files in a folder, sorted.
pub(crate) fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}
