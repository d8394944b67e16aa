"""LPIPS with a network that the user provides: any ONNX export with two images as input and a distance as output.

The file contains the whole metric (Zhang et al. 2018: AlexNet or VGG features, unit-normalized, squared differences
weighted and averaged). Exports use various input names, so the inputs are passed by position.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.networks.folder import find_file, models_folder
from nvsim.networks.onnx_session import DoesNotRun, Session

Range = Literal["auto", "-1..1", "0..1"]
Image = NDArray[np.float32]
METADATA = "input_range"
"""Key of the ONNX metadata that gives the range of input values: "-1..1" or "0..1"."""
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_MOST = 4096  # pixels of an image's side
_EQUAL = 1e-3  # a distance must be smaller than this for equal images


class Lpips:
    """An opened network. Called with two images (H, W, 3) float32, 0 to 1, it returns their distance.

    values   range of the network's input: "-1..1" as in the original, "0..1" if the export scales by itself, "auto" as
             the file's metadata `input_range` says, else "-1..1"

    Raises InputError if the file cannot be loaded or is not a distance of two images.
    """

    def __init__(self, path: Path, values: Range = "auto") -> None:
        if not path.is_file():
            raise InputError(f"There is no LPIPS model {path}; give an ONNX file with --lpips FILE.onnx.")
        self._session = Session(path)
        self.path = path
        inputs = self._session.inputs
        if len(inputs) != 2 or any(len(i.shape) != 4 or i.type not in _TYPES for i in inputs):
            found = ", ".join(f"{i.name} {i.type} {list(i.shape)}" for i in inputs)
            raise InputError(f"{path} takes {found}; LPIPS takes two float images of shape (1, 3, H, W).")
        self._inputs = inputs
        said = self._session.metadata.get(METADATA, "-1..1")
        self.values = said if values == "auto" else values
        if self.values not in ("-1..1", "0..1"):
            raise InputError(f"{path} says {METADATA} = {said!r}; it must be -1..1 or 0..1 (or use --lpips-range).")
        self._try()

    def __call__(self, a: Image, b: Image) -> float:
        """The distance of two images (H, W, 3) float32, 0 to 1. Raises InputError if the network does not accept their
        size."""
        feeds = {i.name: self._tensor(x, i.type) for i, x in zip(self._inputs, (a, b), strict=True)}
        try:
            found = self._session.run(None, feeds)[0]
        except DoesNotRun as error:
            height, width = a.shape[:2]
            raise InputError(
                f"{self.path} does not accept images of {width}x{height} pixels ({error.reason}); "
                "export it with dynamic height and width."
            ) from error
        return float(np.mean(found))

    def _tensor(self, image: Image, kind: str) -> NDArray[Any]:
        planes = np.ascontiguousarray(np.clip(image, 0, 1).transpose(2, 0, 1)[None])
        return (planes * 2 - 1 if self.values == "-1..1" else planes).astype(_TYPES[kind])

    def _try(self) -> None:
        """Checks that equal images have distance 0 and different images do not. Raises InputError."""
        height, width = (size if isinstance(size, int) else 64 for size in self._inputs[0].shape[2:])
        if not (0 < height <= _MOST and 0 < width <= _MOST):
            raise InputError(f"{self.path} takes images of {width} x {height} pixels; export it with dynamic size.")
        rng = np.random.default_rng(0)
        a, b = rng.random((2, height, width, 3), np.float32)
        same, other = self(a, a), self(a, b)
        if not (abs(same) < _EQUAL and np.isfinite(other) and other > _EQUAL):
            raise InputError(
                f"{self.path} is not an image distance: it gives {same:.3g} for equal, {other:.3g} for other images; "
                "choose an LPIPS export."
            )


def open_lpips(path: Path | None, values: Range = "auto") -> tuple[Lpips | None, str]:
    """The network at `path`, or `lpips.onnx` in the user's models folder. None and the reason if there is none.

    Raises InputError if a named file is missing or is not an LPIPS network.
    """
    found = path or find_file("lpips")
    if found is None:
        return None, f"no LPIPS model: give --lpips FILE.onnx (or copy lpips.onnx into {models_folder()})"
    return Lpips(found, values), ""
