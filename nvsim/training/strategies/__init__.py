"""How a model grows: strategies that divide, clone, move and remove Gaussians while they are fitted, one a file. Knows
Gaussians and their statistics; no image, no loss, no optimiser."""
