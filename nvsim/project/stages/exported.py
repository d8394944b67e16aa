"""Export: the committed graph as files that other programs read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.project.project import Project
from nvsim.project.stages.mapped import scan_name


def export_r2r(project: Project, out: Path, scan: str | None, frame: str, force: bool = False) -> Path:
    """Writes `<scan>_connectivity.json` and scans.txt; returns the path of the former. `visible` is line of sight on
    the project's occupancy map, where it has one.

    `frame` "capture" undoes the alignment. Raises InputError when that frame is not upright, there is no graph, or
    agents would choke on it and `force` is not set.
    """
    from nvsim.graph.connectivity import write_connectivity
    from nvsim.graph.exports import refuse
    from nvsim.graph.sight import lines_of_sight

    graph = replace(project.need_graph(), scan=scan or scan_name(project))
    if not force:
        refuse(graph)
    visible = lines_of_sight(graph, project.occupancy())  # asked by name, so that the frame does not matter
    if frame == "capture":
        alignment = project.need_capture().alignment
        if np.degrees(np.arccos(np.clip(alignment.rotation[2, 2], -1, 1))) > 2.0:
            raise InputError(
                f"the capture's own frame is not z-up, and R2R needs z up; export {project.layout.root} with "
                "--frame aligned."
            )
        from nvsim.capture.alignment import to_capture_frame

        moved = {}
        for id, v in graph.viewpoints.items():
            x, y, z = to_capture_frame(np.array([v.position]), alignment)[0]
            moved[id] = replace(v, position=(float(x), float(y), float(z)), height=v.height / alignment.scale)
        graph = replace(graph, viewpoints=moved)
    return write_connectivity(graph, out, visible)
