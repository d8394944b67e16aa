"""Writes the surroundings of scans to a file, which shows what the objects in instructions refer to."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nvsim.files import atomic
from nvsim.r2r.surroundings.survey import Surroundings


def write_surroundings(path: Path, scans: Mapping[str, Surroundings]) -> Path:
    """Writes {scan: {things, kinds, doorways}}; places in meters, world. Raises InputError if writing fails."""
    atomic.write_text(path, json.dumps({scan: _data(seen) for scan, seen in scans.items()}, indent=1) + "\n")
    return path


def _data(seen: Surroundings) -> dict[str, Any]:
    things = [
        {
            "colour": thing.colour,
            "shape": thing.shape,
            "place": thing.middle.round(2).tolist(),
            "sides": [round(side, 2) for side in thing.sides],
            "top": round(thing.top, 2),
        }
        for thing in seen.things
    ]
    doorways = [
        {"from": a, "to": b, "metres": [round(m, 2) for m in metres]} for (a, b), metres in seen.doors.items() if metres
    ]
    return {"things": things, "kinds": {id: kind for id, kind in seen.kinds.items() if kind}, "doorways": doorways}
