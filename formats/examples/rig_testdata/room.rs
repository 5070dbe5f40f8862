//! The scene of the paper: a room with a red and a green wall, four sphere lights, eight small bright ones that fly about, and
//! what floor and walls reflect of the four as 192 discs.

use crate::figure::{HIPS, HIPS_ASIDE, SHOULDERS, SHOULDERS_ASIDE};
use relight_core::vectors::{difference, dot, length};
use std::f64::consts::PI;
use std::fmt::Write;

const RED: [f64; 3] = [0.63, 0.06, 0.05];
const GREEN: [f64; 3] = [0.14, 0.45, 0.09];
const WHITE: [f64; 3] = [0.73, 0.73, 0.73];
const WOOD: [f64; 3] = [0.45, 0.36, 0.28];

/// The room's corners: floor at z = 0.
const LOW: [f64; 3] = [-4.0, -3.0, 0.0];
const HIGH: [f64; 3] = [4.0, 3.0, 3.0];

const FRAMES: usize = 24;

struct Ceiling {
    position: [f64; 3],
    color: [f64; 3],
    intensity: f64,
}

const CEILING: [Ceiling; 4] = [
    Ceiling { position: [2.4, 1.8, 2.6], color: [1.0, 0.86, 0.68], intensity: 2.5 },
    Ceiling { position: [-2.4, 1.8, 2.6], color: [1.0, 0.95, 0.9], intensity: 2.2 },
    Ceiling { position: [2.4, -1.8, 2.6], color: [0.8, 0.9, 1.0], intensity: 2.4 },
    Ceiling { position: [-2.4, -1.8, 2.6], color: [1.0, 0.9, 0.75], intensity: 2.0 },
];

/// A wall or the floor in rows of equal patches.
struct Wall {
    name: &'static str,
    albedo: [f64; 3],
    /// Which axis is constant, and whether it is at its upper end.
    axis: usize,
    upper: bool,
    /// Patches along the two other axes, in their order.
    patches: [usize; 2],
}

const WALLS: [Wall; 5] = [
    Wall { name: "floor", albedo: WOOD, axis: 2, upper: false, patches: [8, 8] },
    Wall { name: "left", albedo: RED, axis: 1, upper: true, patches: [8, 4] },
    Wall { name: "right", albedo: GREEN, axis: 1, upper: false, patches: [8, 4] },
    Wall { name: "front", albedo: WHITE, axis: 0, upper: true, patches: [8, 4] },
    Wall { name: "back", albedo: WHITE, axis: 0, upper: false, patches: [8, 4] },
];

type Flying = ([f64; 2], f64, [f64; 2], [f64; 3]);

/// Flying lights: half axes of the ellipse about the figure, height, where it starts and how often it goes round (in turns), colour.
const FLYING: [Flying; 6] = [
    ([1.2, 1.1], 1.5, [0.0, 1.0], [1.0, 0.5, 0.2]),
    ([1.5, 1.5], 0.8, [0.4, -1.0], [0.3, 0.6, 1.0]),
    ([1.9, 1.7], 2.0, [0.7, 0.75], [0.4, 1.0, 0.4]),
    ([2.5, 2.0], 1.1, [0.2, -0.5], [1.0, 0.3, 0.6]),
    ([3.0, 2.4], 0.5, [0.55, 0.5], [0.9, 0.9, 0.3]),
    ([3.6, 2.6], 1.7, [0.9, -0.75], [0.5, 0.4, 1.0]),
];

/// Those that stay where they are.
const STANDING: [([f64; 3], [f64; 3]); 2] =
    [([1.6, -1.2, 0.4], [1.0, 0.8, 0.5]), ([-3.2, 2.2, 1.4], [0.5, 1.0, 0.9])];

pub(crate) fn room() -> String {
    let mut text = String::from(
        "# A room of 8 x 6 x 3 around figure.glb: 4 lights below the ceiling, 8 small ones (6 fly about), and 192 discs that shine as\n\
         # floor and walls do by the light of the 4. Made by formats/examples/rig_testdata.\n\n",
    );
    _ = writeln!(text, "[sequence]\nframes = {FRAMES}\n\n[object]");
    _ = writeln!(
        text,
        "keys = [{{ time = 0.0, position = [-0.3, 0.0, 0.15], rotation_deg = [0.0, 0.0, -8.0] }},"
    );
    _ = writeln!(
        text,
        "        {{ time = 1.0, position = [0.3, 0.1, 0.15], rotation_deg = [0.0, 0.0, 12.0] }}]"
    );
    let swinging = [
        ("arm_left", [0.0, SHOULDERS_ASIDE, SHOULDERS], 25.0),
        ("arm_right", [0.0, -SHOULDERS_ASIDE, SHOULDERS], -25.0),
        ("leg_left", [0.0, HIPS_ASIDE, HIPS], -20.0),
        ("leg_right", [0.0, -HIPS_ASIDE, HIPS], 20.0),
    ];
    for (name, [x, y, z], degrees) in swinging {
        _ = writeln!(text, "\n[[part]]\nname = \"{name}\"\npivot = [{x:.2}, {y:.2}, {z:.2}]\nkeys = [");
        for (time, share) in [(0.0, 0.0), (0.25, 1.0), (0.5, 0.0), (0.75, -1.0), (1.0, 0.0)] {
            let angle = share * degrees;
            _ = writeln!(text, "  {{ time = {time:.2}, rotation_deg = [0.0, {angle:.1}, 0.0] }},");
        }
        text += "]\n";
    }
    for (index, Ceiling { position, color, intensity }) in CEILING.iter().enumerate() {
        _ = writeln!(text, "\n[[light]]\nkind = \"sphere\"\nname = \"ceiling {}\"", index + 1);
        _ = writeln!(
            text,
            "position = {}\nradius = 0.15\nintensity = {intensity}\ncolor = {}",
            list(*position),
            list(*color)
        );
    }
    for (index, ([a, b], height, [start, turns], color)) in FLYING.iter().enumerate() {
        _ = writeln!(text, "\n[[light]]\nkind = \"sphere\"\nname = \"flying {}\"", index + 1);
        _ = writeln!(text, "radius = 0.03\nintensity = 0.2\ncolor = {}\nkeys = [", list(*color));
        for step in 0..=12 {
            let time = f64::from(step) / 12.0;
            let angle = 2.0 * PI * (start + turns * time);
            let position = [a * libm::cos(angle), b * libm::sin(angle), *height];
            _ = writeln!(text, "  {{ time = {time:.4}, position = {} }},", list(position));
        }
        text += "]\n";
    }
    for (index, (position, color)) in STANDING.iter().enumerate() {
        _ = writeln!(text, "\n[[light]]\nkind = \"sphere\"\nname = \"standing {}\"", index + 1);
        _ = writeln!(
            text,
            "position = {}\nradius = 0.03\nintensity = 0.2\ncolor = {}",
            list(*position),
            list(*color)
        );
    }
    for wall in &WALLS {
        for (position, normal, area) in wall.patches() {
            let light = CEILING.iter().fold([0.0; 3], |sum, lamp| {
                let toward = difference(lamp.position, position);
                let distance = length(toward);
                // Irradiance / pi: the lamps are small and wholly above the wall.
                let reflected =
                    lamp.intensity * dot(normal, toward).max(0.0) / (distance * distance * distance);
                [0, 1, 2].map(|i| sum[i] + wall.albedo[i] * lamp.color[i] * reflected)
            });
            _ = writeln!(
                text,
                "\n[[light]]\nkind = \"disc\"\nname = \"{}\"\nposition = {}",
                wall.name,
                list(position)
            );
            _ = writeln!(
                text,
                "direction = {}\nradius = {:.4}\nradiance = 1.0\ncolor = {}",
                list(normal),
                (area / PI).sqrt(),
                list(light)
            );
        }
    }
    text
}

impl Wall {
    /// Middle, normal into the room and area of each patch.
    fn patches(&self) -> impl Iterator<Item = ([f64; 3], [f64; 3], f64)> + '_ {
        let Self { axis, upper, patches: [columns, rows], .. } = *self;
        let [u, v] = match axis {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        };
        let steps = [(HIGH[u] - LOW[u]) / columns as f64, (HIGH[v] - LOW[v]) / rows as f64];
        (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row))).map(
            move |(column, row)| {
                let (mut position, mut normal) = ([0.0; 3], [0.0; 3]);
                position[u] = LOW[u] + (column as f64 + 0.5) * steps[0];
                position[v] = LOW[v] + (row as f64 + 0.5) * steps[1];
                position[axis] = if upper { HIGH[axis] } else { LOW[axis] };
                normal[axis] = if upper { -1.0 } else { 1.0 };
                (position, normal, steps[0] * steps[1])
            },
        )
    }
}

/// Four digits of each, without a sign before 0.
fn list(v: [f64; 3]) -> String {
    let [x, y, z] =
        v.map(|c| format!("{:.4}", c + 0.0)).map(|c| if c == "-0.0000" { "0.0000".to_owned() } else { c });
    format!("[{x}, {y}, {z}]")
}
