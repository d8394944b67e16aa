"""Print the seconds to compile all rendering code once, from an empty cache, as one JSON object.

python tests/benchmarks/cold_compile.py
"""

from __future__ import annotations

import json
import os
import tempfile
import time


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder  # before numba is imported
        print(json.dumps(seconds()))


def seconds() -> dict[str, float]:
    import numpy as np

    started = time.perf_counter()
    from nvsim.benchmarks.random_room import random_room
    from nvsim.benchmarks.render import inside_view, measure
    from nvsim.geometry.floor_surface import FloorSurface
    from nvsim.render.background import render_background
    from nvsim.splats.types import FloorTexture, SubmapModel

    imported = time.perf_counter()
    measure(random_room(100), inside_view(32, 32), rounds=1)
    drawn = time.perf_counter()
    texture = FloorTexture((np.zeros((2, 2, 3), np.float32),), (0.0, 0.0), (1.0, 1.0))
    render_background(SubmapModel(random_room(10), None, texture, FloorSurface.flat(0.0)), inside_view(32, 32))
    figures = {
        "import_s": imported - started,
        "rasteriser_s": drawn - imported,
        "background_s": time.perf_counter() - drawn,
    }
    return {name: round(value, 2) for name, value in figures.items()}


if __name__ == "__main__":
    main()
