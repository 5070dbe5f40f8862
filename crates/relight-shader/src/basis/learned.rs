//! Learned functions: a table over an octahedral square, four functions in the channels of a texel.

use crate::Language;
use crate::language::Type;
use crate::layers::TABLE;
use crate::source::{Index, Parameter, Source};
use relight_core::basis::Learned;

/// Where a direction lies between the nodes of the table.
pub(super) fn place(source: &mut Source, learned: &Learned) {
    let square = learned.square();
    let float2 = source.word(Type::Float2);
    source.comment("Nodes along an edge of the table of functions.");
    source.constant(Type::Int, "RELIGHT_NODES", &square.nodes.to_string());
    source.comment(if square.hemisphere {
        "Where a direction lies in the table, an unfolded upper half of an octahedron, in units of nodes;\n\
         directions below the horizon count as on it."
    } else {
        "Where a direction lies in the table, an unfolded octahedron, in units of nodes."
    });
    let direction = [Parameter::value("l", Type::Float3)];
    source.function(Type::Float2, "relight_place", &direction, |source| {
        let last = format!("{:.1}", (square.nodes - 1) as f64);
        if square.hemisphere {
            source.value(Type::Float, "sum", "abs(l.x) + abs(l.y) + max(l.z, 0.0)");
            let p = source.choice("sum > 0.0", "l.xy / sum", &format!("{float2}(1.0, 0.0)"));
            source.value(Type::Float2, "p", &p);
            source.line(&format!("return {last} * (0.5 * {float2}(p.x + p.y, p.x - p.y) + 0.5);"));
            return;
        }
        source.value(Type::Float2, "p", "l.xy / (abs(l.x) + abs(l.y) + abs(l.z))");
        let [x, y] = ["x", "y"].map(|c| source.choice(&format!("p.{c} >= 0.0"), "1.0", "-1.0"));
        source.value(Type::Float, "side_x", &x);
        source.value(Type::Float, "side_y", &y);
        let folded = format!("{float2}((1.0 - abs(p.y)) * side_x, (1.0 - abs(p.x)) * side_y)");
        source.value(Type::Float2, "folded", &folded);
        let square = source.choice("l.z < 0.0", "folded", "p");
        source.value(Type::Float2, "square", &square);
        source.line(&format!("return {last} * (0.5 * square + 0.5);"));
    });
}

/// A texel of the table: by its offset from `cell` and the group of four functions.
fn texel(source: &Source, [x, y]: [u8; 2], group: &str) -> String {
    let int2 = source.word(Type::Int2);
    match source.language {
        Language::Wgsl => format!("textureLoad({TABLE}, cell + {int2}({x}, {y}), {group}, 0)"),
        Language::Glsl => format!("texelFetch({TABLE}, ivec3(cell + {int2}({x}, {y}), {group}), 0)"),
        Language::Hlsl => format!("{TABLE}.Load(int4(cell + {int2}({x}, {y}), {group}, 0))"),
    }
}

pub(super) fn body(source: &mut Source, count: usize) {
    let (int2, float2) = (source.word(Type::Int2), source.word(Type::Float2));
    source.value(Type::Float2, "place", "relight_place(l)");
    let before = format!("{int2}(clamp(floor(place), {float2}(0.0, 0.0), {float2}(1.0, 1.0) * float_last))");
    let last =
        if source.language == Language::Wgsl { "f32(RELIGHT_NODES - 2)" } else { "float(RELIGHT_NODES - 2)" };
    source.value(Type::Int2, "cell", &before.replace("float_last", last));
    source.value(
        Type::Float2,
        "t",
        &format!("clamp(place - {float2}(cell), {float2}(0.0, 0.0), {float2}(1.0, 1.0))"),
    );
    source.value(Type::Float2, "s", &format!("{float2}(1.0, 1.0) - t"));
    let between = |source: &Source, group: &str| {
        let terms =
            [("s.x * s.y", [0, 0]), ("t.x * s.y", [1, 0]), ("s.x * t.y", [0, 1]), ("t.x * t.y", [1, 1])];
        let terms = terms.map(|(weight, place)| format!("{weight} * {}", texel(source, place, group)));
        source.value_statement(Type::Float4, "v", &terms.join(" + "))
    };
    let components = ["x", "y", "z", "w"];
    source.each_of("i", 0..count / 4, |source, group| {
        let element = |c: usize| match group {
            Index::Number(number) => (4 * number + c).to_string(),
            Index::Variable(name) => format!("4 * {name} + {c}"),
        };
        let mut statements = vec![between(source, &group.to_string())];
        statements.extend((0..4).map(|c| format!("basis[{}] = v.{};", element(c), components[c])));
        statements
    });
    if !count.is_multiple_of(4) {
        let group = count / 4;
        let mut statements = vec![between(source, &group.to_string())];
        statements.extend((0..count % 4).map(|c| format!("basis[{}] = v.{};", 4 * group + c, components[c])));
        source.line(&format!("{{ {} }}", statements.join(" ")));
    }
}
