//! Real spherical harmonics by the recursion of `relight_core::evaluate_sh`, its factors in tables.

use crate::language::Type;
use crate::literal::literal;
use crate::source::Source;
use std::f64::consts::{PI, SQRT_2};

/// For m = 0 .. order: the factor at l = m, with the square root of 2 of m > 0 in it; and for each
/// m and l = m .. order the two factors of the step to l + 1.
pub(super) fn constants(source: &mut Source, order: usize) {
    let mut sectoral = (1.0 / (4.0 * PI)).sqrt();
    let (mut firsts, mut steps) = (Vec::new(), Vec::new());
    for m in 0..=order {
        firsts.push(literal((sectoral * if m == 0 { 1.0 } else { SQRT_2 }) as f32));
        sectoral *= -((2 * m + 3) as f64 / (2 * m + 2) as f64).sqrt();
        let mm = (m * m) as f64;
        for l in m..=order {
            let (l1, l0) = (((l + 1) * (l + 1)) as f64, (l * l) as f64);
            let a = ((4.0 * l1 - 1.0) / (l1 - mm)).sqrt();
            let b = if l == m { 0.0 } else { ((l0 - mm) / (4.0 * l0 - 1.0)).sqrt() };
            steps.push(format!("{}, {}", literal(a as f32), literal((a * b) as f32)));
        }
    }
    source.comment("Spherical harmonics: the factor at l = m, and the factors of each step from l to l + 1.");
    source.constant(Type::Int, "RELIGHT_SH_ORDER", &order.to_string());
    source.indexed_table(Type::Float, "RELIGHT_SH_FIRST", &firsts);
    source.indexed_table(Type::Float2, "RELIGHT_SH_STEP", &steps);
}

pub(super) fn body(source: &mut Source) {
    source.comment("(x + i y)^m is sin(theta)^m (cos(m phi) + i sin(m phi)).");
    source.variable(Type::Float2, "power", &format!("{}(1.0, 0.0)", source.word(Type::Float2)));
    source.variable(Type::Int, "at", "0");
    source.each("m", "0", "RELIGHT_SH_ORDER + 1", |source| {
        source.variable(Type::Float, "before", "0.0");
        source.variable(Type::Float, "current", "RELIGHT_SH_FIRST[m]");
        source.each("n", "m", "RELIGHT_SH_ORDER + 1", |source| {
            source.comment("The sine first: where m = 0 there is but the cosine.");
            source.line("basis[n * n + n - m] = current * power.y;");
            source.line("basis[n * n + n + m] = current * power.x;");
            let next = "RELIGHT_SH_STEP[at].x * l.z * current - RELIGHT_SH_STEP[at].y * before";
            source.value(Type::Float, "next", next);
            source.line("before = current;");
            source.line("current = next;");
            source.line("at++;");
        });
        let float2 = source.word(Type::Float2);
        source.line(&format!(
            "power = {float2}(l.x * power.x - l.y * power.y, l.y * power.x + l.x * power.y);"
        ));
    });
}
