#version 300 es
// One ray per pixel through a field: see infonerf_render's march. `look`, `density` and `emitted` are the field's own.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp sampler3D;
precision highp usampler3D;

const float PI = 3.141592653589793;
// Values of WARP.
#define IDENTITY 0
#define NDC 1
#define CONTRACTION 2
// Values of RANGE: `interval` holds distances, depths along the camera's axis, or is replaced by a sphere.
#define DISTANCE 0
#define DEPTH 1
#define SPHERE 2
{{constants}}
// Steps of the greatest norm to the nearest occupied cell, 0 in one.
uniform usampler3D grid;

uniform vec3 eye;
// Right, up and back of the camera.
uniform mat3 axes;
// Focal lengths and principal point, pixels of the target from its top left corner.
uniform vec4 lens;
uniform float height;
uniform vec2 interval;
uniform vec3 background;
// 0 colour, 1 depth, 2 normals.
uniform int mode;
// Distance of the depth target's 1.
uniform float reach;

layout(location = 0) out vec4 shown;
layout(location = 1) out vec4 packedDepth;

{{field}}

// The warp of infonerf_render: `warp` maps a point to the space of the field, `coordinate` a distance along a ray to the coordinate
// in which steps are equal, and `distanceAt` maps back.
#if WARP == NDC
vec3 warp(vec3 p) {
    vec3 q = (TO_CAMERA * vec4(p, 1.0)).xyz;
    float z = max(-q.z, 0.5 * WARP_NEAR);
    return vec3(WARP_SCALE * q.xy / z, 1.0 - 2.0 * WARP_NEAR / z);
}
float coordinate(float t) { return 4.0 * (1.0 - WARP_NEAR / max(t, 1e-3 * WARP_NEAR)); }
float distanceAt(float s) { return WARP_NEAR / max(1.0 - s / 4.0, 1e-4); }
#elif WARP == CONTRACTION
vec3 warp(vec3 p) {
    vec3 x = (p - WARP_CENTRE) / WARP_RADIUS;
    float r = sqrt(dot(x, x));
    return r <= 1.0 ? x : x * ((2.0 - 1.0 / r) / r);
}
float coordinate(float t) { float u = t / WARP_RADIUS; return u <= 2.0 ? u : 4.0 - 4.0 / u; }
float distanceAt(float s) { return WARP_RADIUS * (s <= 2.0 ? s : 4.0 / max(4.0 - s, 4e-4)); }
#else
vec3 warp(vec3 p) { return p; }
float coordinate(float t) { return t; }
float distanceAt(float s) { return s; }
#endif

// Finds the part of the ray that can be occupied, in coordinates.
bool within(vec3 direction, float cosine, out float near, out float far) {
    near = interval.x;
    far = interval.y;
#if RANGE == DEPTH
    if (cosine <= 1e-3) return false;
    near /= cosine;
    far /= cosine;
#elif RANGE == SPHERE
    float middle = dot(RANGE_CENTRE - eye, direction);
    near = middle - RANGE_RADIUS;
    far = middle + RANGE_RADIUS;
#endif
    near = max(near, 0.0);
#if WARP == CONTRACTION
    far = 1e4 * WARP_RADIUS;
#endif
#if CLIPS
    vec3 a = (CLIP_LOW - eye) / direction, b = (CLIP_HIGH - eye) / direction;
    vec3 first = min(a, b), last = max(a, b);
    near = max(near, max(first.x, max(first.y, first.z)));
    far = min(far, min(last.x, min(last.y, last.z)));
#endif
    if (!(near < far)) return false;
    near = coordinate(near);
    far = coordinate(far);
    return true;
}

// Returns the number of empty cells about `cell`: 0 if it is occupied or beyond the grid.
float emptyCells(vec3 cell) {
    if (any(lessThan(cell, vec3(0.0))) || any(greaterThanEqual(cell, vec3(GRID)))) return 0.0;
    return float(texelFetch(grid, ivec3(cell), 0).r);
}

vec3 turbo(float t) {
    float at = clamp(t, 0.0, 1.0) * float(TURBO_LAST);
    int i = min(int(at), TURBO_LAST - 1);
    return mix(TURBO[i], TURBO[i + 1], at - float(i));
}

// Returns the direction in which density falls, from four points about one on the ray.
vec3 normal(vec3 p, float t) {
#if WARP == NDC
    float h = 0.005 * t;
#elif WARP == CONTRACTION
    float h = DETAIL * WARP_RADIUS;
#else
    float h = DETAIL;
#endif
    vec3 gradient = vec3(0.0);
    for (int i = 0; i < 4; i++) {
        vec3 corner = vec3(i < 2 ? 1.0 : -1.0, i % 2 == 0 ? 1.0 : -1.0, i == 0 || i == 3 ? 1.0 : -1.0);
        gradient += look(warp(p + h * corner)) * corner;
    }
    return -gradient / max(sqrt(dot(gradient, gradient)), 1e-12);
}

vec3 bytes(float v) {
    vec3 parts = fract(v * vec3(1.0, 255.0, 65025.0));
    return parts - vec3(parts.yz / 255.0, 0.0);
}

void main() {
    vec2 image = (vec2(gl_FragCoord.x, height - gl_FragCoord.y) - lens.zw) / lens.xy;
    vec3 local = vec3(image.x, -image.y, -1.0);
    float cosine = inversesqrt(dot(local, local));
    vec3 direction = axes * (local * cosine);
    vec3 color = vec3(0.0);
    float depth = 0.0, trans = 1.0, near, far;
    if (within(direction, cosine, near, far)) {
        float count = max(ceil((far - near) / STEP), 1.0);
        float delta = (far - near) / count;
        float i = 0.0;
        while (i < count) {
            float t = distanceAt(near + (i + 0.5) * delta);
            vec3 p = warp(eye + t * direction);
            vec3 cell = (p - LOW) / CELL;
            float k = emptyCells(cell);
            if (k > 0.0) {
                float steps = 1.0;
#if WARP == IDENTITY
                vec3 along = direction / CELL;
                vec3 edge = floor(cell) + mix(vec3(1.0 - k), vec3(k), step(0.0, along));
                vec3 exits = (edge - cell) / along;
                steps = max(1.0, ceil(min(exits.x, min(exits.y, exits.z)) / delta - 1e-3));
#endif
                i += steps;
                continue;
            }
            look(p);
            float tau = density() * delta;
#if ADDITIVE
            float w = min(tau, trans);
            float left = trans - w;
#else
            float opening = exp(-tau);
            float w = trans * (1.0 - opening);
            float left = trans * opening;
#endif
            if (w > 0.0) color += w * emitted(direction);
            depth += w * t;
            trans = left;
            if (trans <= STOP) break;
            i += 1.0;
        }
#if ENDLESS
        // The last sample, at the far end, represents everything behind it.
        float last = distanceAt(far);
        look(warp(eye + last * direction));
        if (density() > 0.0) {
            color += trans * emitted(direction);
            depth += trans * last;
            trans = 0.0;
        }
#endif
    }
    float acc = 1.0 - trans;
    bool hit = acc > 0.5;
    float mean = hit ? depth / acc : 0.0;
    shown = vec4(color + trans * background, 1.0);
    if (mode == 1) {
        shown.rgb = hit ? mix(vec3(1.0), turbo((interval.y - mean) / (interval.y - interval.x)), acc) : vec3(1.0);
    } else if (mode == 2) {
        shown.rgb = hit ? mix(vec3(1.0), 0.5 + 0.5 * normal(eye + mean * direction, mean), acc) : vec3(1.0);
    }
    packedDepth = vec4(bytes(min(mean / reach, 0.999)), hit ? 1.0 : 0.0);
}
