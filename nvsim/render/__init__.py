"""One rasteriser contract and its backends, views of submap models and of the scene, panoramas.

Torch only in `nvsim.render.autograd`; everything else draws without it."""
