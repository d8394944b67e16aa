"""Compare two images of one view by their use to an agent, with vision-language models and with metrics. This is
the paper's third table."""
