"""Extracts features to the files of several layouts, so that layouts with the same backbone share its work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from nvsim.events import Listener
from nvsim.r2r.features.backbone import Backbone
from nvsim.r2r.features.candidate_views import extract_candidates
from nvsim.r2r.features.exported_scan import ExportedScan
from nvsim.r2r.features.extraction import extract
from nvsim.r2r.features.layouts import Layout


def extract_layouts(
    scans: Sequence[ExportedScan], chosen: Sequence[tuple[Layout, Backbone]], folder: Path, listen: Listener
) -> Iterator[tuple[list[Layout], list[Path]]]:
    """Writes the file of each layout to `folder`. Layouts with equal backbones come together. Yields the layouts that
    were written together, and the written paths. Raises InputError as `extract` and `extract_candidates` do."""
    groups: dict[str, tuple[list[Layout], Backbone]] = {}
    for layout, backbone in chosen:
        if layout.tokens:
            yield [layout], extract_candidates(scans, layout, backbone, folder, listen)
        else:
            groups.setdefault(backbone.digest, ([], backbone))[0].append(layout)
    for layouts, backbone in groups.values():
        yield layouts, extract(scans, layouts, backbone, folder, listen)
