"""Devices for the Gaussians under training: numpy arrays and numba kernels, or tensors on a CUDA GPU and gsplat. This
package stores the arrays of each Gaussian, draws views, and propagates gradients; it has no loss and no schedule."""
