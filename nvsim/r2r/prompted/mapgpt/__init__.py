"""A navigation agent without training that asks a vision-language model.

Each question has the known part of the graph in words, views of the seen places, and the model's plan, which is carried
from step to step. The idea is that of MapGPT (Chen et al. 2024, arXiv 2401.07314); prompts and code are new.
"""
