// Lights an asset of 20 x 12 texels. Written by relight; needs no other source.
//
// Basis   pca of 18 functions: mean.R mean.G mean.B p0.R p0.G p0.B p1.R p1.G p1.B p2.R ..
// Layout  shared: planes that each serve all channels, and a mean
// Space   encoded: shaded colors are sRGB-encoded
// Levels  1 mip level; beyond the edges: clamp to the edge
// Maps    2 layers in all, as array textures without sRGB decoding:
//         maps_0: 1 layer, bc7
//         maps_1: 1 layer, bc5
//
// Bind the arrays as you like and pass them as maps_0, maps_1 ..;
// a sampler2DArray each; repeat a sampler's filter and wrap on all of them.
// The functions of light are a table in one more array texture, functions: 7 x 7 texels of
// f16, unfiltered (relight shader --table writes it).
//
//     once a light    weights = relight_weights(direction, functions)
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
const int RELIGHT_LEVELS = 1;
const int RELIGHT_FUNCTIONS = 18;
const int RELIGHT_LAYERS = 2;
const int RELIGHT_WEIGHTS = 7;

// Nodes along an edge of the table of functions.
const int RELIGHT_NODES = 7;

// Where a direction lies in the table, an unfolded octahedron, in units of nodes.
vec2 relight_place(vec3 l) {
    vec2 p = l.xy / (abs(l.x) + abs(l.y) + abs(l.z));
    float side_x = p.x >= 0.0 ? 1.0 : -1.0;
    float side_y = p.y >= 0.0 ? 1.0 : -1.0;
    vec2 folded = vec2((1.0 - abs(p.y)) * side_x, (1.0 - abs(p.x)) * side_y);
    vec2 square = l.z < 0.0 ? folded : p;
    return 6.0 * (0.5 * square + 0.5);
}

// The functions of light at the unit direction l, which points from the surface to the light
// (x right in the picture, y up, z towards the viewer).
void relight_basis(vec3 l, sampler2DArray functions, out float basis[RELIGHT_FUNCTIONS]) {
    vec2 place = relight_place(l);
    ivec2 cell = ivec2(clamp(floor(place), vec2(0.0, 0.0), vec2(1.0, 1.0) * float(RELIGHT_NODES - 2)));
    vec2 t = clamp(place - vec2(cell), vec2(0.0, 0.0), vec2(1.0, 1.0));
    vec2 s = vec2(1.0, 1.0) - t;
    for (int i = 0; i < 4; i++) {
        vec4 v = s.x * s.y * texelFetch(functions, ivec3(cell + ivec2(0, 0), i), 0) + t.x * s.y * texelFetch(functions, ivec3(cell + ivec2(1, 0), i), 0) + s.x * t.y * texelFetch(functions, ivec3(cell + ivec2(0, 1), i), 0) + t.x * t.y * texelFetch(functions, ivec3(cell + ivec2(1, 1), i), 0);
        basis[4 * i + 0] = v.x;
        basis[4 * i + 1] = v.y;
        basis[4 * i + 2] = v.z;
        basis[4 * i + 3] = v.w;
    }
    { vec4 v = s.x * s.y * texelFetch(functions, ivec3(cell + ivec2(0, 0), 4), 0) + t.x * s.y * texelFetch(functions, ivec3(cell + ivec2(1, 0), 4), 0) + s.x * t.y * texelFetch(functions, ivec3(cell + ivec2(0, 1), 4), 0) + t.x * t.y * texelFetch(functions, ivec3(cell + ivec2(1, 1), 4), 0); basis[16] = v.x; basis[17] = v.y; }
}

// By layer, over all arrays in turn: coefficient = scale * texel + bias, channel by channel.
const vec4 RELIGHT_SCALE[2] = vec4[2](
    vec4(0.3, 0.31370002, 0.3274, 0.0), vec4(0.3411, 0.35480002, 0.0, 0.0)
);
const vec4 RELIGHT_BIAS[2] = vec4[2](
    vec4(0.0, 0.07, -0.15556349, 0.0), vec4(0.12124355, -0.22, 0.0, 0.0)
);

// By layer: the function that weighs each channel of the texel in red.
const ivec4 RELIGHT_FUNCTION[2] = ivec4[2](
    ivec4(3, 6, 9, 0), ivec4(12, 15, 0, 0)
);

// The weights from the functions of light: in xyz how channel c of layer i adds to red, green and blue,
// at 3 * i + c, and at the end the mean, which is added to the sum.
void relight_layer_weights(float basis[RELIGHT_FUNCTIONS], out vec4 weights[RELIGHT_WEIGHTS]) {
    for (int layer = 0; layer < 2; layer++) {
        weights[layer * 3 + 0] = vec4(basis[RELIGHT_FUNCTION[layer].x + 0], basis[RELIGHT_FUNCTION[layer].x + 1], basis[RELIGHT_FUNCTION[layer].x + 2], 0.0);
        weights[layer * 3 + 1] = vec4(basis[RELIGHT_FUNCTION[layer].y + 0], basis[RELIGHT_FUNCTION[layer].y + 1], basis[RELIGHT_FUNCTION[layer].y + 2], 0.0);
        weights[layer * 3 + 2] = vec4(basis[RELIGHT_FUNCTION[layer].z + 0], basis[RELIGHT_FUNCTION[layer].z + 1], basis[RELIGHT_FUNCTION[layer].z + 2], 0.0);
    }
    weights[6] = vec4(basis[0], basis[1], basis[2], 0.0);
}

// The same from the unit direction l of a light. They are alike for all texels: work them out
// once a light, in an earlier stage or outside, rather than once a pixel.
void relight_weights(vec3 l, sampler2DArray functions, out vec4 weights[RELIGHT_WEIGHTS]) {
    float basis[RELIGHT_FUNCTIONS];
    relight_basis(l, functions, basis);
    relight_layer_weights(basis, weights);
}

// The color under the light of `weights`, at a texel (column, row from the top) of a mip level.
vec3 relight_shade(vec4 weights[RELIGHT_WEIGHTS], sampler2DArray maps_0, sampler2DArray maps_1, ivec2 texel, int level) {
    vec3 color = vec3(0.0, 0.0, 0.0);
    for (int layer = 0; layer < 1; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texelFetch(maps_0, ivec3(texel, layer), level) + RELIGHT_BIAS[layer];
        color = color + weights[layer * 3 + 0].xyz * p.x + weights[layer * 3 + 1].xyz * p.y + weights[layer * 3 + 2].xyz * p.z;
    }
    for (int layer = 1; layer < 2; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texelFetch(maps_1, ivec3(texel, (layer - 1)), level) + RELIGHT_BIAS[layer];
        color = color + weights[layer * 3 + 0].xyz * p.x + weights[layer * 3 + 1].xyz * p.y;
    }
    return color + weights[6].xyz;
}

// The color under the light of `weights`, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
vec3 relight_sample(vec4 weights[RELIGHT_WEIGHTS], sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv) {
    vec3 color = vec3(0.0, 0.0, 0.0);
    for (int layer = 0; layer < 1; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texture(maps_0, vec3(uv, float(layer))) + RELIGHT_BIAS[layer];
        color = color + weights[layer * 3 + 0].xyz * p.x + weights[layer * 3 + 1].xyz * p.y + weights[layer * 3 + 2].xyz * p.z;
    }
    for (int layer = 1; layer < 2; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * texture(maps_1, vec3(uv, float((layer - 1)))) + RELIGHT_BIAS[layer];
        color = color + weights[layer * 3 + 0].xyz * p.x + weights[layer * 3 + 1].xyz * p.y;
    }
    return color + weights[6].xyz;
}

// The color under the light of `weights`, through a sampler at uv of a mip level, for any stage.
vec3 relight_sample_level(vec4 weights[RELIGHT_WEIGHTS], sampler2DArray maps_0, sampler2DArray maps_1, vec2 uv, float level) {
    vec3 color = vec3(0.0, 0.0, 0.0);
    for (int layer = 0; layer < 1; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * textureLod(maps_0, vec3(uv, float(layer)), level) + RELIGHT_BIAS[layer];
        color = color + weights[layer * 3 + 0].xyz * p.x + weights[layer * 3 + 1].xyz * p.y + weights[layer * 3 + 2].xyz * p.z;
    }
    for (int layer = 1; layer < 2; layer++) {
        vec4 p = RELIGHT_SCALE[layer] * textureLod(maps_1, vec3(uv, float((layer - 1))), level) + RELIGHT_BIAS[layer];
        color = color + weights[layer * 3 + 0].xyz * p.x + weights[layer * 3 + 1].xyz * p.y;
    }
    return color + weights[6].xyz;
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
