//! Lights side by side in f32 against one after the other in f64.

use crate::{COLOR, Random, apart, disc, largest, light, sphere};
use relight_core::CpuLevel;
use relight_rig::{Light, MOST_BANDS, Projector, Source};

type Slopes = Vec<[f64; 3]>;

/// Values and slopes (axis after axis) by the projector.
fn fast(projector: &Projector, level: CpuLevel, point: [f64; 3], bands: usize) -> (Vec<[f64; 3]>, Slopes) {
    let n = bands * bands;
    let (mut values, mut slopes) = (vec![[f64::NAN; 3]; n], vec![[[f64::NAN; 3]; 3]; n]);
    projector.project_with_gradient(level, point, &mut values, &mut slopes);
    // Alone, discs go another way.
    projector.project(level, point, &mut values);
    (values, slopes.into_iter().flatten().collect())
}

fn slow(lights: &[(&Light, f64)], point: [f64; 3], bands: usize) -> (Vec<[f64; 3]>, Slopes) {
    let n = bands * bands;
    let (mut values, mut slopes) = (vec![[0.0; 3]; n], vec![[[0.0; 3]; 3]; n]);
    for &(light, factor) in lights {
        let light = Light { color: light.color.map(|c| c * factor), ..light.clone() };
        light.add_projection_with_gradient(point, bands, &mut values, &mut slopes);
    }
    (values, slopes.into_iter().flatten().collect())
}

fn compare(lights: &[(&Light, f64)], ball: ([f64; 3], f64), points: &[[f64; 3]], bounds: [f64; 2]) {
    for bands in 1..=MOST_BANDS {
        let projector = Projector::new(lights, bands, ball);
        for &point in points {
            let (found, exact) =
                (fast(&projector, CpuLevel::detect(), point, bands), slow(lights, point, bands));
            let errors = [(&found.0, &exact.0), (&found.1, &exact.1)]
                .map(|(found, exact)| apart(found, exact) / largest(exact).max(f64::MIN_POSITIVE));
            let mut values = vec![[f64::NAN; 3]; bands * bands];
            let mut unused = vec![[[f64::NAN; 3]; 3]; bands * bands];
            projector.project_with_gradient(CpuLevel::detect(), point, &mut values, &mut unused);
            let beside = apart(&values, &exact.0) / largest(&exact.0).max(f64::MIN_POSITIVE);
            assert!(beside <= bounds[0], "{bands} bands {point:?}: {beside} beside slopes");
            assert!(errors[0] <= bounds[0] && errors[1] <= bounds[1], "{bands} bands {point:?}: {errors:?}");
        }
    }
}

fn refer(lights: &[Light]) -> Vec<(&Light, f64)> {
    lights.iter().enumerate().map(|(i, light)| (light, 0.5 + (i % 3) as f64)).collect()
}

#[test]
fn many_lights_of_all_kinds_but_discs() {
    let mut random = Random(21);
    for count in [1, 5, 16, 17, 300] {
        let lights: Vec<_> = std::iter::repeat_with(|| random.light())
            .filter(|light| !matches!(light.source, Source::Disc { .. }))
            .take(count)
            .collect();
        let points: Vec<_> = (0..4).map(|_| random.vector().map(|c| 0.5 * c)).collect();
        compare(&refer(&lights), ([0.0; 3], 1.0), &points, [2e-6, 2e-6]);
    }
}

/// Every rule, and right in front, where no rule does.
#[test]
fn discs_at_all_distances() {
    let mut random = Random(22);
    let of_values = [1.62, 2.13, 2.55, 2.85, 4.0, 6.5, 15.2];
    let of_slopes = [1.62, 2.35, 2.8, 3.05, 4.35, 7.1, 17.5];
    for distance in [0.3, 1.2, 1.75, 2.0, 100.0].into_iter().chain(of_values).chain(of_slopes) {
        for _ in 0..40 {
            let (away, mut normal) = (random.direction(), random.direction());
            if crate::dot(away, normal) > 0.0 {
                normal = normal.map(|c| -c);
            }
            let light = disc(away.map(|c| 1.000_001 * distance * c), normal, 1.0);
            compare(&[(&light, 1.0)], ([0.0; 3], 0.0), &[[0.0; 3]], [1e-4, 1e-4]);
        }
    }
}

#[test]
fn ten_thousand_lights_and_none() {
    let mut random = Random(23);
    let lights: Vec<_> = (0..10_000)
        .map(|_| {
            let (away, distance) = (random.direction(), 4.0 + 3.0 * random.number());
            Light {
                color: random.vector().map(f64::abs),
                ..sphere(away.map(|c| c * distance), 0.2 + 0.1 * random.number())
            }
        })
        .collect();
    compare(&refer(&lights), ([0.0; 3], 0.9), &[[0.1, 0.5, -0.3]], [2e-6, 2e-6]);
    let none = Projector::new(&[], 3, ([0.0; 3], 1.0));
    let (values, slopes) = fast(&none, CpuLevel::detect(), [0.0; 3], 3);
    assert!(largest(&values) == 0.0 && largest(&slopes) == 0.0);
    // Equal lights added up one by one in f32 are off by fifty times as much.
    let one_by_one = (0..10_000).fold(0.0f32, |sum, _| sum + 0.1);
    assert!((f64::from(one_by_one) / (1e4 * f64::from(0.1f32)) - 1.0).abs() > 5e-5, "{one_by_one}");
}

#[test]
fn far_origins_and_radii_of_any_size() {
    let far = 1e6;
    let at = |v: [f64; 3]| v.map(|c| c + far);
    let lights = [
        sphere(at([0.5, -2.0, 1.0]), 0.3),
        light(Source::Point { position: at([2.0, 2.0, 2.0]), nearest: 0.1 }),
    ];
    compare(&refer(&lights), (at([0.0; 3]), 0.5), &[at([0.3, 0.2, -0.1]), at([0.0; 3])], [2e-6, 2e-6]);
    // In f32 the point itself is off by 0.03 there.
    assert!((f64::from((far + 0.3) as f32) - (far + 0.3)).abs() > 0.01);
    let tiny = Light { color: COLOR.map(|c| c * 1e60), ..sphere([0.5, -2.0, 1.0], 1e-30) };
    let huge = sphere([0.0, 0.0, -2e30], 1e30);
    compare(&[(&tiny, 1.0), (&huge, 1.0)], ([0.0; 3], 1.0), &[[0.1, 0.2, 0.3]], [2e-6, 2e-6]);
    compare(&[(&huge, 1.0)], ([0.0; 3], 1.0), &[[0.1, 0.2, 0.3]], [2e-6, 2e-6]);
}

/// From near the surface through it to the middle.
#[test]
fn spheres_that_are_touched_or_entered() {
    let light = sphere([0.0, 0.0, 1.0], 1.0);
    let ball = ([0.0; 3], 2.0);
    for z in [-1e-6, -1e-9, 0.0, 1e-9, 0.5, 0.999] {
        // Even bands' slopes are huge right outside; all others are measured by them.
        compare(&[(&light, 1.0)], ball, &[[0.0, 0.0, z], [0.1 * z, -0.1 * z, z]], [2e-6, 4e-6]);
    }
    let projector = Projector::new(&[(&light, 1.0)], 6, ball);
    let middle = fast(&projector, CpuLevel::detect(), [0.0, 0.0, 1.0], 6);
    let exact = slow(&[(&light, 1.0)], [0.0, 0.0, 1.0], 6);
    assert!(apart(&middle.0, &exact.0) < 2e-6 && largest(&middle.1) == 0.0);
}

#[test]
fn every_level_gives_the_same_bits() {
    let mut random = Random(24);
    let lights: Vec<_> = (0..700).map(|_| random.light()).collect();
    for bands in 1..=MOST_BANDS {
        let projector = Projector::new(&refer(&lights), bands, ([0.0; 3], 1.0));
        let expected = fast(&projector, CpuLevel::BASELINE, [0.2, 0.3, -0.4], bands);
        for level in CpuLevel::available() {
            assert_eq!(fast(&projector, level, [0.2, 0.3, -0.4], bands), expected, "{}", level.name());
        }
    }
}
