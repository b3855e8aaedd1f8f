// Factored field: see infonerf_ops::factored.
{{constants}}
{{samplers}}
uniform sampler2D lines;
layout(std140) uniform Network { mat4 matrices[MATRICES]; vec4 biases[BIASES]; };
layout(std140) uniform Offsets { vec4 offsets[OFFSETS]; };

// Raw density, red, green and blue of the point last looked at; then the derivative of each colour by the direction.
vec4 y[OUTPUTS];

vec4 product(sampler2DArray planes, int level, float resolution, int p, int g, vec3 u) {
    vec2 at = p == 0 ? u.xy : p == 1 ? u.xz : u.yz;
    float along = p == 0 ? u.z : p == 1 ? u.y : u.x;
    int row = (level * 3 + p) * GROUPS + g;
    vec4 plane = textureLod(planes, vec3(at, float(p * GROUPS + g)), 0.0) + offsets[2 * row];
    float texel = clamp(along * resolution, 0.5, resolution - 0.5);
    vec2 place = vec2(texel / float(LINE_WIDTH), (float(row) + 0.5) / float(LINE_ROWS));
    return plane * (textureLod(lines, place, 0.0) + offsets[2 * row + 1]);
}

// Computes a layer of the MLP: each of the `count` vectors of `to` from the `from_count` vectors of `from`, with its matrices from
// `matrix` and its biases from `bias` on. `result` is what becomes of a `sum`.
#define LAYER(to, count, from, from_count, matrix, bias, result) \
    for (int o = 0; o < count; o++) { \
        vec4 sum = biases[bias + o]; \
        for (int i = 0; i < from_count; i++) sum += matrices[matrix + o * from_count + i] * from[i]; \
        to[o] = result; \
    }

// Looks at a point, and returns a value that grows with the density there.
float look(vec3 p) {
    vec3 u = clamp((p - LOW) / SIZE, 0.0, 1.0);
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
    return y[0].x;
}

float density() {
    float x = y[0].x + DENSITY_BIAS;
    return DENSITY_SCALE * (max(x, 0.0) + log(1.0 + exp(-abs(x))));
}

vec3 emitted(vec3 direction) {
    vec3 raw = y[0].yzw;
#if OUTPUTS > 1
    raw += vec3(dot(y[1].xyz, direction), dot(y[2].xyz, direction), dot(y[3].xyz, direction));
#endif
    return 1.0 / (1.0 + exp(-raw));
}
