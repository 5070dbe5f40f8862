// Lights a part of a moving mesh by its irradiance rig. Written by relight; needs no other source.
//
// Model   mixed:3,gradient,constant: 6 vectors of 9 harmonics (3 bands)
//
// Declare beside it    fn relight_coefficient(index: i32) -> vec3f
// which reads from a buffer, a texture or what you like, for index = vector * 9 + l * l + l + m, R, G, B of
// the coefficients of radiance that the lights give the rig now (with Condon-Shortley phase, not multiplied by
// the cosine lobe): 54 in all.
//
//     vec3f relight_reflectance(position, normal)
//         reflected radiance of a white diffuser: irradiance / pi. Times albedo it is the color
//     f32 relight_sphere_reflectance(position, normal, centre, radius)
//         the same of one sphere light of radiance 1, exact: times its color, added to the above
//         where the light is not in the rig
//
// The position of relight_reflectance is in the axes of the mesh, all else in those of the scene; normals are unit vectors.
// Source: Yuan, Nowrouzezahrai, Sloan, Irradiance Rigs.

const RELIGHT_PARAMETERS: i32 = 6;
const RELIGHT_FUNCTIONS: i32 = 9;

// The box of the mesh: its middle, what a float can't hold of that, and 1 / half of its edges.
const RELIGHT_CENTRE: vec3f = vec3f(0.3, -1.7, 40.0);
const RELIGHT_CENTRE_REST: vec3f = vec3f(-1.1920929e-8, 4.7683717e-8, 0.0);
const RELIGHT_PER_HALF_EXTENT: vec3f = vec3f(0.5, 2.5, 0.2);

// Irradiance / pi of one vector of harmonics.
fn relight_of_vector(which: i32, n: vec3f) -> vec3f {
    let at = which * RELIGHT_FUNCTIONS;
    var sum: vec3f = 0.2820948 * relight_coefficient(at);
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
fn relight_reflectance(position: vec3f, normal: vec3f) -> vec3f {
    let at = ((position - RELIGHT_CENTRE) - RELIGHT_CENTRE_REST) * RELIGHT_PER_HALF_EXTENT;
    let x_place = 0.5 * (clamp(at.x, -1.0, 1.0) + 1.0) * 2.0;
    let x_node = min(i32(x_place), 1);
    let x_far = x_place - f32(x_node);
    var sum: vec3f = vec3f(0.0, 0.0, 0.0);
    sum = sum + (1.0 - x_far) * relight_of_vector(x_node, normal);
    sum = sum + x_far * relight_of_vector((x_node + 1), normal);
    sum = sum + (1.0 - x_far) * at.y * relight_of_vector(x_node + 3, normal);
    sum = sum + x_far * at.y * relight_of_vector((x_node + 1) + 3, normal);
    return sum;
}

// atan(k) - k, for k from -0.4142 to 0.4142.
fn relight_atan_less(k: f32) -> f32 {
    let q = k * k;
    return k * q * (-0.3333333 + q * (0.1999955 + q * (-0.14264232 + q * (0.10746299 + q * -0.06459376))));
}

// The angle of (x, y) for y >= 0, 0 to pi: atan2(y, x) without the freedom that languages give it.
fn relight_angle(y: f32, x: f32) -> f32 {
    var k: f32 = min(y, abs(x)) / max(max(y, abs(x)), 1.0e-37);
    var turned: f32 = 0.0;
    if (k > 0.41421357) {
        turned = 0.7853982;
        k = (k - 1.0) / (k + 1.0);
    }
    var angle: f32 = turned + (k + relight_atan_less(k));
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
fn relight_sphere_reflectance(position: vec3f, normal: vec3f, centre: vec3f, radius: f32) -> f32 {
    let to_centre = centre - position;
    let size = abs(to_centre);
    let largest = max(size.x, max(size.y, size.z));
    if (largest < 1.0e-37) {
        return 0.5 + 0.5 * normal.z;
    }
    // Divided by the largest component first: squares neither overflow nor vanish.
    let shorter = to_centre / largest;
    let distance = sqrt(dot(shorter, shorter));
    let ct = clamp(dot(normal, shorter) / distance, -1.0, 1.0);
    let s = radius / largest / distance;
    if (s >= 1.0) {
        return 0.5 + 0.5 * ct;
    }
    if (ct >= s) {
        return s * s * ct;
    }
    if (ct <= -s) {
        return 0.0;
    }
    let c = sqrt((1.0 - s) * (1.0 + s));
    let w = sqrt((s - ct) * (s + ct));
    let k = w / c;
    let lit = s * s * ct * relight_angle(w, -c * ct);
    if (s > 0.9) {
        return 0.31830987 * (lit - c * w + relight_angle(w, c));
    }
    // The same with s^2 k - (k - atan k) for the last two terms, which cancel for small lights.
    var less: f32 = relight_angle(w, c) - k;
    if (k <= 0.41421357) {
        less = relight_atan_less(k);
    }
    return 0.31830987 * (lit + s * s * k + less);
}
