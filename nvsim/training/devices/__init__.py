"""Where the Gaussians under training are and who draws them: numpy arrays and the numba kernels, or tensors on a CUDA
card and gsplat. Knows what belongs to each Gaussian and how a view is drawn and sent back; no loss, no schedule."""
