"""The evidence of corridors: measured from views, joined over models, stacked for a whole graph, and decided again
under other thresholds."""
