//! Points, caps and cells on the sphere of light directions.

mod cap;
mod coverage;
mod octahedral;
mod points;
mod voronoi;

pub use cap::Cap;
pub use coverage::{Hole, largest_hole};
pub use octahedral::{Octahedral, OctahedralTaps};
pub use points::{fibonacci, fibonacci_in, hammersley, hammersley_in, nearest_neighbour_distances};
pub use voronoi::voronoi_weights;
