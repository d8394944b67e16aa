"""The OpenGL 3.3 core backend, for looking only: what the kernels projected is drawn as instanced quads, and the
background in the fragment shader. Knows no windows; Qt's context is given from outside."""
