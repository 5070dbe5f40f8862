//! Directions and positions of lamps from their highlights on mirror spheres.
//!
//! Axes: x right, y up, z out of the picture, the origin in the middle of the picture on the plane on which spheres rest; the unit
//! is a pixel of that plane. Places in a picture are in pixels from its top left corner, y down: the first pixel's middle is
//! (0.5, 0.5).

mod highlight;
mod lamp;
mod outline;
mod sphere;

pub use highlight::{Highlight, find_highlight};
pub use lamp::{LampPosition, NEARLY_PARALLEL, mean_direction, position_of};
pub use outline::{FoundOutline, LEAST_SUPPORT, find_outlines};
pub use sphere::{MirrorSphere, Ray, SphereError, SphereOutline, Viewer};

/// Linear light of every pixel of a picture, or of the part of it that `left` and `top` begin.
#[derive(Clone, Debug, PartialEq)]
pub struct LuminancePicture {
    /// Column of the first pixel in the whole picture.
    pub left: usize,
    /// Row of the first pixel in the whole picture.
    pub top: usize,
    /// Pixels in a row.
    pub width: usize,
    /// Luminance, rows from the top.
    pub values: Vec<f32>,
}

impl LuminancePicture {
    /// Rows.
    pub fn height(&self) -> usize {
        self.values.len().checked_div(self.width).unwrap_or(0)
    }

    /// The part that holds `outline` and `margin` pixels around it, cut at the picture's edges.
    pub fn around(&self, outline: &SphereOutline, margin: f64) -> Self {
        let bounds = |centre: f64, first: usize, count: usize| {
            let reach = outline.radius + margin;
            let low = (centre - reach - first as f64).clamp(0.0, count as f64);
            let high = (centre + reach - first as f64).ceil().clamp(low, count as f64);
            (low as usize, high as usize)
        };
        let (left, right) = bounds(outline.x, self.left, self.width);
        let (top, bottom) = bounds(outline.y, self.top, self.height());
        let row = |y: usize| &self.values[y * self.width + left..y * self.width + right];
        let values = (top..bottom).flat_map(row).copied().collect();
        Self { left: self.left + left, top: self.top + top, width: right - left, values }
    }
}
