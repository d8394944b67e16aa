// Marks pixels that let nothing through any more: their depth becomes the nearest, so that the splats behind are refused
// before they are shaded.
#version 330 core
uniform sampler2D splats;  // dimmed colour, transmittance
uniform float least;

void main() {
    if (texelFetch(splats, ivec2(gl_FragCoord.xy), 0).a >= least) discard;
}
