//! How planes and light become pixels.

use crate::{Basis, Direction, Provenance};
use serde::{Deserialize, Serialize};

/// Which values were fitted, so that render knows how lights add up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Space {
    /// sRGB-encoded values 0..1; decoded before several lights add up.
    Encoded,
    /// Linear light, 0 upwards.
    Linear,
}

/// What the planes of an asset are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// One plane a function; relit pictures are grey.
    Grey,
    /// Three planes a function (R, G, B), function-major.
    Rgb,
    /// One luminance plane a function, then three planes of base colour (largest component 1):
    /// pixel = base colour x luminance.
    Lrgb,
    /// Planes that serve all channels, each with a function of its own in each channel, and a mean that is a
    /// function of light alone: pixel = mean + sum of plane x weight. For [`Basis::Learned`] and for nothing
    /// else.
    Shared,
}

impl Layout {
    /// Planes of a map: one for each channel of a pixel in RGB, one in all otherwise.
    pub fn planes_per_map(self) -> usize {
        match self {
            Self::Rgb => 3,
            Self::Grey | Self::Lrgb | Self::Shared => 1,
        }
    }
}

/// What one plane contributes: channel `c` of the pixel gains plane x b_f(light) where
/// `functions[c] = Some(f)`.
///
/// RGB planes name one function for one channel, luminance planes the same one for all, and learned planes
/// ([`Layout::Shared`]) a function of its own for each channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaneRole {
    /// A plane of coefficients, by channel of the relit picture.
    Coefficient {
        /// Index into the basis for R, G, B (grey pictures use the first).
        functions: [Option<u16>; 3],
    },
    /// A plane that multiplies the sum in channel `channel`.
    BaseColor {
        /// 0, 1 or 2.
        channel: u8,
    },
}

/// Errors of the fit itself, in fitting space, before any quantisation, over a sample of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FitFigures {
    /// Root mean square error on the fitted lights.
    pub fit_rmse: f64,
    /// Root mean square error of predicting each light from all others (closed form).
    pub leave_one_out_rmse: f64,
}

/// Everything about an asset but its texels.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Functions of light direction.
    pub basis: Basis,
    /// What the planes are.
    pub layout: Layout,
    /// Which values were fitted.
    pub space: Space,
    /// The fitted lights; empty where a format can't hold them.
    pub lights: Vec<Direction>,
    /// How well the fit did; `None` where a format can't hold it.
    pub figures: Option<FitFigures>,
    /// What the bake was of that it comes from; `None` where that isn't known or a format can't hold it.
    pub provenance: Option<Box<Provenance>>,
}

impl Model {
    /// Channels of the relit picture: 1 or 3.
    pub fn channels(&self) -> usize {
        match (self.layout, &self.basis) {
            (Layout::Shared, Basis::Learned(learned)) => learned.channels(),
            (Layout::Grey, _) => 1,
            (Layout::Rgb | Layout::Lrgb | Layout::Shared, _) => 3,
        }
    }

    /// Whether layout and basis go together: learned functions have shared planes, no others have.
    pub fn is_consistent(&self) -> bool {
        matches!(self.basis, Basis::Learned(_)) == (self.layout == Layout::Shared)
    }

    /// Maps, rows of samples in a [`CoefficientSpan`](crate::CoefficientSpan): one a function of light, or one a
    /// plane where planes are shared. Base colour is none of them.
    pub fn maps(&self) -> usize {
        match &self.basis {
            Basis::Learned(learned) => learned.planes(),
            basis => basis.count(),
        }
    }

    /// What map `map` is, in a word.
    ///
    /// # Panics
    /// When there is no such map.
    pub fn map_label(&self, map: usize) -> String {
        assert!(map < self.maps(), "map {map}");
        match &self.basis {
            Basis::Learned(_) => format!("p{map}"),
            basis => basis.label(map),
        }
    }

    /// The function that each channel of the relit picture has without any plane: the mean of shared planes.
    pub fn mean_functions(&self) -> [Option<u16>; 3] {
        match (&self.basis, self.channels()) {
            (Basis::Learned(_), 1) => [Some(0), None, None],
            (Basis::Learned(_), _) => [Some(0), Some(1), Some(2)],
            _ => [None; 3],
        }
    }

    /// The planes' roles, in the order in which every asset stores them.
    pub fn roles(&self) -> Vec<PlaneRole> {
        let functions = 0..self.basis.count() as u16;
        match self.layout {
            Layout::Grey => {
                functions.map(|f| PlaneRole::Coefficient { functions: [Some(f), None, None] }).collect()
            }
            Layout::Rgb => functions
                .flat_map(|f| {
                    [[Some(f), None, None], [None, Some(f), None], [None, None, Some(f)]]
                        .map(|functions| PlaneRole::Coefficient { functions })
                })
                .collect(),
            Layout::Shared => (1..=self.maps() as u16)
                .map(|plane| {
                    let channels = self.channels() as u16;
                    let of = |c: u16| (c < channels).then_some(plane * channels + c);
                    PlaneRole::Coefficient { functions: [of(0), of(1), of(2)] }
                })
                .collect(),
            Layout::Lrgb => functions
                .map(|f| PlaneRole::Coefficient { functions: [Some(f); 3] })
                .chain((0..3).map(|channel| PlaneRole::BaseColor { channel }))
                .collect(),
        }
    }

    /// Number of planes: k (grey, shared), 3k (rgb) or k + 3 (lrgb).
    pub fn plane_count(&self) -> usize {
        let base_colors = if self.layout == Layout::Lrgb { 3 } else { 0 };
        self.maps() * self.layout.planes_per_map() + base_colors
    }
}
