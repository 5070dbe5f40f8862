//! A car of length : width : height 4 : 1.6 : 1.4 along x, y and z, standing on z = 0: body, cabin and four wheels.

use crate::surface::{Round, Surface};

const BODY: ([f64; 3], [f64; 3]) = ([0.0, 0.0, 0.6], [2.0, 0.76, 0.36]);
const CABIN: ([f64; 3], [f64; 3]) = ([-0.2, 0.0, 0.95], [1.2, 0.66, 0.45]);
const WHEEL: [f64; 3] = [0.33, 0.1, 0.33];

pub(crate) fn car() -> Surface {
    let body = Surface::new([28, 14, 8], Round::Box, |q| placed(BODY, bonnet(q, false)));
    let cabin = Surface::new([16, 12, 8], Round::Box, |q| placed(CABIN, windows(q, false)));
    let body = body.without(in_cabin);
    let cabin = cabin.without(in_body);
    let wheels = [[1.25, 0.7], [1.25, -0.7], [-1.25, 0.7], [-1.25, -0.7]].map(|[x, y]| {
        let centre = [x, y, WHEEL[2]];
        Surface::around([10, 4, 10], Round::Cylinder(1), centre, WHEEL).without(in_body)
    });
    Surface::joined([body, cabin].into_iter().chain(wheels))
}

fn placed((centre, half): ([f64; 3], [f64; 3]), q: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| centre[i] + half[i] * q[i])
}

fn in_shell((centre, half): ([f64; 3], [f64; 3]), point: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| (point[i] - centre[i]) / half[i])
}

fn in_body(point: [f64; 3]) -> bool {
    Round::Box.size(bonnet(in_shell(BODY, point), true)) < 1.0
}

fn in_cabin(point: [f64; 3]) -> bool {
    let q = in_shell(CABIN, point);
    // Beyond its box there is no cabin, whatever the windows' slant makes of it.
    q[2].abs() < 1.0 && Round::Box.size(windows(q, true)) < 1.0
}

/// Lower and narrower towards front and back; or the way back.
fn bonnet([x, y, z]: [f64; 3], back: bool) -> [f64; 3] {
    let lower = if z > 0.0 { 1.0 - 0.3 * (x * x).min(1.5) } else { 1.0 };
    let narrower = 1.0 - 0.12 * (x * x * x * x).min(1.5);
    if back { [x, y / narrower, z / lower] } else { [x, y * narrower, z * lower] }
}

/// Shorter and narrower towards the roof, the windscreen flatter than the rear window; or the way back.
fn windows([x, y, z]: [f64; 3], back: bool) -> [f64; 3] {
    let height = 0.5 * (z + 1.0);
    let (shorter, narrower, behind) = (1.0 - 0.35 * height, 1.0 - 0.2 * height, 0.1 * height);
    if back { [(x + behind) / shorter, y / narrower, z] } else { [x * shorter - behind, y * narrower, z] }
}
