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

static const int RELIGHT_WIDTH = 20;
static const int RELIGHT_HEIGHT = 12;
static const int RELIGHT_LEVELS = 5;
static const int RELIGHT_FUNCTIONS = 4;
static const int RELIGHT_LAYERS = 3;

// Centres of the Gaussians, and 1 / (2 spread^2).
static const float3 RELIGHT_CENTRE[4] = {
    float3(0.5087297, 0.037987065, 0.8600878), float3(-0.5461133, 0.54895216, 0.63278097),
    float3(0.09521229, -0.897841, 0.42990258), float3(0.6059029, 0.789886, 0.09466663)
};
static const float RELIGHT_SHARPNESS = 0.49461544;

// The angle between unit vectors from the chord to b, or from the chord to -b where that is shorter.
float relight_angle(float3 a, float3 b) {
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
float relight_gaussian(float3 l, float3 centre) {
    float angle = relight_angle(l, centre);
    return exp(-RELIGHT_SHARPNESS * angle * angle);
}

// The functions of light at the unit direction l, which points from the surface to the light
// (x right in the picture, y up, z towards the viewer).
void relight_basis(float3 l, out float basis[RELIGHT_FUNCTIONS]) {
    for (int i = 0; i < 4; i++) {
        basis[i] = relight_gaussian(l, RELIGHT_CENTRE[i]);
    }
}

// By layer, over all arrays in turn: coefficient = scale * texel + bias, channel by channel.
static const float4 RELIGHT_SCALE[3] = {
    float4(0.3, 0.31370002, 0.0, 0.0), float4(0.3274, 0.3411, 0.0, 0.0),
    float4(0.35480002, 0.3685, 0.3822, 0.0)
};
static const float4 RELIGHT_BIAS[3] = {
    float4(0.0, 0.07, 0.0, 0.0), float4(-0.15556349, 0.12124355, 0.0, 0.0),
    float4(-0.22, 0.15652476, -0.26944387, 0.0)
};

// By layer: the function that weighs each channel of the texel, 0 where none does.
static const int4 RELIGHT_FUNCTION[3] = {
    int4(0, 1, 0, 0), int4(2, 3, 0, 0), int4(0, 0, 0, 0)
};

// The weight of each layer's channels, from the functions of light.
void relight_layer_weights(float basis[RELIGHT_FUNCTIONS], out float4 weights[RELIGHT_LAYERS]) {
    for (int layer = 0; layer < 3; layer++) {
        weights[layer] = float4(basis[RELIGHT_FUNCTION[layer].x], basis[RELIGHT_FUNCTION[layer].y], basis[RELIGHT_FUNCTION[layer].z], basis[RELIGHT_FUNCTION[layer].w]);
    }
}

// The same from the unit direction l of a light. They are alike for all texels: work them out
// once a light, in an earlier stage or outside, rather than once a pixel.
void relight_weights(float3 l, out float4 weights[RELIGHT_LAYERS]) {
    float basis[RELIGHT_FUNCTIONS];
    relight_basis(l, basis);
    relight_layer_weights(basis, weights);
}

// The color under the light of `weights`, at a texel (column, row from the top) of a mip level.
float3 relight_shade(float4 weights[RELIGHT_LAYERS], Texture2DArray<float4> maps_0, Texture2DArray<float4> maps_1, int2 texel, int level) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        float4 p = weights[layer] * (RELIGHT_SCALE[layer] * maps_0.Load(int4(texel, layer, level)) + RELIGHT_BIAS[layer]);
        luminance = luminance + p.x + p.y;
    }
    float3 base_color = float3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        float4 p = RELIGHT_SCALE[layer] * maps_1.Load(int4(texel, (layer - 2), level)) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return luminance * base_color;
}

// The color under the light of `weights`, through a sampler at uv ((0, 0) is the
// top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow.
float3 relight_sample(float4 weights[RELIGHT_LAYERS], Texture2DArray<float4> maps_0, Texture2DArray<float4> maps_1, SamplerState maps_sampler, float2 uv) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        float4 p = weights[layer] * (RELIGHT_SCALE[layer] * maps_0.Sample(maps_sampler, float3(uv, float(layer))) + RELIGHT_BIAS[layer]);
        luminance = luminance + p.x + p.y;
    }
    float3 base_color = float3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        float4 p = RELIGHT_SCALE[layer] * maps_1.Sample(maps_sampler, float3(uv, float((layer - 2)))) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return luminance * base_color;
}

// The color under the light of `weights`, through a sampler at uv of a mip level, for any stage.
float3 relight_sample_level(float4 weights[RELIGHT_LAYERS], Texture2DArray<float4> maps_0, Texture2DArray<float4> maps_1, SamplerState maps_sampler, float2 uv, float level) {
    float luminance = 0.0;
    for (int layer = 0; layer < 2; layer++) {
        float4 p = weights[layer] * (RELIGHT_SCALE[layer] * maps_0.SampleLevel(maps_sampler, float3(uv, float(layer)), level) + RELIGHT_BIAS[layer]);
        luminance = luminance + p.x + p.y;
    }
    float3 base_color = float3(0.0, 0.0, 0.0);
    for (int layer = 2; layer < 3; layer++) {
        float4 p = RELIGHT_SCALE[layer] * maps_1.SampleLevel(maps_sampler, float3(uv, float((layer - 2))), level) + RELIGHT_BIAS[layer];
        base_color = base_color + p.xyz;
    }
    return luminance * base_color;
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
float3 relight_to_linear(float3 color) {
    return float3(relight_linear_channel(color.x), relight_linear_channel(color.y), relight_linear_channel(color.z));
}

// An sRGB-encoded color from a shaded one, for targets that do not encode by themselves.
float3 relight_to_encoded(float3 color) {
    return color;
}

// A point light: in xyz the unit direction from the surface to it, for relight_weights; in w its
// attenuation, 1 / distance^2, by which the linear color is multiplied. Positions are in the
// picture's axes (x right, y up, z towards the viewer). Nearer than minimum_distance (above 1e-18)
// the attenuation stays what it is there; a light at the surface itself counts as straight above.
float4 relight_point_light(float3 surface, float3 light, float minimum_distance) {
    float3 to_light = light - surface;
    float3 size = abs(to_light);
    float largest = max(size.x, max(size.y, size.z));
    float3 direction = float3(0.0, 0.0, 1.0);
    // Divided by the largest component first: squares neither overflow nor vanish.
    if (largest > 1.0e-37) {
        direction = normalize(to_light / largest);
    }
    float square = max(dot(to_light, to_light), minimum_distance * minimum_distance);
    return float4(direction, 1.0 / square);
}
