//! Plots of cost against accuracy, as SVG.

use super::escape::html;
use super::ticks::Axis;
use std::fmt::Write as _;

/// A choice in a plot.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) name: String,
    pub(super) cost: f64,
    pub(super) psnr: f64,
    /// Whether no other choice beats it.
    pub(super) front: bool,
    /// Whether it is the one that is shown.
    pub(super) chosen: bool,
}

/// What a plot's axis of costs is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cost {
    pub(super) title: &'static str,
    pub(super) label: &'static str,
    pub(super) unit: &'static str,
}

const WIDTH: f64 = 440.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 46.0;

/// Width of a character of a label, about.
const CHARACTER: f64 = 6.2;

/// Height of a label's line.
const LINE: f64 = 13.0;

/// The plot of `points`, choices that are on the front joined by steps: what each cost at least gives at most.
pub(super) fn plot(cost: Cost, points: &[Point]) -> String {
    let xs = Axis::of(&points.iter().map(|p| p.cost).collect::<Vec<_>>(), true);
    let ys = Axis::of(&points.iter().map(|p| p.psnr).collect::<Vec<_>>(), false);
    let x = |value: f64| LEFT + xs.place(value) * (WIDTH - LEFT - RIGHT);
    let y = |value: f64| HEIGHT - BOTTOM - ys.place(value) * (HEIGHT - TOP - BOTTOM);
    let mut svg = format!(
        "<figure class=\"plot\"><figcaption>{}</figcaption><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}: PSNR in dB against {} of {} choices; the table has the numbers\">",
        html(cost.title),
        html(cost.title),
        html(cost.label),
        points.len()
    );
    let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
    for (value, label) in &xs.ticks {
        let at = x(*value);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom}\"/><text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
            bottom + 16.0
        );
    }
    for (value, label) in &ys.ticks {
        let at = y(*value);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            LEFT - 6.0,
            at + 4.0
        );
    }
    let scale = if xs.logarithmic { ", logarithmic" } else { "" };
    let _ = write!(
        svg,
        "<text class=\"axis\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}{scale}</text><text class=\"axis\" x=\"13\" y=\"{:.1}\" text-anchor=\"middle\" transform=\"rotate(-90 13 {:.1})\">PSNR, dB</text>",
        (LEFT + right) / 2.0,
        HEIGHT - 10.0,
        html(cost.label),
        (TOP + bottom) / 2.0,
        (TOP + bottom) / 2.0
    );
    let mut front: Vec<&Point> = points.iter().filter(|point| point.front).collect();
    front.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut path = String::new();
    for (i, point) in front.iter().enumerate() {
        let (x, y) = (x(point.cost), y(point.psnr));
        let _ = if i == 0 { write!(path, "M{x:.1} {y:.1}") } else { write!(path, "H{x:.1}V{y:.1}") };
    }
    if !path.is_empty() {
        let _ = write!(svg, "<path class=\"front\" d=\"{path}H{right}\"/>");
    }
    // The chosen one on top, and its label first.
    let mut order: Vec<&Point> = points.iter().collect();
    order.sort_by_key(|point| (point.chosen, point.front));
    for point in &order {
        let class = match (point.chosen, point.front) {
            (true, _) => "point chosen",
            (false, true) => "point onfront",
            (false, false) => "point",
        };
        let radius = if point.chosen { 6.5 } else { 4.0 };
        let _ = write!(
            svg,
            "<circle class=\"{class}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\"><title>{}: {:.2} dB, {} {}{}</title></circle>",
            x(point.cost),
            y(point.psnr),
            html(&point.name),
            point.psnr,
            significant(point.cost),
            html(cost.unit),
            if point.chosen { ", chosen" } else { "" }
        );
    }
    let marks: Vec<(f64, f64)> = points.iter().map(|point| (x(point.cost), y(point.psnr))).collect();
    let mut taken: Vec<[f64; 4]> = Vec::new();
    for point in order.iter().rev().filter(|point| point.front || point.chosen) {
        let length = point.name.chars().count() as f64 * CHARACTER;
        let (px, py) = (x(point.cost), y(point.psnr));
        let places = [
            (px - 8.0 - length, py - 5.0),
            (px + 8.0, py + LINE),
            (px + 8.0, py - 5.0),
            (px - 8.0 - length, py + LINE),
        ];
        let free = places.into_iter().find(|&(left, base)| {
            let label = [left, base - LINE + 3.0, left + length, base + 2.0];
            let inside = label[0] >= LEFT && label[2] <= right && label[1] >= TOP - 8.0 && label[3] <= bottom;
            let apart = |other: &[f64; 4]| {
                label[2] < other[0] || other[2] < label[0] || label[3] < other[1] || other[3] < label[1]
            };
            let covers = |&(mx, my): &(f64, f64)| {
                mx > label[0] - 4.0 && mx < label[2] + 4.0 && my > label[1] - 4.0 && my < label[3] + 4.0
            };
            inside && taken.iter().all(apart) && !marks.iter().any(covers)
        });
        if let Some((left, base)) = free {
            taken.push([left, base - LINE + 3.0, left + length, base + 2.0]);
            let class = if point.chosen { "label chosen" } else { "label" };
            let _ = write!(
                svg,
                "<text class=\"{class}\" x=\"{left:.1}\" y=\"{base:.1}\">{}</text>",
                html(&point.name)
            );
        }
    }
    svg.push_str("</svg></figure>");
    svg
}

/// A number with three digits or all of those before its point.
fn significant(value: f64) -> String {
    let decimals = match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 1.0 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_a_staircase_and_names_are_escaped() {
        let point = |name: &str, cost, psnr, front, chosen| Point {
            name: name.to_owned(),
            cost,
            psnr,
            front,
            chosen,
        };
        let points = [
            point("b", 20.0, 35.0, true, true),
            point("<a&>", 10.0, 30.0, true, false),
            point("c", 20.0, 31.0, false, false),
        ];
        let svg = plot(Cost { title: "Bytes", label: "bytes a pixel", unit: "bytes a pixel" }, &points);
        let path = svg.split_once("class=\"front\" d=\"").unwrap().1.split_once('"').unwrap().0;
        // From the cheapest: on to the next cost at the same quality, then up to its quality, on to the edge.
        let x = |value: f64| LEFT + (value - 10.0 - -2.0) / (22.0 - 8.0) * (WIDTH - LEFT - RIGHT);
        let y = |value: f64| HEIGHT - BOTTOM - (value - 29.0) / (36.0 - 29.0) * (HEIGHT - TOP - BOTTOM);
        let expected =
            format!("M{:.1} {:.1}H{:.1}V{:.1}H{}", x(10.0), y(30.0), x(20.0), y(35.0), WIDTH - RIGHT);
        assert_eq!(path, expected, "{svg}");
        assert!(svg.contains("<title>&lt;a&amp;&gt;: 30.00 dB, 10.0 bytes a pixel</title>"), "{svg}");
        assert!(svg.contains("<title>b: 35.00 dB, 20.0 bytes a pixel, chosen</title>"), "{svg}");
    }
}
