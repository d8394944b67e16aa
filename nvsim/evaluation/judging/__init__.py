"""Compare two images of the same view by their use to an agent, with vision-language models and with metrics. This is
the paper's third table."""
