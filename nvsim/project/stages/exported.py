"""Exports the committed graph as R2R files for other programs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.project.occupancy_maps import occupancy_of
from nvsim.project.project import Project


def export_r2r(project: Project, out: Path, scan: str | None, frame: str, force: bool = False) -> Path:
    """Writes `<scan>_connectivity.json` and scans.txt into `out`, and returns the path of the connectivity file.

    scan   scan id, None for that of the project
    frame  "aligned", or "capture", which undoes the alignment
    force  export even if agents cannot use the graph

    `visible` is line of sight on the project's occupancy map, if it has one. Raises InputError if there is no graph, if
    the frame of the capture is not upright, or if agents cannot use the graph and `force` is not set.
    """
    from nvsim.graph.connectivity import write_connectivity
    from nvsim.graph.exports import refuse
    from nvsim.graph.sight import lines_of_sight

    graph = replace(project.need_graph(), scan=scan or project.scan_name)
    if not force:
        refuse(graph)
    visible = lines_of_sight(graph, occupancy_of(project))  # by viewpoint id, so the frame does not matter
    if frame == "capture":
        alignment = project.need_capture().alignment
        if np.degrees(np.arccos(np.clip(alignment.rotation[2, 2], -1, 1))) > 2.0:
            raise InputError(
                f"The frame of the capture is not z-up, but R2R needs z up; export {project.layout.root} with "
                "--frame aligned."
            )
        from nvsim.capture.alignment import to_capture_frame

        moved = {}
        for id, v in graph.viewpoints.items():
            x, y, z = to_capture_frame(np.array([v.position]), alignment)[0]
            moved[id] = replace(v, position=(float(x), float(y), float(z)), height=v.height / alignment.scale)
        graph = replace(graph, viewpoints=moved)
    return write_connectivity(graph, out, visible)
