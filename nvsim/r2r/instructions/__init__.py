"""Generates instructions from the geometry of paths, and checks that a follower finds the path from them.

Works offline and without a network."""

from typing import Literal

Register = Literal["short", "detailed", "rxr"]
"""Style of instructions. "short": about 25 words without meters, as in R2R. "detailed": every fact in a clause of its
own. "rxr": long descriptions of views and movements with meters, as in RxR."""
