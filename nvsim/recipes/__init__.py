"""How the networks that come with NVSim are made: examples of floor and normals, the network, its training and its
export. Nothing but the command depends on it."""
