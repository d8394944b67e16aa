"""Write a project as a scan in Matterport's layout: connectivity, skyboxes with depth, views and floor plans, which
Matterport3DSimulator and agents load unchanged. Run the same command again to continue an interrupted export.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nvsim.cli.arguments import Inline, ProjectArguments
from nvsim.cli.console import listening
from nvsim.cli.terminal import say
from nvsim.cluster.choice import opened
from nvsim.cluster.config import ClusterConfig
from nvsim.project.project import Project

if TYPE_CHECKING:
    from nvsim.r2r.observations.export import Prepared
    from nvsim.r2r.observations.layout import ScanSettings


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    out: Path = Path("scans")
    """The output folder: a new one, or one with scans, which are not changed."""
    scan: str | None = None
    """The scan id. Default: the project's name in letters and digits."""
    size: int = 512
    """Pixels per side of a skybox face, a multiple of 16."""
    quality: int = 95
    """Quality of JPEG files."""
    faces: bool = False
    """Also write the six faces as separate files, which version 0.1 of the simulator reads."""
    views: bool = False
    """Also write the 36 discretized views of every viewpoint, 640x480."""
    plans: bool = True
    """Draw the floor plan of every storey."""
    stub: bool = True
    """Write a stub of the scan ZMojNkEp431, which VLN-DUET and Recurrent-VLN-BERT open by name."""
    max_viewpoints: int | None = None
    """Split a larger graph at narrow places into scans NAME-a, NAME-b and so on, with at most so many viewpoints."""
    force: bool = False
    """Also write graphs that R2R agents cannot handle."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """Renderer: gsplat if it is installed and there is a CUDA GPU, else the CPU kernels."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    dry_run: bool = False
    """Report the files to write, their size and the time, or the reason why it is not possible; write nothing."""


def run(arguments: Arguments) -> int:
    from nvsim.cli import show
    from nvsim.graph.connectivity import read_connectivity
    from nvsim.r2r.observations.export import Prepared, export_scan
    from nvsim.r2r.observations.layout import ScanSettings

    a = arguments
    settings = ScanSettings(a.size, a.quality, a.faces, a.views, a.plans)
    # The project is opened read-only, so it can be exported while a submap trains.
    with Project.open(a.project) as project, listening(a.json) as listen:
        if a.dry_run:
            _foretell(Prepared.of(project, a.out, a.scan, a.force, a.max_viewpoints), settings, a)
            return 0
        with opened(a.cluster) as executor:
            written = export_scan(
                project,
                a.out,
                a.scan,
                settings,
                a.stub,
                a.force,
                a.backend,
                a.max_viewpoints,
                listen,
                executor,
                a.cluster.storage,
            )
    if a.json:
        return 0
    if len(written) > 1:
        graphs = [read_connectivity(places.connectivity) for places in written]
        rows = [(g.scan, len(g.viewpoints), len(g.edges)) for g in graphs]
        show.table(("scan", "viewpoints", "edges"), rows, "parts")
    for places in written:
        say(places.folder)
    return 0


def _foretell(prepared: Prepared, settings: ScanSettings, a: Arguments) -> None:
    """Prints the estimate of the export. With --json: {"scans", "free", "shortage"} and all fields of the estimate."""
    from nvsim.cli import show
    from nvsim.r2r.observations.estimate import size_words

    found = prepared.estimate(settings, a.stub, a.backend)
    short = prepared.shortage(found)
    if a.json:
        scans = [places.scan for places in prepared.places]
        say(show.as_json({"scans": scans, "free": prepared.free, "shortage": short, **found.as_data()}))
        return
    rows = [(k.what, k.folder or ".", k.files, size_words(k.bytes)) for k in found.kinds]
    show.table(("files", f"in {prepared.root}", "number", "size"), rows)
    say(found.sentence)
    say(short or f"{size_words(prepared.free)} of disk space are free at {prepared.root}.")
