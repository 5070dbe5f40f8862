// Lights a part of a moving mesh by its irradiance rig. Written by relight; needs no other source.
//
// Model   mixed:3,gradient,constant: 6 vectors of 9 harmonics (3 bands)
//
// Declare before it    float3 relight_coefficient(int index)
// which reads from a buffer, a texture or what you like, for index = vector * 9 + l * l + l + m, R, G, B of
// the coefficients of radiance that the lights give the rig now (with Condon-Shortley phase, not multiplied by
// the cosine lobe): 54 in all.
//
//     float3 relight_reflectance(position, normal)
//         reflected radiance of a white diffuser: irradiance / pi. Times albedo it is the color
//     float relight_sphere_reflectance(position, normal, centre, radius)
//         the same of one sphere light of radiance 1, exact: times its color, added to the above
//         where the light is not in the rig
//
// The position of relight_reflectance is in the axes of the mesh, all else in those of the scene; normals are unit vectors.
// Source: Yuan, Nowrouzezahrai, Sloan, Irradiance Rigs.

static const int RELIGHT_PARAMETERS = 6;
static const int RELIGHT_FUNCTIONS = 9;

// The box of the mesh: its middle, what a float can't hold of that, and 1 / half of its edges.
static const float3 RELIGHT_CENTRE = float3(0.3, -1.7, 40.0);
static const float3 RELIGHT_CENTRE_REST = float3(-1.1920929e-8, 4.7683717e-8, 0.0);
static const float3 RELIGHT_PER_HALF_EXTENT = float3(0.5, 2.5, 0.2);

// Irradiance / pi of one vector of harmonics.
float3 relight_of_vector(int which, float3 n) {
    int at = which * RELIGHT_FUNCTIONS;
    float3 sum = 0.2820948 * relight_coefficient(at);
    sum = sum + -0.325735 * n.y * relight_coefficient(at + 1);
    sum = sum + 0.325735 * n.z * relight_coefficient(at + 2);
    sum = sum + -0.325735 * n.x * relight_coefficient(at + 3);
    sum = sum + 0.27313712 * n.x * n.y * relight_coefficient(at + 4);
    sum = sum + -0.27313712 * n.y * n.z * relight_coefficient(at + 5);
    sum = sum + 0.07884789 * (3.0 * n.z * n.z - 1.0) * relight_coefficient(at + 6);
    sum = sum + -0.27313712 * n.x * n.z * relight_coefficient(at + 7);
    sum = sum + 0.13656856 * (n.x * n.x - n.y * n.y) * relight_coefficient(at + 8);
    return sum;
}

// Reflected radiance of a white diffuser by the rig.
float3 relight_reflectance(float3 position, float3 normal) {
    float3 at = ((position - RELIGHT_CENTRE) - RELIGHT_CENTRE_REST) * RELIGHT_PER_HALF_EXTENT;
    float x_place = 0.5 * (clamp(at.x, -1.0, 1.0) + 1.0) * 2.0;
    int x_node = min(int(x_place), 1);
    float x_far = x_place - float(x_node);
    float3 sum = float3(0.0, 0.0, 0.0);
    sum = sum + (1.0 - x_far) * relight_of_vector(x_node, normal);
    sum = sum + x_far * relight_of_vector((x_node + 1), normal);
    sum = sum + (1.0 - x_far) * at.y * relight_of_vector(x_node + 3, normal);
    sum = sum + x_far * at.y * relight_of_vector((x_node + 1) + 3, normal);
    return sum;
}

// atan(k) - k, for k from -0.4142 to 0.4142.
float relight_atan_less(float k) {
    float q = k * k;
    return k * q * (-0.3333333 + q * (0.1999955 + q * (-0.14264232 + q * (0.10746299 + q * -0.06459376))));
}

// The angle of (x, y) for y >= 0, 0 to pi: atan2(y, x) without the freedom that languages give it.
float relight_angle(float y, float x) {
    float k = min(y, abs(x)) / max(max(y, abs(x)), 1.0e-37);
    float turned = 0.0;
    if (k > 0.41421357) {
        turned = 0.7853982;
        k = (k - 1.0) / (k + 1.0);
    }
    float angle = turned + (k + relight_atan_less(k));
    if (y > abs(x)) {
        angle = 1.5707964 - angle;
    }
    if (x < 0.0) {
        angle = 3.1415927 - angle;
    }
    return angle;
}

// Reflected radiance of a white diffuser under a sphere light of radiance 1, which the horizon of the normal may cut.
// A place inside sees what one on the sphere sees; in the middle itself, the light is towards +z.
float relight_sphere_reflectance(float3 position, float3 normal, float3 centre, float radius) {
    float3 to_centre = centre - position;
    float3 size = abs(to_centre);
    float largest = max(size.x, max(size.y, size.z));
    if (largest < 1.0e-37) {
        return 0.5 + 0.5 * normal.z;
    }
    // Divided by the largest component first: squares neither overflow nor vanish.
    float3 shorter = to_centre / largest;
    float distance = sqrt(dot(shorter, shorter));
    float ct = clamp(dot(normal, shorter) / distance, -1.0, 1.0);
    float s = radius / largest / distance;
    if (s >= 1.0) {
        return 0.5 + 0.5 * ct;
    }
    if (ct >= s) {
        return s * s * ct;
    }
    if (ct <= -s) {
        return 0.0;
    }
    float c = sqrt((1.0 - s) * (1.0 + s));
    float w = sqrt((s - ct) * (s + ct));
    float k = w / c;
    float lit = s * s * ct * relight_angle(w, -c * ct);
    if (s > 0.9) {
        return 0.31830987 * (lit - c * w + relight_angle(w, c));
    }
    // The same with s^2 k - (k - atan k) for the last two terms, which cancel for small lights.
    float less = relight_angle(w, c) - k;
    if (k <= 0.41421357) {
        less = relight_atan_less(k);
    }
    return 0.31830987 * (lit + s * s * k + less);
}
