"""Describe what is near each viewpoint in words, for agents that read texts and no images, as NavGPT does.

The texts come from surroundings.json: objects, doorways, and the kind of room. They name eight directions of 45 degrees
each; the first one is +y, and the others follow to the right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.errors import InputError
from nvsim.files.opening import read_json

if TYPE_CHECKING:
    from nvsim.r2r.features.exported_scan import ExportedScan

SECTORS = 8
_NOTHING = "No object with a name is near."


@dataclass
class TextViews:
    """The texts of one viewpoint.

    kind      "room", "corridor", or "" if unknown
    found     for each direction the names of near objects and doorways, with heading in degrees and distance in meters
    """

    kind: str = ""
    found: list[dict[str, dict[str, float]]] = field(default_factory=lambda: [{} for _ in range(SECTORS)])

    def add(self, name: str, heading: float, meters: float) -> None:
        """Adds an object or a doorway at a heading in radians. The nearest one of a name and a direction stays."""
        degrees = math.degrees(heading) % 360
        here = self.found[round(degrees / (360 / SECTORS)) % SECTORS]
        if name not in here or meters < here[name]["distance"]:
            here[name] = {"heading": degrees, "distance": meters}

    @property
    def sentences(self) -> list[str]:
        """One text for each direction."""
        return [
            " ".join(f"{_with_article(name)}, {at['distance']:.1f} meters away." for name, at in here.items())
            or _NOTHING
            for here in self.found
        ]

    @property
    def summary(self) -> str:
        """One text for the viewpoint."""
        names = list(dict.fromkeys(name for here in self.found for name in here))
        place = f"A {self.kind}." if self.kind else "An indoor place."
        return f"{place} Near it: {', '.join(_with_article(name).lower() for name in names)}." if names else place


def read_text_views(path: Path, scan: ExportedScan) -> dict[str, TextViews]:
    """The texts of the viewpoints of a scan, from a surroundings.json. Without the file, the texts name nothing. Raises
    InputError if the file is damaged."""
    from nvsim.r2r.instructions.phrases import plain_name

    found = {id: TextViews() for id in scan.viewpoints}
    if not path.is_file():
        return found
    data = read_json(path, "the surroundings of scans", "write the tasks again")
    place = dict(zip(scan.viewpoints, scan.positions))
    try:
        seen: Mapping[str, Any] = data.get(scan.id, {})
        for id, kind in seen.get("kinds", {}).items():
            found[id].kind = str(kind)
        for id, near in seen.get("near", {}).items():
            for one in near:
                thing = seen["things"][one["thing"]]
                found[id].add(plain_name(thing["shape"], thing["colour"]), one["heading"], one["metres"])
        for door in seen.get("doorways", []):
            if door["from"] in found and door["to"] in place:
                x, y, _ = place[door["to"]] - place[door["from"]]
                found[door["from"]].add("doorway", math.atan2(x, y), float(door["metres"][0]))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(f"{path} is damaged at {error}; write the tasks again.") from error
    return found


def _with_article(name: str) -> str:
    return f"An {name}" if name[0] in "aeiou" else f"A {name}"
