// Alpha falls from the opacity in the centre to 1/255 on the ellipse, and is nothing beyond it.
#version 330 core
const float LOG_CUT = -7.99435344;  // log2(1/255)
const float ALPHA_MAX = 0.99;
const float DIMMED = 0.25;  // colours may be brighter than 1, and the target holds no more than that
in vec2 place;
flat in vec4 splat;
out vec4 result;  // dimmed colour times alpha, alpha

void main() {
    float r = dot(place, place);
    float alpha = r > 1.0 ? 0.0 : min(exp2(mix(splat.a, LOG_CUT, r)), ALPHA_MAX);
    result = vec4(DIMMED * splat.rgb * alpha, alpha);
}
