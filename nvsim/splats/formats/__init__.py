"""Read and write Gaussians in file formats of other programs. This package does not depend on submap models."""
