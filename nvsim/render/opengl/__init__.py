"""The OpenGL 3.3 core backend, for the window. Splats projected by the kernels are drawn as instanced quads; the
background is evaluated in the fragment shader. Independent of the window system; the caller provides Qt's context."""
