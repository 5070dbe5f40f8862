//! What a preview shows: the relit picture, one map, or the GPU's difference from the CPU.

use relight_core::relighter::{Picture, relight};
use relight_core::{CpuLevel, Direction, Layout, RelightingMaps, Space};
use relight_gpu::{Gpu, GpuError, GpuMaps, GpuPicture, Showing};

/// How much differences are amplified: a step of 8 bits becomes a sixteenth of the range.
const AMPLIFICATION: f32 = 16.0;

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum View {
    /// The picture under the light.
    Relit,
    /// One map; in LRGB assets the last is base colour.
    Map(usize),
    /// The difference of the GPU's picture from the CPU's.
    Difference,
}

impl View {
    /// Maps that an asset has to show.
    pub(super) fn count(maps: &RelightingMaps) -> usize {
        maps.model.maps() + usize::from(maps.model.layout == Layout::Lrgb)
    }

    /// The next kind of view.
    pub(super) fn next(self) -> Self {
        match self {
            Self::Relit => Self::Map(0),
            Self::Map(_) => Self::Difference,
            Self::Difference => Self::Relit,
        }
    }

    /// The map `by` further of `count`; from other views the first.
    pub(super) fn step(self, count: usize, by: usize) -> Self {
        match self {
            Self::Map(map) => Self::Map((map + by) % count),
            Self::Relit | Self::Difference => Self::Map(0),
        }
    }

    /// In words.
    pub(super) fn name(self, maps: &RelightingMaps) -> String {
        match self {
            Self::Relit => "relit".to_owned(),
            Self::Map(map) if map == maps.model.maps() => "base colour".to_owned(),
            Self::Map(map) => {
                let last = maps.model.maps() - 1;
                format!("map {map} of 0..{last} ({})", maps.model.map_label(map))
            }
            Self::Difference => format!("difference from the CPU x {AMPLIFICATION}"),
        }
    }

    /// As a part of file names.
    pub(super) fn file_word(self) -> String {
        match self {
            Self::Relit => "light".to_owned(),
            Self::Map(map) => format!("map{map}"),
            Self::Difference => "difference".to_owned(),
        }
    }
}

/// An asset under a light, to be seen.
pub(super) struct Viewed<'a> {
    pub(super) maps: &'a RelightingMaps,
    pub(super) light: Direction,
    pub(super) cpu: CpuLevel,
}

impl Viewed<'_> {
    /// What `view` shows, on the GPU; the relit picture at a mip level.
    pub(super) fn draw(
        &self,
        view: View,
        gpu: &Gpu,
        drawn: &mut GpuMaps,
        level: usize,
    ) -> Result<(GpuPicture, Showing), GpuError> {
        let showing = |space, channels| Showing { space, channels, smooth: true };
        if view == View::Relit {
            let model = &self.maps.model;
            return Ok((drawn.draw_on_gpu(self.light, level)?, showing(model.space, model.channels())));
        }
        let picture = self.picture(view, drawn)?;
        Ok((GpuPicture::from_picture(gpu, &picture)?, showing(Space::Encoded, picture.channels)))
    }

    /// What `view` shows at full size, in encoded values.
    pub(super) fn picture(&self, view: View, drawn: &mut GpuMaps) -> Result<Picture, GpuError> {
        Ok(match view {
            View::Relit => drawn.draw(self.light, 0)?.encoded_from(self.maps.model.space),
            View::Map(map) => self.map(map),
            View::Difference => {
                let mut picture = drawn.draw(self.light, 0)?;
                let reference = relight(self.maps, self.light, self.cpu);
                for (value, reference) in picture.samples.iter_mut().zip(reference.samples) {
                    *value = (*value - reference).abs() * AMPLIFICATION;
                }
                picture
            }
        })
    }

    /// The coefficients of map `map`, or base colour: the least black, the largest white.
    fn map(&self, map: usize) -> Picture {
        let (model, pixels) = (&self.maps.model, self.maps.pixels());
        let count = if map == model.maps() { 3 } else { model.layout.planes_per_map() };
        let planes = &self.maps.planes[map * model.layout.planes_per_map()..][..count];
        let mut samples = vec![0.0; pixels * count];
        let mut plane_values = vec![0.0; pixels];
        for (channel, plane) in planes.iter().enumerate() {
            plane.coefficients(0, &mut plane_values);
            for (pixel, value) in samples.chunks_exact_mut(count).zip(&plane_values) {
                pixel[channel] = *value;
            }
        }
        let least = samples.iter().copied().fold(f32::INFINITY, f32::min);
        let largest = samples.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let range = if largest > least { largest - least } else { 1.0 };
        samples.iter_mut().for_each(|value| *value = (*value - least) / range);
        Picture { width: self.maps.width, height: self.maps.height, channels: count, samples }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_core::{Design, Family, LightSet, Model, RelightingMap, Texels};

    fn maps(layout: Layout) -> RelightingMaps {
        let basis = Family::by_name("ptm").unwrap().build(&Design::new(6, &LightSet::default())).unwrap();
        let model = Model {
            basis,
            layout,
            space: Space::Encoded,
            lights: Vec::new(),
            figures: None,
            provenance: None,
        };
        let plane = |p: usize| {
            let texels = Texels::F32(vec![p as f32, 10.0 + (p * p) as f32]);
            RelightingMap { scale: 2.0, bias: -1.0, texels }
        };
        let planes = (0..model.plane_count()).map(plane).collect();
        RelightingMaps { width: 2, height: 1, model, planes }
    }

    #[test]
    fn a_map_shows_its_own_planes_from_black_to_white() {
        let rgb = maps(Layout::Rgb);
        let viewed = Viewed { maps: &rgb, light: Direction::OUT, cpu: CpuLevel::BASELINE };
        // Planes 12, 13, 14: from 12 to 10 + 196.
        let span = 194.0;
        let expected = [0.0, 1.0 / span, 2.0 / span, 142.0 / span, 167.0 / span, 1.0];
        assert!(viewed.map(4).samples.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6));
        let lrgb = maps(Layout::Lrgb);
        let viewed = Viewed { maps: &lrgb, light: Direction::OUT, cpu: CpuLevel::BASELINE };
        assert_eq!((viewed.map(5).channels, viewed.map(6).channels), (1, 3));
        assert_eq!(View::count(&lrgb), 7);
    }

    #[test]
    fn views_and_maps_go_round() {
        let view = View::Relit.next();
        assert_eq!((view, view.next(), view.next().next()), (View::Map(0), View::Difference, View::Relit));
        assert_eq!(View::Map(5).step(6, 1), View::Map(0));
        assert_eq!(View::Map(0).step(6, 5), View::Map(5));
    }
}
