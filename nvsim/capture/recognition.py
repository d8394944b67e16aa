"""Which format a capture has, told by the names of its files. Reads none of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.capture.colmap import find_model, model_extension
from nvsim.capture.kapture import find_kapture
from nvsim.capture.multi_capture import SUFFIX
from nvsim.capture.raw import file_size

CaptureFormat = Literal["nerfstudio", "several", "colmap", "kapture"]


@dataclass(frozen=True)
class CaptureFolder:
    """What lies in a folder: the root of a kapture tree, a transforms.json, the folder of a COLMAP model; None each
    where there is none."""

    kapture: Path | None
    transforms: Path | None
    model: Path | None

    @staticmethod
    def of(folder: Path) -> CaptureFolder:
        transforms = folder / "transforms.json"
        return CaptureFolder(
            find_kapture(folder), transforms if file_size(transforms) is not None else None, find_model(folder)
        )

    def __bool__(self) -> bool:
        return (self.kapture or self.transforms or self.model) is not None


def format_of_file(path: Path) -> CaptureFormat | None:
    """The format that a file is read as when it is named as a capture; None where its name is of none."""
    if path.suffix.lower() == ".json":
        return "nerfstudio"
    if path.suffix == SUFFIX:
        return "several"
    if path.stem in ("cameras", "images", "points3D") and model_extension(path.parent) is not None:
        return "colmap"
    if path.name == "sensors.txt" and find_kapture(path.parent) is not None:
        return "kapture"
    return None
