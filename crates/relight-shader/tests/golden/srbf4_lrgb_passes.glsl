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
// a sampler2DArray each; repeat a sampler's filter and wrap on all of them.
//
//     once a light    weights = relight_weights(direction)
//     once a pixel    color = relight_shade(weights, maps_0 .., texel, level)
//                     or relight_sample(weights, maps_0 .., uv)
//
// The sum runs by array, then layer, then channel: coefficient = scale * texel + bias, then
// sum = sum + weight * coefficient, in this order and unfolded, as the CPU reference does.

// ES has no default for array textures; elsewhere these lines mean nothing.
precision highp float;
precision highp int;
precision highp sampler2DArray;

const int RELIGHT_WIDTH = 20;
const int RELIGHT_HEIGHT = 12;
const int RELIGHT_LEVELS = 5;
const int RELIGHT_FUNCTIONS = 4;
const int RELIGHT_LAYERS = 3;

// Centres of the Gaussians, and 1 / (2 spread^2).
const vec3 RELIGHT_CENTRE[4] = vec3[4](
    vec3(0.5087297, 0.037987065, 0.8600878), vec3(-0.5461133, 0.54895216, 0.63278097),
    vec3(0.09521229, -0.897841, 0.42990258), vec3(0.6059029, 0.789886, 0.09466663)
);
const float RELIGHT_SHARPNESS = 0.49461544;

// The angle between unit vectors from the chord to b, or from the chord to -b where that is shorter.
float relight_angle(vec3 a, vec3 b) {
    float to_b = dot(a - b, a - b);
    float to_opposite = dot(a + b, a + b);
    float s = min(to_b, to_opposite);
    float over_chord = 6.9244347e-6;
    over_chord = over_chord * s + -2.3595043e-5;
    over_chord = over_chord * s + 7.813503e-5;
    over_chord = over_chord * s + 5.9464193e-5;
    over_chord = over_chord * s + 0.0007303381;
    over_chord = over_chord * s + 0.004678733;
    over_chord = over_chord * s + 0.04166755;
    over_chord = over_chord * s + 1.0;
    float angle = sqrt(s) * over_chord;
    return to_b <= to_opposite ? angle : 3.1415927 - angle;
}

// The Gaussian around a centre.
float relight_gaussian(vec3 l, vec3 centre) {
    float angle = relight_angle(l, centre);
    return exp(-RELIGHT_SHARPNESS * angle * angle);
}

// The functions of light at the unit direction l, which points from the surface to the light
// (x right in the picture, y up, z towards the viewer).
void relight_basis(vec3 l, out float basis[RELIGHT_FUNCTIONS]) {
    for (int i = 0; i < 4; i++) {
        basis[i] = relight_gaussian(l, RELIGHT_CENTRE[i]);
    }
}

// By layer, over all arrays in turn: coefficient = scale * texel + bias, channel by channel.
const vec4 RELIGHT_SCALE[3] = vec4[3](
    vec4(0.3, 0.31370002, 0.0, 0.0), vec4(0.3274, 0.3411, 0.0, 0.0), vec4(0.35480002, 0.3685, 0.3822, 0.0)
);
const vec4 RELIGHT_BIAS[3] = vec4[3](
    vec4(0.0, 0.07, 0.0, 0.0), vec4(-0.15556349, 0.12124355, 0.0, 0.0),
    vec4(-0.22, 0.15652476, -0.26944387, 0.0)
);

// By layer: the function that weighs each channel of the texel, 0 where none does.
const ivec4 RELIGHT_FUNCTION[3] = ivec4[3](
    ivec4(0, 1, 0, 0), ivec4(2, 3, 0, 0), ivec4(0, 0, 0, 0)
);

// The weight of each layer's channels, from the functions of light.
void relight_layer_weights(float basis[RELIGHT_FUNCTIONS], out vec4 weights[RELIGHT_LAYERS]) {
    for (int layer = 0; layer < 3; layer++) {
        weights[layer] = vec4(basis[RELIGHT_FUNCTION[layer].x], basis[RELIGHT_FUNCTION[layer].y], basis[RELIGHT_FUNCTION[layer].z], basis[RELIGHT_FUNCTION[layer].w]);
    }
}

// The same from the unit direction l of a light. They are alike for all texels: work them out
// once a light, in an earlier stage or outside, rather than once a pixel.
void relight_weights(vec3 l, out vec4 weights[RELIGHT_LAYERS]) {
    float basis[RELIGHT_FUNCTIONS];
    relight_basis(l, basis);
    relight_layer_weights(basis, weights);
}

// The color under the light of `weights`, at a texel (column, row from the top) of a mip level.
vec3 relight_shade(vec4 weights[RELIGHT_LAYERS], sampler2DArray maps_0, sampler2DArray maps_1, ivec2 texel, int level) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        vec4 p = weights[layer] * (RELIGHT_SCALE[layer] * texelFetch(maps_0, ivec3(texel, layer), level) + RELIGHT_BIAS[layer]);
        luminance = luminance + p.x + p.y;
    }
    vec3 base_color = vec3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texelFetch(maps_1, ivec3(texel, (layer - 2)), level) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return luminance * base_color;
}

// The color under the light of `weights`, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
vec3 relight_sample(vec4 weights[RELIGHT_LAYERS], sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        vec4 p = weights[layer] * (RELIGHT_SCALE[layer] * texture(maps_0, vec3(uv, float(layer))) + RELIGHT_BIAS[layer]);
        luminance = luminance + p.x + p.y;
    }
    vec3 base_color = vec3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texture(maps_1, vec3(uv, float((layer - 2)))) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return luminance * base_color;
}

// The color under the light of `weights`, through a sampler at uv of a mip level, for any stage.
vec3 relight_sample_level(vec4 weights[RELIGHT_LAYERS], sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv, float level) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        vec4 p = weights[layer] * (RELIGHT_SCALE[layer] * textureLod(maps_0, vec3(uv, float(layer)), level) + RELIGHT_BIAS[layer]);
        luminance = luminance + p.x + p.y;
    }
    vec3 base_color = vec3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * textureLod(maps_1, vec3(uv, float((layer - 2))), level) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return luminance * base_color;
}

// In passes, where one shader can't read all maps: draw RELIGHT_PASSES times into a float target
// that was cleared to 0, with additive blending (one, one). Each pass adds the terms of its own
// RELIGHT_MAPS_PER_PASS layers, bias included; terms may be negative, which a target of 8 bits
// would clip. A _finish function makes the color of the sum, once.
// Source: Wong, Leung, Choy, Lighting Precomputation Using the Relighting Map.
const int RELIGHT_MAPS_PER_PASS = 1;
const int RELIGHT_PASSES = 2;

// The terms of pass 0 .. RELIGHT_PASSES - 1, at a texel (column, row from the top) of a mip level.
vec3 relight_shade_pass(int pass_index, vec4 weights[RELIGHT_LAYERS], sampler2DArray maps_0, sampler2DArray maps_1, ivec2 texel, int level) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        if (pass_index == layer / RELIGHT_MAPS_PER_PASS) { vec4 p = weights[layer] * (RELIGHT_SCALE[layer] * texelFetch(maps_0, ivec3(texel, layer), level) + RELIGHT_BIAS[layer]); luminance = luminance + p.x + p.y; }
    }
    return vec3(luminance, luminance, luminance);
}

// The terms of pass 0 .. RELIGHT_PASSES - 1, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
vec3 relight_sample_pass(int pass_index, vec4 weights[RELIGHT_LAYERS], sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        if (pass_index == layer / RELIGHT_MAPS_PER_PASS) { vec4 p = weights[layer] * (RELIGHT_SCALE[layer] * texture(maps_0, vec3(uv, float(layer))) + RELIGHT_BIAS[layer]); luminance = luminance + p.x + p.y; }
    }
    return vec3(luminance, luminance, luminance);
}

// The terms of pass 0 .. RELIGHT_PASSES - 1, through a sampler at uv of a mip level, for any stage.
vec3 relight_sample_level_pass(int pass_index, vec4 weights[RELIGHT_LAYERS], sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv, float level) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        if (pass_index == layer / RELIGHT_MAPS_PER_PASS) { vec4 p = weights[layer] * (RELIGHT_SCALE[layer] * textureLod(maps_0, vec3(uv, float(layer)), level) + RELIGHT_BIAS[layer]); luminance = luminance + p.x + p.y; }
    }
    return vec3(luminance, luminance, luminance);
}

// The color from the sum of all passes, at a texel (column, row from the top) of a mip level.
vec3 relight_shade_finish(vec3 sum, sampler2DArray maps_0, sampler2DArray maps_1, ivec2 texel, int level) {
    vec3 base_color = vec3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texelFetch(maps_1, ivec3(texel, (layer - 2)), level) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return sum * base_color;
}

// The color from the sum of all passes, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
vec3 relight_sample_finish(vec3 sum, sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv) {
    vec3 base_color = vec3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texture(maps_1, vec3(uv, float((layer - 2)))) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return sum * base_color;
}

// The color from the sum of all passes, through a sampler at uv of a mip level, for any stage.
vec3 relight_sample_level_finish(vec3 sum, sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv, float level) {
    vec3 base_color = vec3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * textureLod(maps_1, vec3(uv, float((layer - 2))), level) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return sum * base_color;
}

// The sRGB transfer function (IEC 61966-2-1); below 0 it gives 0, above 1 the curve goes on.
float relight_linear_channel(float value) {
    if (value <= 0.04045) {
        return max(value / 12.92, 0.0);
    }
    return pow((value + 0.055) / 1.055, 2.4);
}

// Linear light from a shaded color. Lights add up in linear light: the sum over lights of
// light color * relight_to_linear(relight_shade(weights of the light, ..)).
vec3 relight_to_linear(vec3 color) {
    return vec3(relight_linear_channel(color.x), relight_linear_channel(color.y), relight_linear_channel(color.z));
}

// An sRGB-encoded color from a shaded one, for targets that do not encode by themselves.
vec3 relight_to_encoded(vec3 color) {
    return color;
}

// A point light: in xyz the unit direction from the surface to it, for relight_weights; in w its
// attenuation, 1 / distance^2, by which the linear color is multiplied. Positions are in the
// picture's axes (x right, y up, z towards the viewer). Nearer than minimum_distance (above 1e-18)
// the attenuation stays what it is there; a light at the surface itself counts as straight above.
vec4 relight_point_light(vec3 surface, vec3 light, float minimum_distance) {
    vec3 to_light = light - surface;
    vec3 size = abs(to_light);
    float largest = max(size.x, max(size.y, size.z));
    vec3 direction = vec3(0.0, 0.0, 1.0);
    // Divided by the largest component first: squares neither overflow nor vanish.
    if (largest > 1.0e-37) {
        direction = normalize(to_light / largest);
    }
    float square = max(dot(to_light, to_light), minimum_distance * minimum_distance);
    return vec4(direction, 1.0 / square);
}
