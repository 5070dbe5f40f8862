//! Scenes of a few lights.

use std::fmt::Write;

/// Frames of the light that flies past.
const FRAMES: usize = 48;

/// Distances of that light from the middle of the car, in radii of the car.
const FARTHEST: f64 = 40.0;
const NEAREST: f64 = 1.5;

/// A light on a straight line past the car: its distance changes by the same factor from frame to frame.
pub(crate) fn flyby(radius: f64) -> String {
    let mut text = format!(
        "# A light passes car.glb on a straight line, {FARTHEST} to {NEAREST} radii ({radius:.4}) of the car from its middle\n\
         # and away again. Made by formats/examples/rig_testdata.\n\n\
         [sequence]\nframes = {FRAMES}\n\n\
         [[light]]\nkind = \"sphere\"\nname = \"passing\"\nradius = {:.4}\ncolor = [1.0, 0.9, 0.7]\nintensity = 7.0\nkeys = [\n",
        0.1 * radius
    );
    for frame in 0..FRAMES {
        let time = frame as f64 / (FRAMES - 1) as f64;
        let share = 2.0 * time - 1.0;
        let distance = NEAREST * libm::pow(FARTHEST / NEAREST, share.abs());
        let along = share.signum() * (distance * distance - NEAREST * NEAREST).sqrt();
        // The line leaves the car's own axes, so that no side of it is special.
        let [x, y, z] = [0.8 * along, -0.6 * along, NEAREST * 0.6];
        let [x, y, z] = [x + 0.6 * 0.8 * NEAREST, y + 0.8 * 0.8 * NEAREST, z];
        let [x, y, z] = [x * radius, y * radius, z * radius + 0.7];
        _ = writeln!(text, "  {{ time = {time:.6}, position = [{x:.4}, {y:.4}, {z:.4}] }},");
    }
    text + "]\n"
}

/// Three lights for quick tests.
pub(crate) const SMALL: &str = r#"# Three lights for quick tests of figure.glb or car.glb. Made by formats/examples/rig_testdata.

[sequence]
frames = 4

[[light]]
kind = "sphere"
name = "key"
radius = 0.2
intensity = 6.0
color = [1.0, 0.9, 0.8]
keys = [{ time = 0.0, position = [3.5, 1.5, 2.5] }, { time = 1.0, position = [3.5, -1.5, 2.0] }]

[[light]]
kind = "disc"
name = "panel"
position = [-3.0, 2.0, 1.5]
target = [0.0, 0.0, 0.9]
radius = 0.8
radiance = 1.5
color = [0.5, 0.7, 1.0]

[[light]]
kind = "probe"
name = "sky"
sh = [[0.2, 0.22, 0.3], [0.0, 0.0, 0.0], [0.05, 0.06, 0.1], [0.02, 0.0, -0.02]]
"#;
