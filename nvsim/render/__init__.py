"""One rasteriser contract and its backends, views of submap models and of the scene, panoramas.

Torch only in `nvsim.render.autograd`; everything else draws without it. Its `rasterize` is for training code of your
own: a differentiable torch function of the five tensors of the Gaussians, on the CPU. The library does not call it;
resources/docs/rasteriser.md shows it at work."""
