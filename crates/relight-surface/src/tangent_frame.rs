//! Frames in which a surface sees lights.

use relight_core::vectors::{cross, difference, dot, frame_around, scaled, unit};

/// Axes of a point of a surface, orthonormal: a light's coordinates along them are those of the light
/// directions of a capture (x right, y up, z out of the picture).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentFrame {
    /// Where the picture's right is.
    pub tangent: [f64; 3],
    /// Where its top is: handedness x normal x tangent.
    pub bitangent: [f64; 3],
    /// Out of the surface.
    pub normal: [f64; 3],
}

impl TangentFrame {
    /// The frame around `normal` whose tangent is as near to `tangent` as may be; `handedness` is that
    /// of glTF, below 0 where the picture is mirrored.
    ///
    /// A normal that is 0 becomes z; a tangent that is 0 or along the normal becomes that of
    /// [`Self::around`].
    pub fn new(normal: [f64; 3], tangent: [f64; 3], handedness: f64) -> Self {
        let normal = unit(normal).unwrap_or([0.0, 0.0, 1.0]);
        let across = difference(tangent, scaled(normal, dot(normal, tangent)));
        // What is left of a tangent along the normal is rounding.
        let is_along = dot(across, across) <= 1e-12 * dot(tangent, tangent);
        let Some(tangent) = unit(across).filter(|_| !is_along) else {
            return Self::around(normal);
        };
        let sign = if handedness < 0.0 { -1.0 } else { 1.0 };
        Self { tangent, bitangent: scaled(cross(normal, tangent), sign), normal }
    }

    /// Some right-handed frame around the unit vector `normal`, always the same one.
    ///
    /// Source: as of [`frame_around`].
    pub fn around(normal: [f64; 3]) -> Self {
        let [tangent, bitangent] = frame_around(normal);
        Self { tangent, bitangent, normal }
    }

    /// `direction` along the axes.
    pub fn coordinates(&self, direction: [f64; 3]) -> [f64; 3] {
        [self.tangent, self.bitangent, self.normal].map(|axis| dot(axis, direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_orthonormal(frame: &TangentFrame, handedness: f64) {
        let axes = [frame.tangent, frame.bitangent, frame.normal];
        for (i, a) in axes.iter().enumerate() {
            for (j, b) in axes.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((dot(*a, *b) - expected).abs() < 1e-12, "{frame:?}");
            }
        }
        assert!((dot(cross(frame.tangent, frame.bitangent), frame.normal) - handedness).abs() < 1e-12);
    }

    #[test]
    fn frames_are_orthonormal_for_any_tangent() {
        let normals =
            [[0.0, 0.0, -1.0], [-0.0, 0.0, 1.0], [3e-9, -1e-9, -1.0], [0.6, 0.0, -0.8], [1.0, 2.0, -0.0]];
        let tangents = [[0.0; 3], [0.3, -0.7, 0.2], [f64::NAN, 0.0, 0.0], [1e-200, 3e-200, 0.0]];
        for normal in normals {
            for tangent in tangents.into_iter().chain([normal, scaled(normal, -1e8)]) {
                for handedness in [1.0, -1.0] {
                    let frame = TangentFrame::new(normal, tangent, handedness);
                    let is_own = frame == TangentFrame::around(frame.normal);
                    assert_orthonormal(&frame, if is_own { 1.0 } else { handedness });
                    assert!((dot(frame.normal, unit(normal).unwrap()) - 1.0).abs() < 1e-15);
                }
            }
        }
        assert_eq!(TangentFrame::new([0.0; 3], [0.0, 2.0, 9.0], 1.0).tangent, [0.0, 1.0, 0.0]);
        assert_eq!(TangentFrame::around([0.0, 0.0, 1.0]).tangent, [1.0, 0.0, 0.0]);
        assert_eq!(TangentFrame::around([1.0, 0.0, 0.0]), TangentFrame::around([1.0, 0.0, -0.0]));
    }
}
