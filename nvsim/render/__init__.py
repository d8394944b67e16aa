"""Rendering: one rasterizer interface and its backends, views of submap models and of the scene, and panoramas.

Only `nvsim.render.autograd` and the gsplat backend use torch. `nvsim.render.autograd.rasterize` is for your own
training code: a differentiable torch function of the five tensors of the Gaussians, on the CPU. The library does not
call it; resources/docs/rasterizer.md has an example."""
