//! The light sphere seen from the camera, as SVG or PNG from one list of shapes.

use crate::failure::Failure;
use crate::options::check_writable;
use font8x8::UnicodeFonts;
use relight_core::LightSet;
use relight_core::relighter::Picture;
use relight_core::sphere::largest_hole;
use relight_formats::{PictureDepth, write_picture, write_whole};
use std::fmt::Write as _;
use std::path::Path;

/// Side of the drawing in pixels.
const SIDE: usize = 640;

/// Radius of the horizon's circle.
const HORIZON: f64 = 280.0;

/// Samples across a pixel of the PNG.
const OVERSAMPLING: usize = 3;

const PAPER: [u8; 3] = [255, 255, 255];
const GRID: [u8; 3] = [170, 178, 189];
const INK: [u8; 3] = [31, 41, 55];
const LIGHT: [u8; 3] = [202, 98, 10];
const BELOW: [u8; 3] = [37, 99, 180];
const HOLE: [u8; 3] = [200, 30, 60];

enum Shape {
    Disc { x: f64, y: f64, radius: f64, color: [u8; 3] },
    Ring { x: f64, y: f64, radius: f64, width: f64, color: [u8; 3] },
    Label { x: f64, y: f64, text: String, color: [u8; 3] },
}

/// How a drawing is kept.
enum Kind {
    Svg,
    Png,
}

fn kind_of(path: &Path) -> Result<Kind, Failure> {
    match path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).as_deref() {
        Some("svg") => Ok(Kind::Svg),
        Some("png") => Ok(Kind::Png),
        _ => Err(Failure::usage(format!("--plot {}: plots are written as .svg or .png", path.display()))),
    }
}

/// Fails when no drawing can be written to `path`.
pub(super) fn check(path: &Path) -> Result<(), Failure> {
    kind_of(path)?;
    check_writable(path)
}

/// Draws `lights` to `path`, by its extension.
pub(super) fn write(path: &Path, lights: &LightSet) -> Result<(), Failure> {
    let shapes = shapes(lights);
    match kind_of(path)? {
        Kind::Svg => Ok(write_whole(path, svg(&shapes).as_bytes())?),
        Kind::Png => Ok(write_picture(path, &raster(&shapes), PictureDepth::U8)?),
    }
}

/// Orthographic view: a light at (x, y) of the picture plane, the horizon a circle; lights below
/// the picture plane stand where they would be seen through it, in another colour.
fn shapes(lights: &LightSet) -> Vec<Shape> {
    let middle = SIDE as f64 / 2.0;
    let mut shapes = Vec::new();
    for elevation in [0.0f64, 30.0, 60.0] {
        let radius = HORIZON * libm::cos(elevation.to_radians());
        let width = if elevation == 0.0 { 2.0 } else { 1.0 };
        shapes.push(Shape::Ring { x: middle, y: middle, radius, width, color: GRID });
        let text = format!("{elevation:.0} deg");
        shapes.push(Shape::Label { x: middle + 4.0, y: middle - radius - 6.0, text, color: INK });
    }
    if let Some(hole) = largest_hole(&lights.directions()) {
        let (x, y) = (middle + HORIZON * hole.centre.x(), middle - HORIZON * hole.centre.y());
        shapes.push(Shape::Ring { x, y, radius: 9.0, width: 2.5, color: HOLE });
        let text = format!("largest hole {:.0} deg", hole.radius.to_degrees());
        let x = (x + 14.0).min(SIDE as f64 - 8.0 * text.len() as f64 - 4.0);
        shapes.push(Shape::Label { x, y: y + 4.0, text, color: HOLE });
    }
    for light in &lights.lights {
        let (x, y) = (middle + HORIZON * light.direction.x(), middle - HORIZON * light.direction.y());
        let color = if light.direction.z() < 0.0 { BELOW } else { LIGHT };
        shapes.push(Shape::Disc { x, y, radius: 4.5, color });
    }
    let below = lights.lights.iter().filter(|light| light.direction.z() < 0.0).count();
    let seen = if below > 0 { format!(", {below} below the picture plane (blue)") } else { String::new() };
    let text = format!("{} lights{seen}; x right, y up", lights.len());
    shapes.push(Shape::Label { x: 12.0, y: SIDE as f64 - 12.0, text, color: INK });
    shapes
}

fn svg(shapes: &[Shape]) -> String {
    let hex = |c: &[u8; 3]| format!("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {SIDE} {SIDE}\" width=\"{SIDE}\" height=\"{SIDE}\">\n\
         <rect width=\"{SIDE}\" height=\"{SIDE}\" fill=\"{}\"/>\n",
        hex(&PAPER)
    );
    for shape in shapes {
        // Writing to a string can't fail.
        let _ = match shape {
            Shape::Disc { x, y, radius, color } => {
                writeln!(
                    text,
                    "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\" fill=\"{}\"/>",
                    hex(color)
                )
            }
            Shape::Ring { x, y, radius, width, color } => writeln!(
                text,
                "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\"/>",
                hex(color)
            ),
            Shape::Label { x, y, text: words, color } => writeln!(
                text,
                "<text x=\"{x:.2}\" y=\"{y:.2}\" font-family=\"sans-serif\" font-size=\"14\" fill=\"{}\">{words}</text>",
                hex(color)
            ),
        };
    }
    text + "</svg>\n"
}

fn raster(shapes: &[Shape]) -> Picture {
    let fine = SIDE * OVERSAMPLING;
    let mut pixels = vec![PAPER; fine * fine];
    let scale = OVERSAMPLING as f64;
    let mut paint = |x: i64, y: i64, color: [u8; 3]| {
        if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y))
            && x < fine
            && y < fine
        {
            pixels[y * fine + x] = color;
        }
    };
    for shape in shapes {
        match shape {
            Shape::Disc { x, y, radius, color } => {
                circle(*x, *y, 0.0, *radius, |x, y| paint(x, y, *color));
            }
            Shape::Ring { x, y, radius, width, color } => {
                circle(*x, *y, radius - width / 2.0, radius + width / 2.0, |x, y| paint(x, y, *color));
            }
            Shape::Label { x, y, text, color } => {
                for (i, character) in text.chars().enumerate() {
                    let glyph = font8x8::BASIC_FONTS.get(character).unwrap_or([0; 8]);
                    let (left, top) = ((x + 8.0 * i as f64) * scale, (y - 8.0) * scale);
                    for (row, bits) in glyph.into_iter().enumerate() {
                        for column in (0..8).filter(|column| bits >> column & 1 == 1) {
                            for dot in 0..OVERSAMPLING * OVERSAMPLING {
                                let dx = (column * OVERSAMPLING + dot % OVERSAMPLING) as i64;
                                let dy = (row * OVERSAMPLING + dot / OVERSAMPLING) as i64;
                                paint(left as i64 + dx, top as i64 + dy, *color);
                            }
                        }
                    }
                }
            }
        }
    }
    let mut samples = vec![0.0; SIDE * SIDE * 3];
    for (i, sample) in samples.iter_mut().enumerate() {
        let (x, y, channel) = (i / 3 % SIDE, i / 3 / SIDE, i % 3);
        let mut sum = 0.0;
        for dot in 0..OVERSAMPLING * OVERSAMPLING {
            let (fx, fy) = (x * OVERSAMPLING + dot % OVERSAMPLING, y * OVERSAMPLING + dot / OVERSAMPLING);
            sum += f32::from(pixels[fy * fine + fx][channel]);
        }
        *sample = sum / (255 * OVERSAMPLING * OVERSAMPLING) as f32;
    }
    Picture { width: SIDE, height: SIDE, channels: 3, samples }
}

/// Visits the fine pixels between two circles around (x, y).
fn circle(x: f64, y: f64, inner: f64, outer: f64, mut visit: impl FnMut(i64, i64)) {
    let scale = OVERSAMPLING as f64;
    let (x, y, inner, outer) = (x * scale, y * scale, inner * scale, outer * scale);
    for fine_y in (y - outer).floor() as i64..=(y + outer).ceil() as i64 {
        for fine_x in (x - outer).floor() as i64..=(x + outer).ceil() as i64 {
            let (dx, dy) = (fine_x as f64 + 0.5 - x, fine_y as f64 + 0.5 - y);
            let distance = (dx * dx + dy * dy).sqrt();
            if distance >= inner && distance <= outer {
                visit(fine_x, fine_y);
            }
        }
    }
}
