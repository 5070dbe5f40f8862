// Lights an asset of 20 x 12 texels. Written by relight; needs no other source.
//
// Basis   srbf of 4 functions: c0 c1 c2 c3
// Layout  lrgb: a plane of luminance a function, and three of base colour that multiply the sum
// Space   encoded: shaded colors are sRGB-encoded
// Levels  5 mip levels; beyond the edges: repeat
// Maps    3 layers in all, as array textures without sRGB decoding:
//         maps_0: 2 layers, bc5
//         maps_1: 1 layer, bc7
//
// Bind the arrays as you like and pass them as maps_0, maps_1 ..;
// where a function wants it, one sampler for all.
//
//     once a light    weights = relight_weights(direction)
//     once a pixel    color = relight_shade(weights, maps_0 .., texel, level)
//                     or relight_sample(weights, maps_0 .., uv)
//
// The sum runs by array, then layer, then channel: coefficient = scale * texel + bias, then
// sum = sum + weight * coefficient, in this order and unfolded, as the CPU reference does.

const RELIGHT_WIDTH: i32 = 20;
const RELIGHT_HEIGHT: i32 = 12;
const RELIGHT_LEVELS: i32 = 5;
const RELIGHT_FUNCTIONS: i32 = 4;
const RELIGHT_LAYERS: i32 = 3;

// Centres of the Gaussians, and 1 / (2 spread^2).
const RELIGHT_CENTRE_0 = vec3f(0.5087297, 0.037987065, 0.8600878);
const RELIGHT_CENTRE_1 = vec3f(-0.5461133, 0.54895216, 0.63278097);
const RELIGHT_CENTRE_2 = vec3f(0.09521229, -0.897841, 0.42990258);
const RELIGHT_CENTRE_3 = vec3f(0.6059029, 0.789886, 0.09466663);
const RELIGHT_SHARPNESS: f32 = 0.49461544;

// The angle between unit vectors from the chord to b, or from the chord to -b where that is shorter.
fn relight_angle(a: vec3f, b: vec3f) -> f32 {
    let to_b = dot(a - b, a - b);
    let to_opposite = dot(a + b, a + b);
    let s = min(to_b, to_opposite);
    var over_chord: f32 = 6.9244347e-6;
    over_chord = over_chord * s + -2.3595043e-5;
    over_chord = over_chord * s + 7.813503e-5;
    over_chord = over_chord * s + 5.9464193e-5;
    over_chord = over_chord * s + 0.0007303381;
    over_chord = over_chord * s + 0.004678733;
    over_chord = over_chord * s + 0.04166755;
    over_chord = over_chord * s + 1.0;
    let angle = sqrt(s) * over_chord;
    return select(3.1415927 - angle, angle, to_b <= to_opposite);
}

// The Gaussian around a centre.
fn relight_gaussian(l: vec3f, centre: vec3f) -> f32 {
    let angle = relight_angle(l, centre);
    return exp(-RELIGHT_SHARPNESS * angle * angle);
}

// The functions of light at the unit direction l, which points from the surface to the light
// (x right in the picture, y up, z towards the viewer).
fn relight_basis(l: vec3f) -> array<f32, RELIGHT_FUNCTIONS> {
    var basis: array<f32, RELIGHT_FUNCTIONS>;
    basis[0] = relight_gaussian(l, RELIGHT_CENTRE_0);
    basis[1] = relight_gaussian(l, RELIGHT_CENTRE_1);
    basis[2] = relight_gaussian(l, RELIGHT_CENTRE_2);
    basis[3] = relight_gaussian(l, RELIGHT_CENTRE_3);
    return basis;
}

// By layer, over all arrays in turn: coefficient = scale * texel + bias, channel by channel.
const RELIGHT_SCALE_0 = vec4f(0.3, 0.31370002, 0.0, 0.0);
const RELIGHT_SCALE_1 = vec4f(0.3274, 0.3411, 0.0, 0.0);
const RELIGHT_SCALE_2 = vec4f(0.35480002, 0.3685, 0.3822, 0.0);
const RELIGHT_BIAS_0 = vec4f(0.0, 0.07, 0.0, 0.0);
const RELIGHT_BIAS_1 = vec4f(-0.15556349, 0.12124355, 0.0, 0.0);
const RELIGHT_BIAS_2 = vec4f(-0.22, 0.15652476, -0.26944387, 0.0);

// The weight of each layer's channels, from the functions of light.
fn relight_layer_weights(basis: array<f32, RELIGHT_FUNCTIONS>) -> array<vec4f, RELIGHT_LAYERS> {
    var weights: array<vec4f, RELIGHT_LAYERS>;
    weights[0] = vec4f(basis[0], basis[1], basis[0], basis[0]);
    weights[1] = vec4f(basis[2], basis[3], basis[0], basis[0]);
    weights[2] = vec4f(basis[0], basis[0], basis[0], basis[0]);
    return weights;
}

// The same from the unit direction l of a light. They are alike for all texels: work them out
// once a light, in an earlier stage or outside, rather than once a pixel.
fn relight_weights(l: vec3f) -> array<vec4f, RELIGHT_LAYERS> {
    var weights: array<vec4f, RELIGHT_LAYERS>;
    var basis: array<f32, RELIGHT_FUNCTIONS>;
    basis = relight_basis(l);
    weights = relight_layer_weights(basis);
    return weights;
}

// The color under the light of `weights`, at a texel (column, row from the top) of a mip level.
fn relight_shade(weights: array<vec4f, RELIGHT_LAYERS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, texel: vec2i, level: i32) -> vec3f {
    var luminance: f32 = 0.0;
    { let p = weights[0] * (RELIGHT_SCALE_0 * textureLoad(maps_0, texel, 0, level) + RELIGHT_BIAS_0); luminance = luminance + p.x + p.y; }
    { let p = weights[1] * (RELIGHT_SCALE_1 * textureLoad(maps_0, texel, 1, level) + RELIGHT_BIAS_1); luminance = luminance + p.x + p.y; }
    var base_color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_2 * textureLoad(maps_1, texel, 0, level) + RELIGHT_BIAS_2; base_color = base_color + p.xyz; }
    return luminance * base_color;
}

// The color under the light of `weights`, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
fn relight_sample(weights: array<vec4f, RELIGHT_LAYERS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f) -> vec3f {
    var luminance: f32 = 0.0;
    { let p = weights[0] * (RELIGHT_SCALE_0 * textureSample(maps_0, maps_sampler, uv, 0) + RELIGHT_BIAS_0); luminance = luminance + p.x + p.y; }
    { let p = weights[1] * (RELIGHT_SCALE_1 * textureSample(maps_0, maps_sampler, uv, 1) + RELIGHT_BIAS_1); luminance = luminance + p.x + p.y; }
    var base_color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_2 * textureSample(maps_1, maps_sampler, uv, 0) + RELIGHT_BIAS_2; base_color = base_color + p.xyz; }
    return luminance * base_color;
}

// The color under the light of `weights`, through a sampler at uv of a mip level, for any stage.
fn relight_sample_level(weights: array<vec4f, RELIGHT_LAYERS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f, level: f32) -> vec3f {
    var luminance: f32 = 0.0;
    { let p = weights[0] * (RELIGHT_SCALE_0 * textureSampleLevel(maps_0, maps_sampler, uv, 0, level) + RELIGHT_BIAS_0); luminance = luminance + p.x + p.y; }
    { let p = weights[1] * (RELIGHT_SCALE_1 * textureSampleLevel(maps_0, maps_sampler, uv, 1, level) + RELIGHT_BIAS_1); luminance = luminance + p.x + p.y; }
    var base_color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_2 * textureSampleLevel(maps_1, maps_sampler, uv, 0, level) + RELIGHT_BIAS_2; base_color = base_color + p.xyz; }
    return luminance * base_color;
}

// In passes, where one shader can't read all maps: draw RELIGHT_PASSES times into a float target
// that was cleared to 0, with additive blending (one, one). Each pass adds the terms of its own
// RELIGHT_MAPS_PER_PASS layers, bias included; terms may be negative, which a target of 8 bits
// would clip. A _finish function makes the color of the sum, once.
// Source: Wong, Leung, Choy, Lighting Precomputation Using the Relighting Map.
const RELIGHT_MAPS_PER_PASS: i32 = 1;
const RELIGHT_PASSES: i32 = 2;

// The terms of pass 0 .. RELIGHT_PASSES - 1, at a texel (column, row from the top) of a mip level.
fn relight_shade_pass(pass_index: i32, weights: array<vec4f, RELIGHT_LAYERS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, texel: vec2i, level: i32) -> vec3f {
    var luminance: f32 = 0.0;
    if (pass_index == 0) { let p = weights[0] * (RELIGHT_SCALE_0 * textureLoad(maps_0, texel, 0, level) + RELIGHT_BIAS_0); luminance = luminance + p.x + p.y; }
    if (pass_index == 1) { let p = weights[1] * (RELIGHT_SCALE_1 * textureLoad(maps_0, texel, 1, level) + RELIGHT_BIAS_1); luminance = luminance + p.x + p.y; }
    return vec3f(luminance, luminance, luminance);
}

// The terms of pass 0 .. RELIGHT_PASSES - 1, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
fn relight_sample_pass(pass_index: i32, weights: array<vec4f, RELIGHT_LAYERS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f) -> vec3f {
    var luminance: f32 = 0.0;
    if (pass_index == 0) { let p = weights[0] * (RELIGHT_SCALE_0 * textureSample(maps_0, maps_sampler, uv, 0) + RELIGHT_BIAS_0); luminance = luminance + p.x + p.y; }
    if (pass_index == 1) { let p = weights[1] * (RELIGHT_SCALE_1 * textureSample(maps_0, maps_sampler, uv, 1) + RELIGHT_BIAS_1); luminance = luminance + p.x + p.y; }
    return vec3f(luminance, luminance, luminance);
}

// The terms of pass 0 .. RELIGHT_PASSES - 1, through a sampler at uv of a mip level, for any stage.
fn relight_sample_level_pass(pass_index: i32, weights: array<vec4f, RELIGHT_LAYERS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f, level: f32) -> vec3f {
    var luminance: f32 = 0.0;
    if (pass_index == 0) { let p = weights[0] * (RELIGHT_SCALE_0 * textureSampleLevel(maps_0, maps_sampler, uv, 0, level) + RELIGHT_BIAS_0); luminance = luminance + p.x + p.y; }
    if (pass_index == 1) { let p = weights[1] * (RELIGHT_SCALE_1 * textureSampleLevel(maps_0, maps_sampler, uv, 1, level) + RELIGHT_BIAS_1); luminance = luminance + p.x + p.y; }
    return vec3f(luminance, luminance, luminance);
}

// The color from the sum of all passes, at a texel (column, row from the top) of a mip level.
fn relight_shade_finish(sum: vec3f, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, texel: vec2i, level: i32) -> vec3f {
    var base_color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_2 * textureLoad(maps_1, texel, 0, level) + RELIGHT_BIAS_2; base_color = base_color + p.xyz; }
    return sum * base_color;
}

// The color from the sum of all passes, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
fn relight_sample_finish(sum: vec3f, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f) -> vec3f {
    var base_color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_2 * textureSample(maps_1, maps_sampler, uv, 0) + RELIGHT_BIAS_2; base_color = base_color + p.xyz; }
    return sum * base_color;
}

// The color from the sum of all passes, through a sampler at uv of a mip level, for any stage.
fn relight_sample_level_finish(sum: vec3f, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f, level: f32) -> vec3f {
    var base_color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_2 * textureSampleLevel(maps_1, maps_sampler, uv, 0, level) + RELIGHT_BIAS_2; base_color = base_color + p.xyz; }
    return sum * base_color;
}

// The sRGB transfer function (IEC 61966-2-1); below 0 it gives 0, above 1 the curve goes on.
fn relight_linear_channel(value: f32) -> f32 {
    if (value <= 0.04045) {
        return max(value / 12.92, 0.0);
    }
    return pow((value + 0.055) / 1.055, 2.4);
}

// Linear light from a shaded color. Lights add up in linear light: the sum over lights of
// light color * relight_to_linear(relight_shade(weights of the light, ..)).
fn relight_to_linear(color: vec3f) -> vec3f {
    return vec3f(relight_linear_channel(color.x), relight_linear_channel(color.y), relight_linear_channel(color.z));
}

// An sRGB-encoded color from a shaded one, for targets that do not encode by themselves.
fn relight_to_encoded(color: vec3f) -> vec3f {
    return color;
}

// A point light: in xyz the unit direction from the surface to it, for relight_weights; in w its
// attenuation, 1 / distance^2, by which the linear color is multiplied. Positions are in the
// picture's axes (x right, y up, z towards the viewer). Nearer than minimum_distance (above 1e-18)
// the attenuation stays what it is there; a light at the surface itself counts as straight above.
fn relight_point_light(surface: vec3f, light: vec3f, minimum_distance: f32) -> vec4f {
    let to_light = light - surface;
    let size = abs(to_light);
    let largest = max(size.x, max(size.y, size.z));
    var direction: vec3f = vec3f(0.0, 0.0, 1.0);
    // Divided by the largest component first: squares neither overflow nor vanish.
    if (largest > 1.0e-37) {
        direction = normalize(to_light / largest);
    }
    let square = max(dot(to_light, to_light), minimum_distance * minimum_distance);
    return vec4f(direction, 1.0 / square);
}
