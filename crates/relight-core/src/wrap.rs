//! What lies beyond a picture's edge.

/// What a sampler does beyond the edge of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The edge goes on.
    #[default]
    Clamp,
    /// The picture starts again.
    Repeat,
    /// The picture comes back mirrored.
    Mirror,
}
