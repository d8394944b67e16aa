"""LPIPS by a network that the user brings: any ONNX export with two images in and a distance out.

The distance itself (Zhang et al. 2018: AlexNet or VGG features, unit-normalised, squared differences weighted and
averaged) is in the file; exports name their inputs as they like, so they are fed in order.
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
"""Key of the ONNX file's own properties that says which values it takes: "-1..1" or "0..1"."""
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_MOST = 4096  # pixels of an image's side
_EQUAL = 1e-3  # more than this between equal images is no distance


class Lpips:
    """An opened network. Called with two images (H, W, 3) float32 in 0 to 1, it gives their distance.

    values   what the network takes: "-1..1" as the original does, "0..1" where the export scales by itself, "auto" as
             the file's property `input_range` says, else "-1..1"

    Raises InputError for a file that cannot be loaded or is no distance of two images.
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
        """Raises InputError where the network refuses the images' size."""
        feeds = {i.name: self._tensor(x, i.type) for i, x in zip(self._inputs, (a, b), strict=True)}
        try:
            found = self._session.run(None, feeds)[0]
        except DoesNotRun as error:
            height, width = a.shape[:2]
            raise InputError(
                f"{self.path} does not take images of {width}x{height} pixels ({error.reason}); "
                "export it with dynamic height and width."
            ) from error
        return float(np.mean(found))

    def _tensor(self, image: Image, kind: str) -> NDArray[Any]:
        planes = np.ascontiguousarray(np.clip(image, 0, 1).transpose(2, 0, 1)[None])
        return (planes * 2 - 1 if self.values == "-1..1" else planes).astype(_TYPES[kind])

    def _try(self) -> None:
        """Equal images are at distance 0, others are not."""
        height, width = (size if isinstance(size, int) else 64 for size in self._inputs[0].shape[2:])
        if not (0 < height <= _MOST and 0 < width <= _MOST):
            raise InputError(f"{self.path} takes images of {width} x {height} pixels; export it with dynamic size.")
        rng = np.random.default_rng(0)
        a, b = rng.random((2, height, width, 3), np.float32)
        same, other = self(a, a), self(a, b)
        if not (abs(same) < _EQUAL and np.isfinite(other) and other > _EQUAL):
            raise InputError(
                f"{self.path} is no distance of images: equal ones are at {same:.3g}, different ones at {other:.3g}; "
                "choose an LPIPS export."
            )


def open_lpips(path: Path | None, values: Range = "auto") -> tuple[Lpips | None, str]:
    """The network at `path`, or `lpips.onnx` in the user's models folder; None and the reason where there is none.

    Raises InputError for a named file that is missing and for one that is no LPIPS.
    """
    found = path or find_file("lpips")
    if found is None:
        return None, f"no LPIPS model: give --lpips FILE.onnx (or put lpips.onnx into {models_folder()})"
    return Lpips(found, values), ""
