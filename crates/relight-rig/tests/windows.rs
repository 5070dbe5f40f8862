//! Irradiance that rings below 0, and windows against it.

#![allow(clippy::unwrap_used, reason = "tests")]

mod shapes;

use relight_core::CpuLevel;
use relight_rig::{
    Bands, Fitting, Ground, Light, Model, Pixels, PlacedPart, Placement, RigPart, Ringing, Source, Window,
};

fn sun() -> Light {
    Light {
        name: String::new(),
        source: Source::Directional { direction: [0.6, 0.0, 0.8] },
        color: [1.0, 0.5, 0.25],
    }
}

fn part() -> RigPart {
    let shape = shapes::sphere(32);
    let ground = Ground::new("", &shape.surface(), 64).unwrap();
    ground.without_errors(&Model::parse("constant").unwrap(), Fitting::Surface)
}

/// Irradiance of three bands in units of that at normal incidence, by the cosine: 1/4 + x/2 + 5/16 P_2(x).
fn ringing(x: f64, [one, two]: [f64; 2]) -> f64 {
    0.25 + one * 0.5 * x + two * 5.0 / 32.0 * (3.0 * x * x - 1.0)
}

/// The lowest of it over the sphere.
fn lowest(factors: [f64; 2]) -> f64 {
    (-2000..=2000).map(|i| ringing(f64::from(i) / 2000.0, factors)).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_sun_in_three_bands_rings_by_a_twenty_fifth() {
    let part = part();
    let placed = PlacedPart { part: &part, placement: Placement::IDENTITY };
    let by_band = placed.reflectance_by_band(&[sun()], None, 3, CpuLevel::detect());
    let found = Ringing::of(Window::NONE.of_points(&by_band));
    // 3/32 + x/2 + 15/32 x^2: its roots are -.2428 and -.8239, its largest value 1.0625, its lowest 3/32 - 2/15.
    assert!((found.lowest - (3.0 / 32.0 - 2.0 / 15.0) / 1.0625).abs() < 1e-3, "{found:?}");
    assert!((found.share() - 0.5 * (0.8239 - 0.2428)).abs() < 0.015, "{found:?}");
    // Pixels show the same, and the window of a drawing mends it.
    let mut pixels = Pixels::default();
    for point in &part.surface {
        pixels.push(&placed, point.position, point.normal);
    }
    let of_pixels = |bands: Bands| {
        let [r, g, b] = pixels.by_rig(&placed, &[sun()], bands, CpuLevel::detect());
        Ringing::of((0..r.len()).map(|i| [r[i], g[i], b[i]].map(f64::from)))
    };
    let drawn = of_pixels(3.into());
    assert!(drawn.negative == found.negative && (drawn.lowest - found.lowest).abs() < 1e-5, "{drawn:?}");
    let window = Window::least(&by_band);
    assert_eq!(of_pixels(Bands { count: 3, window }).negative, 0);
}

#[test]
fn the_least_window_is_the_least_of_all_that_leave_nothing_below_0() {
    let part = part();
    let placed = PlacedPart { part: &part, placement: Placement::IDENTITY };
    let by_band = placed.reflectance_by_band(&[sun()], None, 3, CpuLevel::detect());
    let [_, one, two, ..] = Window::least(&by_band).factors;
    // Mean squares over the sphere: 1/12 of band 1, (5/16)^2 / 5 of band 2.
    let cost = |[one, two]: [f64; 2]| {
        (1.0 - one).powi(2) / 12.0 + (1.0 - two).powi(2) * (5.0f64 / 16.0).powi(2) / 5.0
    };
    assert!(lowest([one, two]) > -2e-3, "{one} {two}: {}", lowest([one, two]));
    let grid = (0..=100).flat_map(|i| (0..=100).map(move |k| [f64::from(i), f64::from(k)].map(|v| 0.01 * v)));
    let best =
        grid.filter(|factors| lowest(*factors) >= 0.0).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap();
    assert!(
        cost([one, two]) <= cost(best) + 1e-5,
        "{one} {two}: {} for {best:?}: {}",
        cost([one, two]),
        cost(best)
    );
    // The usual windows leave some below 0, and change more.
    for usual in [Window::hanning(3.0), Window::lanczos(3.0)] {
        let [_, one, two, ..] = usual.factors;
        println!("{one:.3} {two:.3}: lowest {:.3}, cost {:.4}", lowest([one, two]), cost([one, two]));
        assert!(lowest([one, two]) < -0.01 && cost([one, two]) > cost(best));
    }
    println!("least {one:.3} {two:.3}: cost {:.4}", cost([one, two]));
    // Light that does not ring is left alone.
    let soft = [vec![[1.0; 3], [0.3; 3], [0.1; 3]], vec![[1.0; 3], [-0.3; 3], [0.1; 3]]];
    assert_eq!(Window::least(&soft).factors, Window::NONE.factors);
}

#[test]
fn windows_are_what_they_are_called() {
    let [first, second, third, rest @ ..] = Window::hanning(3.0).factors;
    assert!(
        first == 1.0 && (second - 0.75).abs() < 1e-12 && (third - 0.25).abs() < 1e-12 && rest == [0.0; 4]
    );
    let [first, second, third, ..] = Window::lanczos(2.0).factors;
    assert!(first == 1.0 && (second - std::f64::consts::FRAC_2_PI).abs() < 1e-12 && third == 0.0);
    assert_eq!(Window::lanczos(f64::INFINITY).factors, Window::NONE.factors);
    let mut coefficients = vec![[2.0; 3]; 18];
    Window::hanning(3.0).apply(3, &mut coefficients);
    for (i, expected) in [(0, 2.0), (1, 1.5), (4, 0.5), (8, 0.5), (9, 2.0), (10, 1.5)] {
        assert!((coefficients[i][2] - expected).abs() < 1e-12, "{i}: {:?}", coefficients[i]);
    }
}
