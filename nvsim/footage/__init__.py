"""Videos and photos without camera poses: find them, decode them, choose frames, and track points.

The package does not depend on projects. `nvsim.poses` computes the camera poses of the chosen frames."""
