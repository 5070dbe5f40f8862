//! Ranges of awkward planes (docs/stability.md), and whether what is predicted comes true.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

use relight_core::maps::{RelightingMap, Texels};
use relight_core::metrics::compare;
use relight_core::relighter::relight;
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{
    Basis, CoefficientCounter, CoefficientDistribution, CpuLevel, Design, Direction, Family, Layout,
    LightSet, Model, PlaneRole, RelightingMaps, Space,
};
use relight_texture::{
    BlockFormat, Precision, Quantizer, RangeChoice, RangeRule, TexelDomain, TexelFormat, choose_range,
    error_ceilings, light_energy,
};

const U8: TexelFormat = TexelFormat::Plain { precision: Precision::U8, channels: 4 };
const F16: TexelFormat = TexelFormat::Plain { precision: Precision::F16, channels: 4 };
const F32: TexelFormat = TexelFormat::Plain { precision: Precision::F32, channels: 4 };
const BC4: TexelFormat = TexelFormat::Block(BlockFormat::Bc4);
const BC4_SIGNED: TexelFormat = TexelFormat::Block(BlockFormat::Bc4Signed);

/// A value in -1..1 of its own for every pair of numbers.
fn random(a: usize, b: usize) -> f64 {
    let mut bits = (a as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (b as u64 + 1).wrapping_mul(0xd1b5_4a32_d192_ed03);
    bits = (bits ^ (bits >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    bits = (bits ^ (bits >> 29)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// `count` values whose density falls by half every 0.1 x `scale` on both sides of `middle`.
fn heavy_tailed(count: usize, middle: f64, scale: f64) -> Vec<f32> {
    let value = |i: usize| {
        let (sign, u) = (random(1, i).signum(), random(2, i).abs().max(1e-9));
        (middle - scale * 0.1 * sign * (1.0 / u).ilog2_exact()) as f32
    };
    (0..count).map(value).collect()
}

/// log2 of a number above 0, the same on every machine.
trait Log2 {
    fn ilog2_exact(self) -> f64;
}

impl Log2 for f64 {
    fn ilog2_exact(self) -> f64 {
        let (mut x, mut log) = (self, 0.0);
        while x >= 2.0 {
            (x, log) = (x / 2.0, log + 1.0);
        }
        // Linear within the octave: the tail keeps its halving.
        log + x - 1.0
    }
}

fn distribution(values: &[f32]) -> CoefficientDistribution {
    let mut one = [CoefficientCounter::new()];
    CoefficientCounter::add_interleaved(&mut one, values, 0);
    one[0].distribution()
}

fn choose(values: &[f32], format: TexelFormat, rule: RangeRule) -> RangeChoice {
    choose_range(&distribution(values), format, rule, f64::INFINITY).unwrap()
}

/// What comes back of a coefficient through 8-bit codes, or signed ones of 127 either way.
fn back(quantizer: Quantizer, format: TexelFormat, coefficient: f32) -> f32 {
    let q = match format.domain() {
        TexelDomain::Unit => f32::from(quantizer.code(coefficient)) / 255.0,
        TexelDomain::Signed => {
            let q = quantizer.texel(TexelDomain::Signed, coefficient);
            (q * 127.0).round() / 127.0
        }
        TexelDomain::Half => quantizer.half(coefficient).to_f32(),
        TexelDomain::Float => quantizer.texel(TexelDomain::Float, coefficient),
    };
    quantizer.scale * q + quantizer.bias
}

fn rmse(values: &[f32], quantizer: Quantizer, format: TexelFormat) -> f64 {
    let square = |value: &f32| (f64::from(back(quantizer, format, *value)) - f64::from(*value)).powi(2);
    (values.iter().map(square).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn a_constant_map_is_exact() {
    for value in [0.0, 0.5, -3.7, 1e-30, -1e30, 1e-42, 65504.0, 1e4] {
        for count in [1, 2, 1000] {
            let values = vec![value; count];
            for format in [U8, BC4, BC4_SIGNED, F32] {
                for rule in [RangeRule::MinMax, RangeRule::MinError] {
                    let choice = choose(&values, format, rule);
                    assert_eq!(back(choice.quantizer, format, value), value, "{format:?} {rule:?}");
                    assert_eq!((choice.clipped, choice.rmse), (0, 0.0));
                    let texel = choice.quantizer.texel(format.domain(), value);
                    assert!(choice.quantizer.scale * texel + choice.quantizer.bias == value, "{value}");
                }
            }
        }
    }
    // The range that is given has no code for 0, but the nearest.
    let choice = choose(&[0.0; 9], U8, RangeRule::Unit);
    assert_eq!(choice.quantizer, Quantizer { scale: 2.0, bias: -1.0 });
    assert!(back(choice.quantizer, U8, 0.0).abs() <= 1.0001 / 255.0);
    assert_eq!(choose(&[0.25; 9], BC4_SIGNED, RangeRule::Unit).quantizer, Quantizer::PLAIN);
}

fn model_of(family: &str, count: usize, layout: Layout, space: Space) -> Model {
    let lights = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.3 }, 40);
    let set = LightSet::from_directions(lights.clone());
    let basis: Basis = Family::by_name(family).unwrap().build(&Design::new(count, &set)).unwrap();
    Model { basis, layout, space, lights, figures: None, provenance: None }
}

fn float_maps(model: &Model, (width, height): (usize, usize), planes: &[Vec<f32>]) -> RelightingMaps {
    let map = |plane: &Vec<f32>| RelightingMap { scale: 1.0, bias: 0.0, texels: Texels::F32(plane.clone()) };
    RelightingMaps { width, height, model: model.clone(), planes: planes.iter().map(map).collect() }
}

/// The maps in 8 bits, by `rule`.
fn coded_maps(maps: &RelightingMaps, planes: &[Vec<f32>], rule: RangeRule) -> RelightingMaps {
    let ceilings = error_ceilings(&maps.model);
    let coded = |(values, ceiling): (&Vec<f32>, &f64)| {
        let Quantizer { scale, bias } =
            choose_range(&distribution(values), U8, rule, *ceiling).unwrap().quantizer;
        let codes = values.iter().map(|c| Quantizer { scale, bias }.code(*c)).collect();
        RelightingMap { scale, bias, texels: Texels::U8(codes) }
    };
    RelightingMaps { planes: planes.iter().zip(&ceilings).map(coded).collect(), ..maps.clone() }
}

/// Root mean square error of the relit pictures over the model's lights, clipped as they are shown.
fn relit_rmse(a: &RelightingMaps, b: &RelightingMaps) -> f64 {
    let square = |light: &Direction| {
        let (a, b) = (relight(a, *light, CpuLevel::detect()), relight(b, *light, CpuLevel::detect()));
        compare(&b.samples, &a.samples, a.width, a.channels).rmse.powi(2)
    };
    (a.model.lights.iter().map(square).sum::<f64>() / a.model.lights.len() as f64).sqrt()
}

#[test]
fn one_outlier_texel_of_1e4_is_clipped_because_that_lowers_the_relit_error() {
    let size = (64, 64);
    for (family, count) in [("ptm", 6), ("sh", 9), ("hsh", 9), ("srbf", 12)] {
        for space in [Space::Encoded, Space::Linear] {
            let model = model_of(family, count, Layout::Grey, space);
            let value = |p: usize, x: usize| 0.2 * random(p, x) + if p == 0 { 0.5 } else { 0.0 };
            let plane = |p| (0..size.0 * size.1).map(|x| value(p, x) as f32).collect();
            let mut planes: Vec<Vec<f32>> = (0..count).map(plane).collect();
            let (calm, outlier) = (planes.clone(), 2 * size.0 + 3);
            (planes[1][outlier], planes[2][outlier]) = (1e4, -1e4);
            let maps = float_maps(&model, size, &planes);
            let coded = coded_maps(&maps, &planes, RangeRule::MinError);
            let kept = relit_rmse(&maps, &coded_maps(&maps, &planes, RangeRule::MinMax));
            let clipped = relit_rmse(&maps, &coded);
            assert!(clipped < 0.3 * kept, "{family} {space:?}: {clipped} is not far below {kept}");
            // All other texels are as good as they would be without it: half a step of +-0.2.
            for plane in [1, 2] {
                let mut found = vec![0.0; size.0 * size.1];
                coded.planes[plane].coefficients(0, &mut found);
                let others = found.iter().zip(&calm[plane]).enumerate().filter(|(x, _)| *x != outlier);
                let worst = others.map(|(_, (a, b))| (a - b).abs()).fold(0.0, f32::max);
                assert!(worst < 0.7 * 0.4 / 255.0, "{family} plane {plane}: {worst}");
            }
        }
    }
}

#[test]
fn an_outlier_that_counts_among_few_texels_is_not_clipped_at_the_pictures_cost() {
    // One of 12: what it loses when clipped is more than what the others gain.
    for (family, count) in [("ptm", 6), ("sh", 9), ("hsh", 9), ("srbf", 12)] {
        for seed in 0..10 {
            let model = model_of(family, count, Layout::Grey, Space::Encoded);
            let value = |p: usize, x: usize| 0.1 * random(p + 50 * seed, x) + if p == 0 { 0.5 } else { 0.0 };
            let plane = |p| (0..12).map(|x| value(p, x) as f32).collect();
            let mut planes: Vec<Vec<f32>> = (0..count).map(plane).collect();
            planes[1][5] = 1e4;
            let maps = float_maps(&model, (4, 3), &planes);
            let of = |rule| relit_rmse(&maps, &coded_maps(&maps, &planes, rule));
            let (kept, chosen) = (of(RangeRule::MinMax), of(RangeRule::MinError));
            assert!(chosen < 1.01 * kept, "{family} {seed}: {chosen} is above {kept}");
        }
    }
}

#[test]
fn a_few_bright_texels_on_black_are_kept() {
    // A night sky: clipping the stars would save the noise of the black.
    let model = model_of("ptm", 6, Layout::Grey, Space::Encoded);
    let values: Vec<f32> =
        (0..40_000).map(|i| if i % 4001 == 7 { 1.0 } else { 0.001 * random(3, i).abs() as f32 }).collect();
    for ceiling in [error_ceilings(&model)[5], f64::INFINITY] {
        let choice = choose_range(&distribution(&values), U8, RangeRule::MinError, ceiling).unwrap();
        assert_eq!(choice, choose_range(&distribution(&values), U8, RangeRule::MinMax, ceiling).unwrap());
        assert_eq!(choice.clipped, 0);
    }
}

#[test]
fn planes_that_gain_nothing_keep_their_ends() {
    let values: Vec<f32> = (0..5000).map(|i| (-3.0 + 2.5 * random(5, i)) as f32).collect();
    let range = distribution(&values).range();
    for format in [U8, BC4, TexelFormat::Block(BlockFormat::Bc7), TexelFormat::Block(BlockFormat::Bc6h)] {
        let choice = choose(&values, format, RangeRule::MinError);
        assert_eq!(choice.quantizer, Quantizer::over(range), "{format:?}");
    }
}

#[test]
fn a_black_background_has_a_code_of_its_own() {
    // All coefficients of black are 0: half a step of error in every plane would add up to grey.
    for background in [0, 2] {
        let value = |i: usize| if i % 4 < background { 0.0 } else { (0.3 + 0.77 * random(8, i)) as f32 };
        let values: Vec<f32> = (0..4000).map(value).collect();
        for format in [U8, BC4] {
            let choice = choose(&values, format, RangeRule::MinError);
            let (of_black, range) = (back(choice.quantizer, format, 0.0), distribution(&values).range());
            if background == 0 {
                assert_eq!(choice.quantizer, Quantizer::over(range));
                assert!(of_black.abs() > 1e-4, "a lucky range shows nothing: {of_black}");
            } else {
                assert!(of_black.abs() < 1e-6, "{of_black}");
                assert!(choice.quantizer.scale < 1.01 * (range.max - range.min));
            }
            assert_eq!(choice.clipped, 0);
            let measured = rmse(&values, choice.quantizer, format);
            assert!((choice.rmse / measured - 1.0).abs() < 0.05, "{} {measured}", choice.rmse);
        }
    }
}

#[test]
fn the_choice_is_the_best_of_all_ranges_and_its_error_is_as_predicted() {
    for (middle, count) in [(0.0, 200_000), (2.0, 100_000), (-1.0, 100_000)] {
        let values = heavy_tailed(count, middle, 1.0);
        let least_max = choose(&values, U8, RangeRule::MinMax);
        let choice = choose(&values, U8, RangeRule::MinError);
        let measured = rmse(&values, choice.quantizer, U8);
        assert!((choice.rmse / measured - 1.0).abs() < 0.05, "{} {measured}", choice.rmse);
        let of_ends = rmse(&values, least_max.quantizer, U8);
        assert!((least_max.rmse / of_ends - 1.0).abs() < 0.05, "{} {of_ends}", least_max.rmse);
        assert!(measured < 0.95 * of_ends && choice.clipped > 0, "{measured} {of_ends}");
        let outside = values.iter().filter(|v| {
            let q = choice.quantizer;
            **v < q.bias || **v > q.bias + q.scale
        });
        assert_eq!(outside.count() as u64, choice.clipped);
        // Any other range, by the real error of its codes.
        let range = distribution(&values).range();
        let mut best = f64::INFINITY;
        for (low, high) in (0..14).flat_map(|low| (0..14).map(move |high| (low, high))) {
            let middle = middle as f32;
            let part = |end: f32, i: i32| middle + (end - middle) * (1.0 - i as f32 / 25.0);
            let (min, max) = (part(range.min, low), part(range.max, high));
            let quantizer = Quantizer { scale: max - min, bias: min };
            best = best.min(rmse(&values, quantizer, U8));
        }
        assert!(measured < 1.02 * best, "{measured}, but {best} is possible");
    }
}

#[test]
fn a_range_of_one_sign_is_spread_over_all_codes() {
    let values: Vec<f32> = (0..3000).map(|i| (-9.0 - 7.0 * random(4, i).powi(2)) as f32).collect();
    let choice = choose(&values, U8, RangeRule::MinError);
    let quantizer = choice.quantizer;
    assert!(quantizer.bias < -15.9 && quantizer.bias + quantizer.scale <= -8.9, "{quantizer:?}");
    assert!(rmse(&values, quantizer, U8) < 7.1 / 255.0 / 12f64.sqrt() * 1.01);
    // Around 0 it takes twice the scale.
    let signed = choose(&values, BC4_SIGNED, RangeRule::MinMax).quantizer;
    assert_eq!((signed.scale, signed.bias), (-distribution(&values).range().min, 0.0));
    let measured = rmse(&values, signed, BC4_SIGNED);
    assert!((measured / choose(&values, BC4_SIGNED, RangeRule::MinMax).rmse - 1.0).abs() < 0.05);
}

#[test]
fn signed_ranges_are_around_zero_and_clip_the_longer_tail() {
    let mut values = heavy_tailed(5000, 0.0, 1.0);
    values[77] = -30.0;
    let choice = choose_range(&distribution(&values), BC4_SIGNED, RangeRule::MinError, 1.0).unwrap();
    assert_eq!(choice.quantizer.bias, 0.0);
    assert!(choice.quantizer.scale < 2.0 && choice.clipped >= 1, "{choice:?}");
    assert_eq!(back(choice.quantizer, BC4_SIGNED, 0.0), 0.0);
    assert_eq!(back(choice.quantizer, BC4_SIGNED, -30.0), -choice.quantizer.scale);
}

#[test]
fn ranges_of_1e_minus_30_and_1e30_are_those_of_1() {
    // A power of two scales every bit but the exponent: with no ceiling of its own, so does the choice.
    let mut values = heavy_tailed(4000, 0.3, 1.0);
    values[1234] = -300.0;
    for format in [U8, BC4_SIGNED] {
        let one = choose_range(&distribution(&values), format, RangeRule::MinError, 0.0).unwrap();
        assert!(one.clipped > 0);
        for exponent in [-100, 97] {
            let factor = 2f32.powi(exponent);
            let scaled: Vec<f32> = values.iter().map(|v| v * factor).collect();
            let choice = choose_range(&distribution(&scaled), format, RangeRule::MinError, 0.0).unwrap();
            let expected = [one.quantizer.scale * factor, one.quantizer.bias * factor];
            assert_eq!([choice.quantizer.scale, choice.quantizer.bias], expected, "2^{exponent}");
            let measured = rmse(&scaled, choice.quantizer, format);
            let of_one = rmse(&values, one.quantizer, format) * f64::from(factor);
            assert!((measured / of_one - 1.0).abs() < 1e-3, "2^{exponent}: {measured:e} {of_one:e}");
        }
    }
    // All of f32, and widths of denormals: nothing worse than a coarse step.
    for values in [[f32::MIN, 0.0, f32::MAX], [1e-45, 2e-45, 1e-44], [-1e30, 1e-30, 1e30]] {
        for format in [U8, BC4, BC4_SIGNED, F16, F32] {
            for rule in RangeRule::ALL {
                for ceiling in [0.0, 1.0, f64::INFINITY] {
                    let choice = choose_range(&distribution(&values), format, rule, ceiling).unwrap();
                    assert!(choice.quantizer.scale.is_finite() && choice.quantizer.bias.is_finite());
                    assert!(!choice.rmse.is_nan());
                    for value in values {
                        let texel = choice.quantizer.texel(format.domain(), value);
                        let coefficient = choice.quantizer.scale * texel + choice.quantizer.bias;
                        assert!(!coefficient.is_nan(), "{values:?} {format:?} {rule:?}: {texel}");
                    }
                }
            }
        }
    }
}

#[test]
fn nothing_has_a_range_too() {
    for format in [U8, BC4_SIGNED, F16, F32] {
        for rule in RangeRule::ALL {
            let choice = choose(&[], format, rule);
            assert!(choice.quantizer.scale.is_finite() && choice.rmse == 0.0, "{format:?} {rule:?}");
        }
    }
}

#[test]
fn a_coefficient_that_is_no_number_is_refused_and_its_pixel_named() {
    let mut values = heavy_tailed(100, 0.0, 1.0);
    (values[61], values[83]) = (f32::NAN, f32::INFINITY);
    for format in [U8, BC4_SIGNED, F16, F32] {
        for rule in RangeRule::ALL {
            let refused = choose_range(&distribution(&values), format, rule, 1.0).unwrap_err();
            assert_eq!(refused.pixel, 61);
            assert!(refused.to_string().contains("pixel 61 is NaN"), "{refused}");
        }
    }
    // And where one comes later, as from a resampled level, its code is defined.
    let quantizer = Quantizer { scale: 2.0, bias: -1.0 };
    assert_eq!([f32::NAN, f32::NEG_INFINITY, f32::INFINITY].map(|c| quantizer.code(c)), [0, 0, 255]);
    assert_eq!(quantizer.texel(TexelDomain::Signed, f32::NAN), 0.0);
}

#[test]
fn halves_beyond_65504_and_among_the_denormals_are_scaled() {
    for scale in [1.0, 3e4, 1e5, 1e30, 1e-3, 1e-6, 1e-30] {
        let values: Vec<f32> = (0..4000).map(|i| (scale * (0.8 + 0.2 * random(6, i))) as f32).collect();
        let choice = choose(&values, F16, RangeRule::MinError);
        let measured = rmse(&values, choice.quantizer, F16);
        assert!((choice.rmse / measured - 1.0).abs() < 0.1, "{scale:e}: {} {measured}", choice.rmse);
        assert!(measured < scale * 2.0f64.powi(-11) / 3f64.sqrt() * 1.01, "{scale:e}: {measured:e}");
    }
    // Small coefficients beside large ones are denormal halves, which end at 2^-24.
    let values: Vec<f32> =
        (0..4000).map(|i| if i == 0 { 100.0 } else { (1e-5 * random(7, i)) as f32 }).collect();
    let choice = choose(&values, F16, RangeRule::MinError);
    assert_eq!(choice.quantizer, Quantizer::PLAIN);
    assert!(values.iter().all(|v| (back(choice.quantizer, F16, *v) - v).abs() <= 2f32.powi(-25)));
}

#[test]
fn the_unit_range_is_that_of_the_panoramas_paper() {
    let values = [-0.99, -0.5, 0.0, 0.9, 0.99, 1.5, -7.0];
    let choice = choose(&values, U8, RangeRule::Unit);
    assert_eq!((choice.quantizer, choice.clipped), (Quantizer { scale: 2.0, bias: -1.0 }, 2));
    assert_eq!(values.map(|v| choice.quantizer.code(v)), [1, 64, 128, 242, 254, 255, 0]);
    assert!((choice.rmse - rmse(&values, choice.quantizer, U8)).abs() < 0.05);
    // The ends themselves are inside: base colours have a largest component of 1.
    assert_eq!(choose(&[-1.0, 0.3, 1.0, 1.0, 1.0], U8, RangeRule::Unit).clipped, 0);
}

#[test]
fn an_error_of_a_plane_costs_the_picture_what_its_energy_says() {
    let size = (12, 11);
    for (family, count) in [("ptm", 6), ("hsh", 9), ("srbf", 12)] {
        for layout in [Layout::Grey, Layout::Rgb, Layout::Lrgb] {
            for named in [true, false] {
                let mut model = model_of(family, count, layout, Space::Encoded);
                let lights =
                    fibonacci_in(Cap { axis: Direction::OUT, radius: std::f64::consts::FRAC_PI_2 }, 400);
                if !named {
                    model.lights.clear();
                }
                let lights = if named { &model.lights } else { &lights };
                let energies = light_energy(&model);
                assert_eq!(energies.len(), model.plane_count());
                for (plane, (role, energy)) in model.roles().into_iter().zip(&energies).enumerate() {
                    let PlaneRole::Coefficient { .. } = role else {
                        assert_eq!(*energy, 1.0 / 3.0, "an upper bound");
                        continue;
                    };
                    // Base colours of 1: all that the approximation leaves out.
                    let of = |p: usize, x: usize| match layout {
                        Layout::Lrgb if p >= count => 1.0,
                        _ => random(p, x) as f32,
                    };
                    let mut planes: Vec<Vec<f32>> = (0..model.plane_count())
                        .map(|p| (0..size.0 * size.1).map(|x| of(p, x)).collect())
                        .collect();
                    let maps = float_maps(&model, size, &planes);
                    let mut squares = 0.0;
                    for (x, value) in planes[plane].iter_mut().enumerate() {
                        let error = 0.01 * random(99, x) as f32;
                        squares += f64::from(error).powi(2);
                        *value += error;
                    }
                    let worse = float_maps(&model, size, &planes);
                    let mut relit = 0.0;
                    for light in lights {
                        let level = CpuLevel::detect();
                        let (a, b) = (relight(&maps, *light, level), relight(&worse, *light, level));
                        let difference = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
                        let sum: f64 = a.samples.iter().zip(&b.samples).map(difference).sum();
                        relit += sum / a.channels as f64;
                    }
                    relit /= lights.len() as f64;
                    let bound = if named { 1e-3 } else { 0.02 };
                    let ratio = relit / squares / energy;
                    assert!((ratio - 1.0).abs() < bound, "{family} {layout:?} plane {plane}: {ratio}");
                }
            }
        }
    }
}
