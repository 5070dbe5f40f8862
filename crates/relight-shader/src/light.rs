//! What stands around the sum: the transfer function and the point light.

use crate::language::Type;
use crate::source::{Parameter, Source};
use relight_core::Space;

/// `relight_to_linear` and `relight_to_encoded`, one of which does nothing.
pub(crate) fn transfer(source: &mut Source, space: Space) {
    let (by_channel, decodes) = match space {
        Space::Encoded => ("relight_linear_channel", true),
        Space::Linear => ("relight_encoded_channel", false),
    };
    source.comment(
        "The sRGB transfer function (IEC 61966-2-1); below 0 it gives 0, above 1 the curve goes on.",
    );
    let value = [Parameter::value("value", Type::Float)];
    source.function(Type::Float, by_channel, &value, |source| {
        let (end, line, curve) = if decodes {
            ("value <= 0.04045", "value / 12.92", "pow((value + 0.055) / 1.055, 2.4)")
        } else {
            ("value <= 0.0031308", "value * 12.92", "1.055 * pow(value, 1.0 / 2.4) - 0.055")
        };
        source.block(&format!("if ({end})"), |source| source.line(&format!("return max({line}, 0.0);")));
        source.line(&format!("return {curve};"));
    });
    let color = [Parameter::value("color", Type::Float3)];
    let channels = ["x", "y", "z"].map(|c| format!("{by_channel}(color.{c})")).join(", ");
    let convert = format!("return {}({channels});", source.word(Type::Float3));
    source.comment(
        "Linear light from a shaded color. Lights add up in linear light: the sum over lights of\n\
         light color * relight_to_linear(relight_shade(weights of the light, ..)).",
    );
    source.function(Type::Float3, "relight_to_linear", &color, |source| {
        source.line(if decodes { &convert } else { "return color;" });
    });
    source.comment("An sRGB-encoded color from a shaded one, for targets that do not encode by themselves.");
    source.function(Type::Float3, "relight_to_encoded", &color, |source| {
        source.line(if decodes { "return color;" } else { &convert });
    });
}

/// `relight_point_light`.
pub(crate) fn point_light(source: &mut Source) {
    source.comment(
        "A point light: in xyz the unit direction from the surface to it, for relight_weights; in w its\n\
         attenuation, 1 / distance^2, by which the linear color is multiplied. Positions are in the\n\
         picture's axes (x right, y up, z towards the viewer). Nearer than minimum_distance (above 1e-18)\n\
         the attenuation stays what it is there; a light at the surface itself counts as straight above.",
    );
    let parameters = [
        Parameter::value("surface", Type::Float3),
        Parameter::value("light", Type::Float3),
        Parameter::value("minimum_distance", Type::Float),
    ];
    source.function(Type::Float4, "relight_point_light", &parameters, |source| {
        let (float3, float4) = (source.word(Type::Float3), source.word(Type::Float4));
        source.value(Type::Float3, "to_light", "light - surface");
        source.value(Type::Float3, "size", "abs(to_light)");
        source.value(Type::Float, "largest", "max(size.x, max(size.y, size.z))");
        source.variable(Type::Float3, "direction", &format!("{float3}(0.0, 0.0, 1.0)"));
        source.comment("Divided by the largest component first: squares neither overflow nor vanish.");
        source.block("if (largest > 1.0e-37)", |source| {
            source.line("direction = normalize(to_light / largest);");
        });
        let distance = "max(dot(to_light, to_light), minimum_distance * minimum_distance)";
        source.value(Type::Float, "square", distance);
        source.line(&format!("return {float4}(direction, 1.0 / square);"));
    });
}
