//! An asset's pictures under lights of one's choice, as if they had been taken.

use relight_core::relighter::LightTerms;
use relight_core::{
    CpuLevel, Direction, RelightingMaps, Space, Stack, StackError, StackRows, linear_from_srgb,
    srgb_from_linear,
};
use std::ops::Range;

/// Pictures of an asset that are made when they are read: for what no sum of planes gives, such as another
/// space, a base colour or learned planes.
pub struct RelitStack<'a> {
    maps: &'a RelightingMaps,
    space: Space,
    level: CpuLevel,
    /// One a picture.
    terms: Vec<LightTerms>,
}

impl<'a> RelitStack<'a> {
    /// The pictures of `maps` under `lights`, with values in `space`.
    pub fn new(maps: &'a RelightingMaps, lights: &[Direction], space: Space, level: CpuLevel) -> Self {
        let terms = lights.iter().map(|&light| LightTerms::new(&maps.model, light)).collect();
        Self { maps, space, level, terms }
    }
}

impl Stack for RelitStack<'_> {
    fn lights(&self) -> usize {
        self.terms.len()
    }

    fn width(&self) -> usize {
        self.maps.width
    }

    fn height(&self) -> usize {
        self.maps.height
    }

    fn channels(&self) -> usize {
        self.maps.model.channels()
    }

    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
        assert!(samples.end <= self.pixels() * self.channels(), "the samples leave the pictures");
        Ok(Box::new(RelitRows { stack: self, first: samples.start }))
    }
}

struct RelitRows<'a> {
    stack: &'a RelitStack<'a>,
    /// A sample.
    first: usize,
}

impl StackRows for RelitRows<'_> {
    fn copy(&self, light: usize, first: usize, out: &mut [f32]) {
        let RelitStack { maps, space, level, terms } = self.stack;
        let channels = self.stack.channels();
        assert!(
            (self.first + first).is_multiple_of(channels) && out.len().is_multiple_of(channels),
            "whole pixels"
        );
        terms[light].relight(maps, *level, (self.first + first) / channels, out);
        match (maps.model.space, space) {
            (Space::Encoded, Space::Linear) => {
                out.iter_mut().for_each(|value| *value = linear_from_srgb(*value))
            }
            (Space::Linear, Space::Encoded) => {
                out.iter_mut().for_each(|value| *value = srgb_from_linear(*value))
            }
            _ => {}
        }
    }
}
