// A field baked into bricks of voxels: see infonerf_view's `baked`.
{{constants}}
// Number of each cell's brick, from 1; 0 if it has none.
uniform usampler3D bricks;
// Root of a voxel's opacity.
uniform sampler3D opacities;
// Constant of each colour, and its derivatives by x, y and z of the direction.
uniform sampler3D reds;
uniform sampler3D greens;
uniform sampler3D blues;

// Stored opacity of the point last looked at, and its place in the textures.
float root;
vec3 place;

// Looks at a point, and returns a value that grows with the density there.
float look(vec3 p) {
    root = 0.0;
    vec3 voxel = (p - LOW) / VOXEL;
    ivec3 cell = ivec3(floor(voxel / float(BRICK)));
    if (any(lessThan(cell, ivec3(0))) || any(greaterThanEqual(cell, GRID))) return 0.0;
    int brick = int(texelFetch(bricks, cell, 0).r) - 1;
    if (brick < 0) return 0.0;
    ivec3 at = ivec3(brick % ATLAS.x, (brick / ATLAS.x) % ATLAS.y, brick / (ATLAS.x * ATLAS.y));
    vec3 texel = vec3(at * (BRICK + 1)) + voxel - vec3(cell * BRICK) + 0.5;
    place = texel / vec3(ATLAS * (BRICK + 1));
    root = textureLod(opacities, place, 0.0).r;
    return root;
}

float density() {
    return -log(1.0 - MAX_OPACITY * root * root) / VOXEL;
}

vec3 emitted(vec3 direction) {
    vec4 terms = vec4(1.0, direction);
    vec3 color = vec3(
        dot(RED_LOW + RED_RANGE * textureLod(reds, place, 0.0), terms),
        dot(GREEN_LOW + GREEN_RANGE * textureLod(greens, place, 0.0), terms),
        dot(BLUE_LOW + BLUE_RANGE * textureLod(blues, place, 0.0), terms));
    return clamp(color, 0.0, MAX_COLOR);
}
