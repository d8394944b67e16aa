"""Damaged and hostile files for every reader of the product. `tests/benchmarks/fuzz.py` runs it.

The package damages files and watches how they are read. The readers themselves belong to the product.
"""
