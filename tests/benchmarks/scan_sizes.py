"""Compare the file sizes of an exported scan with their estimate: `python tests/benchmarks/scan_sizes.py PROJECT`.

The constants of `nvsim.r2r.observations.estimate` come from this table. All files are written to a temporary folder and
removed.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import tyro
from harness import timed

from nvsim.project.project import Project
from nvsim.r2r.observations.export import PreparedExport, export_scan
from nvsim.r2r.observations.layout import ScanSettings

ALL = ScanSettings(faces=True, views=True)
TRIED = (
    ScanSettings(),
    ALL,
    *(replace(ALL, quality=q) for q in (50, 75, 90, 100)),
    *(replace(ALL, size=s) for s in (128, 256, 1024)),
)


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]


def measure(project: Project, settings: ScanSettings) -> None:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "scans"
        said = PreparedExport.of(project, root).estimate(settings, True, "auto")
        (places, *_), took = timed(partial(export_scan, project, root, settings=settings))
        patterns = {
            "strips of six faces": places.images.glob("*_skybox_small.jpg"),
            "depth strips": places.images.glob("*_skybox_depth_small.png"),
            "single faces": places.images.glob("*_sami.jpg"),
            "views": places.views.rglob("*.jpg"),
            "floor plans": places.plans.iterdir(),
            "connectivity and scans.txt": (places.connectivity, places.scans),
            "manifest": (places.manifest,),
            "stub for agents": (p for p in root.rglob("*") if "ZMojNkEp431" in str(p) and p.is_file()),
        }
        print(f"\nfaces of {settings.size}, quality {settings.quality}, {said.todo} viewpoints")
        for kind in said.kinds:
            sizes = [path.stat().st_size for path in patterns[kind.what]]
            print(f"{kind.what:28} {len(sizes):6} files {sum(sizes):11} bytes, estimated {kind.files:6} {kind.bytes:11}"
                  f"  {sum(sizes) / kind.bytes:.2f}")  # fmt: skip
        every = sum(p.stat().st_size for p in root.rglob("*") if p.is_file())
        print(f"{'all':41} {every:11} bytes, estimated {'':6} {said.bytes:11}  {every / said.bytes:.2f}")
        print(f"{took:.1f} s, estimated {said.seconds or 0:.1f} s")


if __name__ == "__main__":
    with Project.open(tyro.cli(Arguments, description=__doc__).project) as opened:
        for settings in TRIED:
            measure(opened, settings)
