// The splats over the background: spherical harmonics of the ray's direction, and the floor texture where the ray meets
// the floor surface. The same arithmetic as nvsim/render/background.py and floor_texture.py.
#version 330 core
const float DARK = 1.0 / 1024.0;   // of a background dimmed by more than this nothing can be seen
const float BRIGHTER = 4.0;         // undoes what splat.frag dims
const float FLATTEST = -0.02;      // rays that point down by less do not meet the floor
uniform sampler2D splats;          // dimmed colour, transmittance
uniform vec2 size;                 // of the camera's image, pixels
uniform vec4 viewport;             // x, y, width, height of the target
uniform bool top_first;            // whether the target's first row is the image's top
uniform bool blue_first;
uniform mat3 to_world;             // columns: the camera's right, down and forward
uniform vec4 lens;                 // focal lengths, principal point, pixels
uniform vec3 backdrop;             // behind everything
out vec4 result;

#ifdef SKY
uniform vec3 sky[25];

vec3 sky_colour(vec3 d) {
    float x = d.x, y = d.y, z = d.z;
    float xx = x * x, yy = y * y, zz = z * z, xy = x * y, yz = y * z, xz = x * z;
    vec3 c = 0.28209479 * sky[0];
    c += -0.48860251 * y * sky[1];
    c += 0.48860251 * z * sky[2];
    c += -0.48860251 * x * sky[3];
    c += 1.09254843 * xy * sky[4];
    c += -1.09254843 * yz * sky[5];
    c += 0.31539157 * (2.0 * zz - xx - yy) * sky[6];
    c += -1.09254843 * xz * sky[7];
    c += 0.54627422 * (xx - yy) * sky[8];
    c += -0.59004359 * y * (3.0 * xx - yy) * sky[9];
    c += 2.89061144 * xy * z * sky[10];
    c += -0.45704580 * y * (4.0 * zz - xx - yy) * sky[11];
    c += 0.37317633 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * sky[12];
    c += -0.45704580 * x * (4.0 * zz - xx - yy) * sky[13];
    c += 1.44530572 * z * (xx - yy) * sky[14];
    c += -0.59004359 * x * (xx - 3.0 * yy) * sky[15];
    c += 2.50334294 * xy * (xx - yy) * sky[16];
    c += -1.77013077 * yz * (3.0 * xx - yy) * sky[17];
    c += 0.94617470 * xy * (7.0 * zz - 1.0) * sky[18];
    c += -0.66904654 * yz * (7.0 * zz - 3.0) * sky[19];
    c += 0.10578555 * (zz * (35.0 * zz - 30.0) + 3.0) * sky[20];
    c += -0.66904654 * xz * (7.0 * zz - 3.0) * sky[21];
    c += 0.47308735 * (xx - yy) * (7.0 * zz - 1.0) * sky[22];
    c += -1.77013077 * xz * (xx - 3.0 * yy) * sky[23];
    c += 0.62583574 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)) * sky[24];
    return c;
}
#endif

#ifdef FLOOR
uniform vec3 eye;
uniform sampler2D heights;         // world z at the centres of the grid's cells
uniform vec3 grid;                 // centre x, y of the first cell, spacing
uniform vec4 bounds;               // low x, y and high x, y of the texture
uniform float texels[FLOOR];       // texel size of each level, metres
LEVEL_SAMPLERS

float height_at(vec2 xy) {
    vec2 cells = vec2(textureSize(heights, 0));
    return textureLod(heights, ((xy - grid.xy) / grid.z + 0.5) / cells, 0.0).r;
}

// Metres along the direction, not above zero where the ray does not meet the floor.
float distance_to_floor(vec3 d) {
    if (!(d.z < FLATTEST)) return -1.0;
    float distance = (height_at(eye.xy) - eye.z) / d.z;
    if (textureSize(heights, 0) != ivec2(1))
        for (int i = 0; i < 4; i++) distance = (height_at(eye.xy + distance * d.xy) - eye.z) / d.z;
    return distance;
}

// A level is a residual over the coarser ones: faded out where a pixel covers one to three of its texels.
vec3 level_colour(sampler2D level, float texel, vec2 share, float footprint) {
    float weight = clamp(1.5 - 0.5 * footprint / texel, 0.0, 1.0);
    return weight > 0.0 ? weight * textureLod(level, share, 0.0).rgb : vec3(0.0);
}

vec3 floor_colour(vec3 d, float forward) {
    float distance = distance_to_floor(d);
    if (!(distance > 0.0)) return vec3(0.0);
    float footprint = distance * forward / (lens.x * sqrt(-d.z));
    vec2 share = (eye.xy + distance * d.xy - bounds.xy) / (bounds.zw - bounds.xy);
    vec3 c = vec3(0.0);
    LEVEL_SUM
    return c;
}
#endif

void main() {
    vec2 pixel = (gl_FragCoord.xy - viewport.xy) / viewport.zw * size;
    if (!top_first) pixel.y = size.y - pixel.y;
    vec4 front = textureLod(splats, pixel / size, 0.0);
    vec3 colour = BRIGHTER * front.rgb;
    if (front.a >= DARK) {
        vec3 behind = backdrop;
        vec3 local = vec3((pixel - lens.zw) / lens.xy, 1.0);
        float forward = inversesqrt(dot(local, local));
        vec3 d = to_world * local * forward;
#ifdef SKY
        behind += sky_colour(d);
#endif
#ifdef FLOOR
        behind += floor_colour(d, forward);
#endif
        colour += front.a * behind;
    }
    result = vec4(blue_first ? colour.bgr : colour, 1.0);
}
