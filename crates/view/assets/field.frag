#version 300 es
// One ray per pixel through a factored field: see infonerf_ops::factored and infonerf_render's march.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp usampler3D;

const float PI = 3.141592653589793;
{{constants}}
{{samplers}}
uniform sampler2D lines;
// Steps of the greatest norm to the nearest occupied cell, 0 in one.
uniform usampler3D grid;
layout(std140) uniform Network { mat4 matrices[MATRICES]; vec4 biases[BIASES]; };
layout(std140) uniform Offsets { vec4 offsets[OFFSETS]; };

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
// Distance that the depth target's 1 stands for.
uniform float reach;

layout(location = 0) out vec4 shown;
layout(location = 1) out vec4 packedDepth;

vec4 product(sampler2DArray planes, int level, float resolution, int p, int g, vec3 u) {
    vec2 at = p == 0 ? u.xy : p == 1 ? u.xz : u.yz;
    float along = p == 0 ? u.z : p == 1 ? u.y : u.x;
    int row = (level * 3 + p) * GROUPS + g;
    vec4 plane = textureLod(planes, vec3(at, float(p * GROUPS + g)), 0.0) + offsets[2 * row];
    float texel = clamp(along * resolution, 0.5, resolution - 0.5);
    vec2 place = vec2(texel / float(LINE_WIDTH), (float(row) + 0.5) / float(LINE_ROWS));
    return plane * (textureLod(lines, place, 0.0) + offsets[2 * row + 1]);
}

// Raw density, red, green, blue; then how each colour changes with the direction.
void network(vec3 u, out vec4 y[OUTPUTS]) {
    vec4 x[INPUTS];
    x[0] = vec4(2.0 * u - 1.0, 0.0);
    vec3 s = sin(PI * (u - 0.5)), c = cos(PI * (u - 0.5));
    for (int f = 0; f < FREQUENCIES; f++) {
        x[1 + 2 * f] = vec4(s, 0.0);
        x[2 + 2 * f] = vec4(c, 0.0);
        vec3 twice = 2.0 * s * c;
        c = 1.0 - 2.0 * s * s;
        s = twice;
    }
    for (int p = 0; p < 3; p++) {
        for (int g = 0; g < GROUPS; g++) {
            int k = 1 + 2 * FREQUENCIES + p * GROUPS + g;
{{features}}
        }
    }
{{layers}}
}

vec3 normalised(vec3 p) {
    return clamp((p - LOW) / SIZE, 0.0, 1.0);
}

float density(float raw) {
    float x = raw + DENSITY_BIAS;
    return DENSITY_SCALE * (max(x, 0.0) + log(1.0 + exp(-abs(x))));
}

vec3 emitted(vec4 y[OUTPUTS], vec3 direction) {
    vec3 raw = y[0].yzw;
#if OUTPUTS > 1
    raw += vec3(dot(y[1].xyz, direction), dot(y[2].xyz, direction), dot(y[3].xyz, direction));
#endif
    return 1.0 / (1.0 + exp(-raw));
}

{{space}}

// The part of the ray in which there can be something, in coordinates.
bool within(vec3 direction, float cosine, out float near, out float far) {
    near = interval.x;
    far = interval.y;
#if RANGE == 1
    if (cosine <= 1e-3) return false;
    near /= cosine;
    far /= cosine;
#elif RANGE == 2
    float middle = dot(RANGE_CENTRE - eye, direction);
    near = middle - RANGE_RADIUS;
    far = middle + RANGE_RADIUS;
#endif
    near = max(near, 0.0);
#ifdef HORIZON
    far = HORIZON;
#endif
#if CLIPS
    vec3 a = (LOW - eye) / direction, b = (LOW + SIZE - eye) / direction;
    vec3 first = min(a, b), last = max(a, b);
    near = max(near, max(first.x, max(first.y, first.z)));
    far = min(far, min(last.x, min(last.y, last.z)));
#endif
    if (!(near < far)) return false;
    near = coordinate(near);
    far = coordinate(far);
    return true;
}

// How many cells about `cell` are empty: 0 for none, also beyond the grid.
float room(vec3 cell) {
    if (any(lessThan(cell, vec3(0.0))) || any(greaterThanEqual(cell, vec3(GRID)))) return 0.0;
    return float(texelFetch(grid, ivec3(cell), 0).r);
}

vec3 turbo(float t) {
    float at = clamp(t, 0.0, 1.0) * float(TURBO_LAST);
    int i = min(int(at), TURBO_LAST - 1);
    return mix(TURBO[i], TURBO[i + 1], at - float(i));
}

// The direction in which density falls, from four points about one on the ray.
vec3 normal(vec3 p, float t) {
    float h = NORMAL_STEP(t);
    vec3 slope = vec3(0.0);
    vec4 y[OUTPUTS];
    for (int i = 0; i < 4; i++) {
        vec3 corner = vec3(i < 2 ? 1.0 : -1.0, i % 2 == 0 ? 1.0 : -1.0, i == 0 || i == 3 ? 1.0 : -1.0);
        network(normalised(warp(p + h * corner)), y);
        slope += y[0].x * corner;
    }
    return -slope / max(sqrt(dot(slope, slope)), 1e-12);
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
        vec4 y[OUTPUTS];
        float i = 0.0;
        while (i < count) {
            float t = distanceAt(near + (i + 0.5) * delta);
            vec3 p = warp(eye + t * direction);
            vec3 cell = (p - LOW) / SIZE * float(GRID);
            float k = room(cell);
            if (k > 0.0) {
                float steps = 1.0;
#if STRAIGHT
                vec3 along = direction / SIZE * float(GRID);
                vec3 edge = floor(cell) + mix(vec3(1.0 - k), vec3(k), step(0.0, along));
                vec3 exits = (edge - cell) / along;
                steps = max(1.0, ceil(min(exits.x, min(exits.y, exits.z)) / delta - 1e-3));
#endif
                i += steps;
                continue;
            }
            network(normalised(p), y);
            float opening = exp(-density(y[0].x) * delta);
            float w = trans * (1.0 - opening);
            color += w * emitted(y, direction);
            depth += w * t;
            trans *= opening;
            if (trans <= STOP) break;
            i += 1.0;
        }
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
