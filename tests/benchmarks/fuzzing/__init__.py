"""Damaged and hostile files for every reader of the product: `tests/benchmarks/fuzz.py` runs it.

It knows how files are damaged and how a reading is watched; what the readers do is theirs.
"""
