"""Damaged and hostile files for every reader of the product. `tests/benchmarks/fuzz.py` runs it.

The package damages files and watches how they are read. The readers themselves belong to the product.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "unit"))  # the samples of the unit tests
