"""The provenance of a map that NVSim built: a comment in its YAML file, which other programs ignore."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from nvsim.errors import InputError
from nvsim.files.regular import parse_json

Source = Literal["lidar", "depth", "images", "trained"]
"""The data from which rays were cast: LiDAR scans, images of a depth camera, depth estimated from images, or the
rendered depth of trained models."""
MARK = "# nvsim:"


@dataclass(frozen=True)
class Provenance:
    """source                  data from which the map was made
    note                    method and caveats, as text
    from_height, to_height  meters over the floor between which objects are obstacles
    makers                  digests of the project and of the trajectory used to make the map
    """

    source: Source
    note: str
    from_height: float
    to_height: float
    makers: tuple[str, ...] = ()

    def line(self) -> str:
        """The comment line, without a line end."""
        return f"{MARK} {json.dumps(asdict(self), ensure_ascii=True)}"


def provenance_in(path: Path, text: str) -> Provenance | None:
    """The provenance in the `text` of the YAML file `path`; None if there is none. Raises InputError if the comment is
    damaged."""
    remarks = [line for line in text.splitlines() if line.startswith(MARK)]
    if not remarks:
        return None
    then = f"delete the line that begins with {MARK!r}, or build the map again"
    found: Any = parse_json(path, remarks[0].removeprefix(MARK), "a map with a valid provenance", then)
    try:
        low, high, makers = float(found["from_height"]), float(found["to_height"]), found["makers"]
        if found["source"] not in get_args(Source) or not isinstance(makers, list):
            raise ValueError("another form")
        return Provenance(found["source"], str(found["note"]), low, high, tuple(map(str, makers)))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path} has a provenance in an invalid form; {then}.") from error
