"""Create a lens from numbers in a file, or report why it is invalid."""

from __future__ import annotations

from collections.abc import Sequence

from nvsim.capture.findings import Findings
from nvsim.geometry.lens import Lens

LARGEST_SIDE = 65_535  # pixels; the limit of JPEG
FOCAL_RANGE = (0.1, 1e6)  # pixels


def read_lens(
    model: str, width: float, height: float, params: Sequence[float], where: str, findings: Findings
) -> Lens | None:
    """The lens, or None and an error finding if the model is unknown, or a count, a size, or a number is invalid."""
    if not all(1 <= v <= LARGEST_SIDE and v == int(v) for v in (width, height)):
        shown = "x".join(f"{v:g}" if abs(v) < 1e300 else "huge" for v in (width, height))
        findings.error(
            f"the image size {shown} is not two whole numbers of pixels",
            where,
            "no frame can use this camera",
        )
        return None
    try:
        lens = Lens(model, int(width), int(height), tuple(params))
    except (ValueError, OverflowError) as error:
        findings.error(str(error), where, "no frame can use this camera")
        return None
    if not all(FOCAL_RANGE[0] <= f <= FOCAL_RANGE[1] for f in lens.focal) or max(map(abs, params)) > FOCAL_RANGE[1]:
        findings.error(f"the camera parameters {lens.params} are not in pixels", where, "no frame can use this camera")
        return None
    return lens
