"""The command that writes scenes for Habitat."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli.arguments import Positional
from nvsim.cli.terminal import as_json, print_lines

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class ExportHabitat:
    """Write exported scans as scenes that Habitat opens: a colored surface and a collision mesh as GLB files, and their
    configurations. The episodes of `nvsim export tasks --vlnce`, --rxr and --goals name these scenes."""

    export: Positional[Path]
    """The folder of an export, which contains connectivity/ and strips with depth."""
    project: Path | None = None
    """The project of the scan. Its point cloud adds obstacles that the strips do not show."""
    out: Path = Path("scenes")
    """The output folder, which is Habitat's folder of scenes (SCENES_DIR)."""
    scans: tuple[str, ...] = ()
    """Scans to write. Default: all that scans.txt lists."""
    voxel: float = 0.05
    """Side of a voxel in meters. Smaller voxels show more detail; files and time grow."""
    json: bool = False
    """Print the written files as JSON."""

    def run(self) -> int:
        from nvsim.cli.console import event_listener
        from nvsim.dataset.habitat.scene import write_scenes
        from nvsim.events import ignore_event

        clouds = _clouds(self.project)
        with event_listener(False) as heard:
            listen = ignore_event if self.json else heard
            written = write_scenes(self.export, self.out, self.scans, self.voxel, clouds, listen)
        if self.json:
            rows = [
                {
                    "scan": one.scan,
                    "written": [str(path) for path in one.files],
                    "triangles": one.triangles,
                    "collision_triangles": one.collision_triangles,
                }
                for one in written
            ]
            print_lines(as_json({"scenes": rows}))
            return 0
        for one in written:
            print_lines(f"{one.scan}: {one.triangles:,} triangles, {one.collision_triangles:,} of the collision mesh")
            print_lines(*(f"Wrote {path}" for path in one.files))
        return 0


def _clouds(path: Path | None) -> dict[str, NDArray[np.floating]]:
    """The point cloud of a project by scan id. Raises InputError if the project cannot be opened."""
    if path is None:
        return {}
    from nvsim.project.project import Project

    with Project.open(path) as project:
        cloud = project.dense_points()
        return {} if cloud is None else {project.scan_name: cloud}
