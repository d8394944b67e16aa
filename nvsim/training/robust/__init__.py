"""Robust masks, which leave pixels with transients out of training. Does not depend on the trainer."""
