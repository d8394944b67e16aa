"""Write a navigation graph for other programs: GraphML, GeoJSON, an image of it on its map (SVG, PNG), or R2R
connectivity. R2R graphs that agents cannot handle are refused without --force. Other scans of a folder are written."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.occupancy.heights import Heights

if TYPE_CHECKING:
    from nvsim.cli.graph_source import Source
    from nvsim.graph.exports import Anchor

Format = Literal["graphml", "geojson", "svg", "png", "r2r"]
_FILES: dict[str, Format] = {".graphml": "graphml", ".geojson": "geojson", ".svg": "svg", ".png": "png"}


@dataclass(frozen=True)
class Arguments:
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


def run(arguments: Arguments) -> int:
    from nvsim.cli.graph_source import is_project, one_source
    from nvsim.graph.connectivity import scan_of
    from nvsim.graph.exports import left_out
    from nvsim.graph.foreign import connectivity_files

    named = _FILES.get(arguments.out.suffix.lower())
    if named is not None:
        source = one_source(arguments.graph, arguments.occupancy, arguments.heights)
        _say(_write(source, replace(arguments, format=named), arguments.out), arguments)
        return 0
    files = [arguments.graph] if is_project(arguments.graph) else connectivity_files(arguments.graph)
    failures: dict[str, InputError] = {}
    for file in files:
        try:
            _say(_write(one_source(file, arguments.occupancy, arguments.heights), arguments), arguments)
        except InputError as error:
            if len(files) == 1:
                raise
            failures[scan_of(file)] = error
    if failures:
        raise left_out(failures, len(files))
    return 0


def _say(path: Path, arguments: Arguments) -> None:
    say(as_json({"written": str(path)}) if arguments.json else f"Wrote {path}")


def _write(source: Source, arguments: Arguments, path: Path | None = None) -> Path:
    """Writes to `path`, or to the output folder; returns the path."""
    from nvsim.graph import exports

    path = path or arguments.out / f"{source.name}.{arguments.format}"
    if arguments.format == "r2r":
        return _write_r2r(source, arguments)
    if arguments.format == "graphml":
        return exports.write_graphml(source.graph, path)
    if arguments.format == "geojson":
        return exports.write_geojson(source.graph, path, _anchor(arguments))
    picture = exports.draw(source.graph, source.occupancy, arguments.longest_side)
    return exports.write_svg(picture, path) if arguments.format == "svg" else exports.write_png(picture, path)


def _write_r2r(source: Source, arguments: Arguments) -> Path:
    from nvsim.cli.graph_source import is_project
    from nvsim.graph.connectivity import SUFFIX, write_connectivity
    from nvsim.graph.exports import refuse
    from nvsim.graph.foreign import ForeignFile
    from nvsim.graph.sight import lines_of_sight

    graph = replace(source.graph, scan=source.name)
    if not arguments.force:
        refuse(graph, source.context)
    if is_project(arguments.graph):
        return write_connectivity(graph, arguments.out, lines_of_sight(graph, source.occupancy))
    return ForeignFile.open(source.path).save(graph, arguments.out / f"{source.name}{SUFFIX}")


def _anchor(arguments: Arguments) -> Anchor | None:
    from nvsim.graph.exports import Anchor

    if (arguments.latitude is None) != (arguments.longitude is None):
        raise InputError("A geographic position needs both --latitude and --longitude.")
    if arguments.latitude is None or arguments.longitude is None:
        return None
    return Anchor(arguments.latitude, arguments.longitude, bearing=arguments.bearing)
