//! Curves and marks on logarithmic axes, as SVG.

use crate::page::{Axis, html};
use std::fmt::Write as _;

/// A drawing with axes.
pub(super) struct Panel {
    pub(super) title: String,
    pub(super) x: String,
    pub(super) y: String,
    pub(super) curves: Vec<Curve>,
    pub(super) marks: Vec<Mark>,
}

/// A line through places.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
}

/// A place with a name.
pub(super) struct Mark {
    pub(super) name: String,
    pub(super) place: (f64, f64),
}

/// Of the axes.
const ACROSS: f64 = 438.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 72.0;
/// Left of the names of curves.
const BEFORE_NAMES: f64 = 40.0;
/// Of a letter, about.
const LETTER: f64 = 7.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 56.0;

/// Colours that people of all kinds of sight tell apart.
///
/// Source: Okabe and Ito, *Color Universal Design*, 2008; without yellow, which paper hides.
const COLORS: [&str; 7] = ["#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"];

/// The panels one below another.
pub(super) fn svg(panels: &[Panel]) -> String {
    let names = panels.iter().flat_map(|panel| {
        panel.curves.iter().map(|curve| &curve.name).chain(panel.marks.iter().map(|mark| &mark.name))
    });
    let longest = names.map(|name| name.chars().count()).max().unwrap_or(0);
    let width = LEFT + ACROSS + BEFORE_NAMES + LETTER * longest.max(16) as f64;
    let height = HEIGHT * panels.len() as f64;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"12\" fill=\"#1f2937\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    for (i, panel) in panels.iter().enumerate() {
        let _ = writeln!(text, "<g transform=\"translate(0 {})\">", HEIGHT * i as f64);
        draw(&mut text, panel);
        text += "</g>\n";
    }
    text + "</svg>\n"
}

/// What a logarithm can show.
fn is_shown(&(x, y): &(f64, f64)) -> bool {
    x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()
}

fn draw(text: &mut String, panel: &Panel) {
    let places = panel.curves.iter().flat_map(|curve| curve.points.iter().copied());
    let places: Vec<_> = places.chain(panel.marks.iter().map(|mark| mark.place)).filter(is_shown).collect();
    let xs = Axis::of(&places.iter().map(|place| place.0).collect::<Vec<_>>(), true);
    let ys = Axis::of(&places.iter().map(|place| place.1).collect::<Vec<_>>(), true);
    let (bottom, right) = (HEIGHT - BOTTOM, LEFT + ACROSS);
    let x = |value: f64| LEFT + xs.place(value) * (right - LEFT);
    let y = |value: f64| bottom - ys.place(value) * (bottom - TOP);
    // Writing to a string can't fail.
    let _ = writeln!(text, "<text x=\"{LEFT}\" y=\"22\" font-size=\"15\">{}</text>", html(&panel.title));
    for (value, label) in &xs.ticks {
        let at = x(*value);
        let _ = writeln!(
            text,
            "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"#d5dae1\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
            bottom + 16.0
        );
    }
    for (value, label) in &ys.ticks {
        let at = y(*value);
        let _ = writeln!(
            text,
            "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#d5dae1\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            LEFT - 6.0,
            at + 4.0
        );
    }
    let middle = 0.5 * (TOP + bottom);
    let _ = writeln!(
        text,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text><text x=\"16\" y=\"{middle:.1}\" text-anchor=\"middle\" \
         transform=\"rotate(-90 16 {middle:.1})\">{}</text>",
        0.5 * (LEFT + right),
        HEIGHT - 16.0,
        html(&panel.x),
        html(&panel.y)
    );
    for (i, curve) in panel.curves.iter().enumerate() {
        let color = COLORS[i % COLORS.len()];
        let dashes = if i < COLORS.len() { "" } else { " stroke-dasharray=\"6 3\"" };
        let mut path = String::new();
        for &(px, py) in curve.points.iter().filter(|place| is_shown(place)) {
            let _ = write!(path, "{}{:.1} {:.1}", if path.is_empty() { 'M' } else { 'L' }, x(px), y(py));
        }
        let row = TOP + 10.0 + 18.0 * i as f64;
        let _ = writeln!(
            text,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"{dashes}/><path d=\"M{:.1} {row}h22\" stroke=\"{color}\" \
             stroke-width=\"2\"{dashes}/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            right + 12.0,
            right + BEFORE_NAMES,
            row + 4.0,
            html(&curve.name)
        );
    }
    for (i, mark) in panel.marks.iter().enumerate().filter(|(_, mark)| is_shown(&mark.place)) {
        let (px, py) = (x(mark.place.0), y(mark.place.1));
        let color = COLORS[i % COLORS.len()];
        let row = TOP + 10.0 + 18.0 * i as f64;
        let _ = writeln!(
            text,
            "<circle cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"5\" fill=\"{color}\"/><circle cx=\"{:.1}\" cy=\"{row}\" r=\"5\" fill=\"{color}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            right + 23.0,
            right + BEFORE_NAMES,
            row + 4.0,
            html(&mark.name)
        );
    }
}
