"""The scale of a capture from one known length: the distance between the cameras of two images."""

from __future__ import annotations

import numpy as np

from nvsim.capture.raw import RawCapture
from nvsim.errors import InputError

_FORM = "give IMAGE,IMAGE,METERS, such as 0001.jpg,0150.jpg,4.2"


def scale_from_length(text: str, raw: RawCapture) -> float:
    """Meters per unit of `raw`, from a known distance between two cameras.

    `text` holds the names of two images and the meters between their cameras, separated by commas. A name may contain
    commas. Raises InputError if the text has another form, an image has no pose in the capture, or the two cameras
    coincide."""
    *words, last = text.split(",")
    try:
        meters = float(last)
    except ValueError:
        meters = 0.0
    if len(words) < 2 or not (np.isfinite(meters) and 0 < meters < 1e6):
        raise InputError(f"--known-length {text} is not a length between two images; {_FORM}.")
    places = {f.name: f.camera_to_world[:3, 3] for f in raw.frames if f.camera_to_world is not None}
    pairs = [(",".join(words[:k]).strip(), ",".join(words[k:]).strip()) for k in range(1, len(words))]
    one, other = next((pair for pair in pairs if set(pair) <= set(places)), pairs[0])
    for name in (one, other):
        if name not in places:
            example = f", such as {min(places)}" if places else ""
            raise InputError(f"--known-length names {name!r}, which is not an image with a pose; use another{example}.")
    distance = float(np.linalg.norm(places[one] - places[other]))
    extent = float(np.ptp(np.array(list(places.values())), axis=0).max())
    if not distance > 1e-3 * extent:
        raise InputError(
            f"The cameras of {one} and {other} are at the same place; name two images that are far from each other."
        )
    return meters / distance
