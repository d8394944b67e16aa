"""An agent without training that finds its way by asking a model: what it knows of the graph in words, views of the
places that it saw, and a plan that it carries from step to step.

The idea is that of MapGPT (Chen et al. 2024, arXiv 2401.07314); words and code are ours."""
