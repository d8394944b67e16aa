"""What the data check says of the poses of a capture."""

from __future__ import annotations

from nvsim.capture.findings import Finding
from nvsim.capture.types import Capture
from nvsim.poses.refinement import is_good, miss


def of_poses(capture: Capture) -> Finding | None:
    """That they contradict the images, and what becomes of it; None where they do not, or nobody can tell."""
    if not capture.alignment.scale_known or is_good(missed := miss(capture.frames)):
        return None
    message = f"the poses miss what images have in common by {missed:.2f} pixels, where exact ones miss it by 0.1"
    if capture.is_scanned:
        consequence = "models are blurred by it; --poses refined adjusts the poses to the images"
        return Finding("warning", message, "the whole capture", consequence)
    consequence = "they are adjusted when it is imported; --poses given keeps them"
    return Finding("note", message, "the whole capture", consequence)
