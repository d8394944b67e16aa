"""Arguments -> library -> progress and tables. Thin: nothing here computes."""
