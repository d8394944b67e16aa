// One quad per splat: the rectangle of its ellipse. Row 0 of the image is the first in memory.
#version 330 core
uniform vec2 size;       // of the image, pixels
in vec2 centre;          // pixels
in vec4 axes;            // long and short semi-axis, pixels
in vec4 paint;           // colour, log2 of the opacity
out vec2 place;          // in units of the semi-axes
flat out vec4 splat;

void main() {
    place = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    splat = paint;
    vec2 pixel = centre + place.x * axes.xy + place.y * axes.zw;
    gl_Position = vec4(pixel / size * 2.0 - 1.0, 0.0, 1.0);
}
