"""Names in a project's cache of what the window makes for its frames. Knows no Qt."""

from __future__ import annotations

import hashlib
from pathlib import Path

from nvsim.project.layout import Layout

THUMBNAIL = (160, 120)  # pixels, at least in one direction
COVERAGE = "coverage.json"


def thumbnail_path(layout: Layout, image_path: Path) -> Path:
    """By the image's own path, so that a capture that is imported anew finds its thumbnails again."""
    name = hashlib.sha1(str(image_path).encode(), usedforsecurity=False).hexdigest()[:20]
    return layout.cache / "thumbnails" / f"{name}.jpg"
