"""What a map that was built here says of itself: one remark in its YAML file, which other programs pass over."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from nvsim.errors import InputError
from nvsim.files.regular import parse_json

Source = Literal["lidar", "depth", "images", "trained"]
"""What rays were cast from: scans of a LiDAR, images of a depth camera, depth estimated from images, or the rendered
depth of trained models."""
MARK = "# nvsim:"


@dataclass(frozen=True)
class Provenance:
    """source                  what it was made from
    note                    how, and what to mind, in words
    from_height, to_height  metres over the floor between which things stand in the way
    makers                  digests of the project and of the trajectory that it was made with
    """

    source: Source
    note: str
    from_height: float
    to_height: float
    makers: tuple[str, ...] = ()

    def line(self) -> str:
        """The remark, without its end of line."""
        return f"{MARK} {json.dumps(asdict(self), ensure_ascii=True)}"


def provenance_in(path: Path, text: str) -> Provenance | None:
    """What the `text` of the YAML file `path` says; None where it says nothing. Raises InputError where the remark is
    damaged."""
    remarks = [line for line in text.splitlines() if line.startswith(MARK)]
    if not remarks:
        return None
    then = f"delete the line that begins with {MARK!r}, or build the map again"
    found: Any = parse_json(path, remarks[0].removeprefix(MARK), "a map that says what it was made from", then)
    try:
        low, high, makers = float(found["from_height"]), float(found["to_height"]), found["makers"]
        if found["source"] not in get_args(Source) or not isinstance(makers, list):
            raise ValueError("another form")
        return Provenance(found["source"], str(found["note"]), low, high, tuple(map(str, makers)))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path} does not say in the right form what it was made from; {then}.") from error
