"""Makes the bundled networks: examples of floor and normals, the network, its training, and its export. Only the
command `nvsim models train` uses this package."""
