"""Commands that write the results of a project: connectivity, scans, graphs, splats."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nvsim.cli import terminal
from nvsim.cli.arguments import Inline, Positional, ProjectArguments
from nvsim.cli.console import event_listener
from nvsim.cli.terminal import as_json, print_lines
from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.errors import InputError
from nvsim.occupancy.types import Heights

if TYPE_CHECKING:
    from nvsim.cli.graph_target import GraphWithContext
    from nvsim.graph.exports import GeoAnchor
    from nvsim.r2r.observations.export import PreparedExport
    from nvsim.r2r.observations.layout import ScanSettings


@dataclass(frozen=True)
class ExportR2R(ProjectArguments):
    """Write the navigation graph as R2R connectivity and scans.txt, which existing agents load unchanged."""

    out: Path = Path("connectivity")
    """The output folder. Scans of other projects in its scans.txt are kept."""
    scan: str | None = None
    """The scan id. Default: the project's name in letters and digits."""
    frame: Literal["aligned", "capture"] = "aligned"
    """The frame of the poses: the project's aligned frame, or the capture's own (only if that is upright too)."""
    stub: bool = True
    """Write a stub of the scan ZMojNkEp431, which VLN-DUET and Recurrent-VLN-BERT open by name."""
    force: bool = False
    """Also write graphs that R2R agents cannot handle."""

    def run(self) -> int:
        from nvsim.project.project import Project
        from nvsim.project.stages.exported import export_r2r
        from nvsim.r2r.observations.stub import write_stub_graph

        with Project.open(self.project) as project:
            written = export_r2r(project, self.out, self.scan, self.frame, self.force)
        if self.stub:
            write_stub_graph(self.out)
        print_lines(as_json({"written": str(written)}) if self.json else f"Wrote {written}")
        return 0


@dataclass(frozen=True)
class ExportScan(ProjectArguments):
    """Write a project as a scan in Matterport's layout: connectivity, skyboxes with depth, views and floor plans, which
    Matterport3DSimulator and agents load unchanged. Run the same command again to continue an interrupted export."""

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

    def run(self) -> int:
        from nvsim.graph.connectivity import read_connectivity
        from nvsim.project.project import Project
        from nvsim.r2r.observations.export import PreparedExport, export_scan
        from nvsim.r2r.observations.layout import ScanSettings

        settings = ScanSettings(self.size, self.quality, self.faces, self.views, self.plans)
        # The project is opened read-only, so it can be exported while a submap trains.
        with Project.open(self.project) as project, event_listener(self.json) as listen:
            if self.dry_run:
                _print_estimate(
                    PreparedExport.of(project, self.out, self.scan, self.force, self.max_viewpoints), settings, self
                )
                return 0
            with open_executor(self.cluster) as executor:
                written = export_scan(
                    project,
                    self.out,
                    self.scan,
                    settings,
                    self.stub,
                    self.force,
                    self.backend,
                    self.max_viewpoints,
                    listen,
                    executor,
                )
        if self.json:
            return 0
        if len(written) > 1:
            graphs = [read_connectivity(places.connectivity) for places in written]
            rows = [(g.scan, len(g.viewpoints), len(g.edges)) for g in graphs]
            terminal.table(("scan", "viewpoints", "edges"), rows, "parts")
        for places in written:
            print_lines(places.folder)
        return 0


def _print_estimate(prepared: PreparedExport, settings: ScanSettings, a: ExportScan) -> None:
    """Prints the estimate of the export. With --json: {"scans", "free", "shortage"} and all fields of the estimate."""
    from nvsim.r2r.observations.estimate import size_words

    found = prepared.estimate(settings, a.stub, a.backend)
    short = prepared.shortage(found)
    if a.json:
        scans = [places.scan for places in prepared.places]
        print_lines(terminal.as_json({"scans": scans, "free": prepared.free, "shortage": short, **found.as_data()}))
        return
    rows = [(k.what, k.folder or ".", k.files, size_words(k.bytes)) for k in found.kinds]
    terminal.table(("files", f"in {prepared.root}", "number", "size"), rows)
    print_lines(found.sentence)
    print_lines(short or f"{size_words(prepared.free)} of disk space are free at {prepared.root}.")


Format = Literal["graphml", "geojson", "svg", "png", "r2r"]
_FILES: dict[str, Format] = {".graphml": "graphml", ".geojson": "geojson", ".svg": "svg", ".png": "png"}
_OTHER_FILES = frozenset({".gexf", ".gml", ".jpeg", ".jpg", ".json", ".pdf", ".webp"})
"""Endings of files that users may expect; a folder with such a name would be a mistake."""


@dataclass(frozen=True)
class ExportGraph:
    """Write a navigation graph for other programs: GraphML, GeoJSON, an image of it on its map (SVG, PNG), or R2R
    connectivity. R2R graphs that agents cannot handle are refused without --force. Other scans of a folder are
    written."""

    graph: Positional[Path]
    """A project, NAME.nvsim, an R2R connectivity file, or a folder of them with scans.txt."""
    format: Format = "graphml"
    """The format to write."""
    out: Path = Path("graphs")
    """The output folder, with one file per scan, named after it. For a single scan, also a file whose suffix gives the
    format: .graphml, .geojson, .svg or .png."""
    occupancy: Path | None = None
    """Map to draw below the graph in images: a ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to
    the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    longest_side: int = 1600
    """Longer side of an image in pixels."""
    latitude: float | None = None
    """GeoJSON: latitude of the origin in degrees, WGS 84. Without it, coordinates are in local meters."""
    longitude: float | None = None
    """GeoJSON: longitude of the origin in degrees."""
    bearing: float = 0.0
    """GeoJSON: direction of the frame's y axis, in degrees clockwise from north."""
    force: bool = False
    """R2R: also write graphs that agents cannot handle."""
    json: bool = False
    """Print the written files as JSON."""

    def run(self) -> int:
        """Writes one file, or a folder of files. Raises InputError if one of them cannot be written."""
        from nvsim.cli.graph_target import is_project, read_one_graph
        from nvsim.graph.connectivity import scan_of
        from nvsim.graph.exports import incomplete_export
        from nvsim.graph.foreign import connectivity_files

        named = _FILES.get(self.out.suffix.lower())
        if named is not None:
            source = read_one_graph(self.graph, self.occupancy, self.heights)
            _print_written(_write(source, replace(self, format=named), self.out), self)
            return 0
        _check_folder(self.out)
        files = [self.graph] if is_project(self.graph) else connectivity_files(self.graph)
        failures: dict[str, InputError] = {}
        for file in files:
            try:
                _print_written(_write(read_one_graph(file, self.occupancy, self.heights), self), self)
            except InputError as error:
                if len(files) == 1:
                    raise
                failures[scan_of(file)] = error
        if failures:
            raise incomplete_export(failures, len(files))
        return 0


def _check_folder(out: Path) -> None:
    """Raises InputError if the output folder seems to be a file in a format that is not written."""
    if out.suffix.lower() in _OTHER_FILES and not out.is_dir():
        raise InputError(f"{out} is no folder and ends in none of {', '.join(_FILES)}; give one of these.")


def _print_written(path: Path, arguments: ExportGraph) -> None:
    print_lines(as_json({"written": str(path)}) if arguments.json else f"Wrote {path}")


def _write(source: GraphWithContext, arguments: ExportGraph, path: Path | None = None) -> Path:
    """Writes to `path`, or to the output folder; returns the path."""
    from nvsim.figures import save_figure
    from nvsim.graph import exports

    path = path or arguments.out / f"{source.name}.{arguments.format}"
    if arguments.format == "r2r":
        return _write_r2r(source, arguments)
    if arguments.format == "graphml":
        return exports.write_graphml(source.graph, path)
    if arguments.format == "geojson":
        return exports.write_geojson(source.graph, path, _anchor(arguments))
    return save_figure(exports.draw(source.graph, source.occupancy, arguments.longest_side), path)


def _write_r2r(source: GraphWithContext, arguments: ExportGraph) -> Path:
    from nvsim.cli.graph_target import is_project
    from nvsim.graph.connectivity import SUFFIX, write_connectivity
    from nvsim.graph.exports import check_exportable
    from nvsim.graph.foreign import ForeignFile
    from nvsim.graph.sight import lines_of_sight

    graph = replace(source.graph, scan=source.name)
    if not arguments.force:
        check_exportable(graph, source.context)
    if is_project(arguments.graph):
        return write_connectivity(graph, arguments.out, lines_of_sight(graph, source.occupancy))
    return ForeignFile.open(source.path).save(graph, arguments.out / f"{source.name}{SUFFIX}")


def _anchor(arguments: ExportGraph) -> GeoAnchor | None:
    from nvsim.graph.exports import GeoAnchor

    if (arguments.latitude is None) != (arguments.longitude is None):
        raise InputError("A geographic position needs both --latitude and --longitude.")
    if arguments.latitude is None or arguments.longitude is None:
        return None
    return GeoAnchor(arguments.latitude, arguments.longitude, bearing=arguments.bearing)


@dataclass(frozen=True)
class ExportSplats(ProjectArguments):
    """Write trained submaps as splat files for other programs, each with its floor as a textured surface (glTF)."""

    out: Path = Path("splats")
    """The output folder."""
    submaps: tuple[int, ...] = ()
    """Submaps to write. Default: all that are trained."""
    format: Literal["ply", "compressed-ply", "spz"] = "ply"
    """ply: exact, for every viewer. compressed-ply: SuperSplat's, at most a quarter of the size. spz: a tenth."""
    frame: Literal["aligned", "capture"] = "aligned"
    """The frame of the coordinates: the aligned frame (upright and metric), or the capture's own."""
    floor: Literal["mesh", "gaussians"] = "mesh"
    """mesh: the floor as a glTF file beside the splats. gaussians: the floor as flat Gaussians in the splat file, for
    viewers without meshes."""

    def run(self) -> int:

        from nvsim.project.project import Project
        from nvsim.project.stages.exported import export_splats

        with Project.open(self.project) as project, event_listener(False) as listen:
            written = export_splats(project, self.out, self.format, self.submaps, self.frame, listen, self.floor)
        if self.json:
            print_lines(as_json({"written": [str(p) for p in written]}))
        else:
            print_lines(*(f"Wrote {p}" for p in written))
        return 0
