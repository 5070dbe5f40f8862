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
// where a function wants it, one sampler for all.
// The functions of light are a table in one more array texture, functions: 7 x 7 texels of
// f16, unfiltered (relight shader --table writes it).
//
//     once a light    weights = relight_weights(direction, functions)
//     once a pixel    color = relight_shade(weights, maps_0 .., texel, level)
//                     or relight_sample(weights, maps_0 .., uv)
//
// The sum runs by array, then layer, then channel: coefficient = scale * texel + bias, then
// sum = sum + weight * coefficient, in this order and unfolded, as the CPU reference does.

const RELIGHT_WIDTH: i32 = 20;
const RELIGHT_HEIGHT: i32 = 12;
const RELIGHT_LEVELS: i32 = 1;
const RELIGHT_FUNCTIONS: i32 = 18;
const RELIGHT_LAYERS: i32 = 2;
const RELIGHT_WEIGHTS: i32 = 7;

// Nodes along an edge of the table of functions.
const RELIGHT_NODES: i32 = 7;

// Where a direction lies in the table, an unfolded octahedron, in units of nodes.
fn relight_place(l: vec3f) -> vec2f {
    let p = l.xy / (abs(l.x) + abs(l.y) + abs(l.z));
    let side_x = select(-1.0, 1.0, p.x >= 0.0);
    let side_y = select(-1.0, 1.0, p.y >= 0.0);
    let folded = vec2f((1.0 - abs(p.y)) * side_x, (1.0 - abs(p.x)) * side_y);
    let square = select(p, folded, l.z < 0.0);
    return 6.0 * (0.5 * square + 0.5);
}

// The functions of light at the unit direction l, which points from the surface to the light
// (x right in the picture, y up, z towards the viewer).
fn relight_basis(l: vec3f, functions: texture_2d_array<f32>) -> array<f32, RELIGHT_FUNCTIONS> {
    var basis: array<f32, RELIGHT_FUNCTIONS>;
    let place = relight_place(l);
    let cell = vec2i(clamp(floor(place), vec2f(0.0, 0.0), vec2f(1.0, 1.0) * f32(RELIGHT_NODES - 2)));
    let t = clamp(place - vec2f(cell), vec2f(0.0, 0.0), vec2f(1.0, 1.0));
    let s = vec2f(1.0, 1.0) - t;
    { let v = s.x * s.y * textureLoad(functions, cell + vec2i(0, 0), 0, 0) + t.x * s.y * textureLoad(functions, cell + vec2i(1, 0), 0, 0) + s.x * t.y * textureLoad(functions, cell + vec2i(0, 1), 0, 0) + t.x * t.y * textureLoad(functions, cell + vec2i(1, 1), 0, 0); basis[0] = v.x; basis[1] = v.y; basis[2] = v.z; basis[3] = v.w; }
    { let v = s.x * s.y * textureLoad(functions, cell + vec2i(0, 0), 1, 0) + t.x * s.y * textureLoad(functions, cell + vec2i(1, 0), 1, 0) + s.x * t.y * textureLoad(functions, cell + vec2i(0, 1), 1, 0) + t.x * t.y * textureLoad(functions, cell + vec2i(1, 1), 1, 0); basis[4] = v.x; basis[5] = v.y; basis[6] = v.z; basis[7] = v.w; }
    { let v = s.x * s.y * textureLoad(functions, cell + vec2i(0, 0), 2, 0) + t.x * s.y * textureLoad(functions, cell + vec2i(1, 0), 2, 0) + s.x * t.y * textureLoad(functions, cell + vec2i(0, 1), 2, 0) + t.x * t.y * textureLoad(functions, cell + vec2i(1, 1), 2, 0); basis[8] = v.x; basis[9] = v.y; basis[10] = v.z; basis[11] = v.w; }
    { let v = s.x * s.y * textureLoad(functions, cell + vec2i(0, 0), 3, 0) + t.x * s.y * textureLoad(functions, cell + vec2i(1, 0), 3, 0) + s.x * t.y * textureLoad(functions, cell + vec2i(0, 1), 3, 0) + t.x * t.y * textureLoad(functions, cell + vec2i(1, 1), 3, 0); basis[12] = v.x; basis[13] = v.y; basis[14] = v.z; basis[15] = v.w; }
    { let v = s.x * s.y * textureLoad(functions, cell + vec2i(0, 0), 4, 0) + t.x * s.y * textureLoad(functions, cell + vec2i(1, 0), 4, 0) + s.x * t.y * textureLoad(functions, cell + vec2i(0, 1), 4, 0) + t.x * t.y * textureLoad(functions, cell + vec2i(1, 1), 4, 0); basis[16] = v.x; basis[17] = v.y; }
    return basis;
}

// By layer, over all arrays in turn: coefficient = scale * texel + bias, channel by channel.
const RELIGHT_SCALE_0 = vec4f(0.3, 0.31370002, 0.3274, 0.0);
const RELIGHT_SCALE_1 = vec4f(0.3411, 0.35480002, 0.0, 0.0);
const RELIGHT_BIAS_0 = vec4f(0.0, 0.07, -0.15556349, 0.0);
const RELIGHT_BIAS_1 = vec4f(0.12124355, -0.22, 0.0, 0.0);

// The weights from the functions of light: in xyz how channel c of layer i adds to red, green and blue,
// at 3 * i + c, and at the end the mean, which is added to the sum.
fn relight_layer_weights(basis: array<f32, RELIGHT_FUNCTIONS>) -> array<vec4f, RELIGHT_WEIGHTS> {
    var weights: array<vec4f, RELIGHT_WEIGHTS>;
    { weights[0] = vec4f(basis[3], basis[4], basis[5], 0.0); weights[1] = vec4f(basis[6], basis[7], basis[8], 0.0); weights[2] = vec4f(basis[9], basis[10], basis[11], 0.0); }
    { weights[3] = vec4f(basis[12], basis[13], basis[14], 0.0); weights[4] = vec4f(basis[15], basis[16], basis[17], 0.0); weights[5] = vec4f(basis[0], basis[1], basis[2], 0.0); }
    weights[6] = vec4f(basis[0], basis[1], basis[2], 0.0);
    return weights;
}

// The same from the unit direction l of a light. They are alike for all texels: work them out
// once a light, in an earlier stage or outside, rather than once a pixel.
fn relight_weights(l: vec3f, functions: texture_2d_array<f32>) -> array<vec4f, RELIGHT_WEIGHTS> {
    var weights: array<vec4f, RELIGHT_WEIGHTS>;
    var basis: array<f32, RELIGHT_FUNCTIONS>;
    basis = relight_basis(l, functions);
    weights = relight_layer_weights(basis);
    return weights;
}

// The color under the light of `weights`, at a texel (column, row from the top) of a mip level.
fn relight_shade(weights: array<vec4f, RELIGHT_WEIGHTS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, texel: vec2i, level: i32) -> vec3f {
    var color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_0 * textureLoad(maps_0, texel, 0, level) + RELIGHT_BIAS_0; color = color + weights[0].xyz * p.x + weights[1].xyz * p.y + weights[2].xyz * p.z; }
    { let p = RELIGHT_SCALE_1 * textureLoad(maps_1, texel, 0, level) + RELIGHT_BIAS_1; color = color + weights[3].xyz * p.x + weights[4].xyz * p.y; }
    return color + weights[6].xyz;
}

// The color under the light of `weights`, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
fn relight_sample(weights: array<vec4f, RELIGHT_WEIGHTS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f) -> vec3f {
    var color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_0 * textureSample(maps_0, maps_sampler, uv, 0) + RELIGHT_BIAS_0; color = color + weights[0].xyz * p.x + weights[1].xyz * p.y + weights[2].xyz * p.z; }
    { let p = RELIGHT_SCALE_1 * textureSample(maps_1, maps_sampler, uv, 0) + RELIGHT_BIAS_1; color = color + weights[3].xyz * p.x + weights[4].xyz * p.y; }
    return color + weights[6].xyz;
}

// The color under the light of `weights`, through a sampler at uv of a mip level, for any stage.
fn relight_sample_level(weights: array<vec4f, RELIGHT_WEIGHTS>, maps_0: texture_2d_array<f32>, maps_1: texture_2d_array<f32>, maps_sampler: sampler, uv: vec2f, level: f32) -> vec3f {
    var color: vec3f = vec3f(0.0, 0.0, 0.0);
    { let p = RELIGHT_SCALE_0 * textureSampleLevel(maps_0, maps_sampler, uv, 0, level) + RELIGHT_BIAS_0; color = color + weights[0].xyz * p.x + weights[1].xyz * p.y + weights[2].xyz * p.z; }
    { let p = RELIGHT_SCALE_1 * textureSampleLevel(maps_1, maps_sampler, uv, 0, level) + RELIGHT_BIAS_1; color = color + weights[3].xyz * p.x + weights[4].xyz * p.y; }
    return color + weights[6].xyz;
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
