"""R2R connectivity files: `<scan>_connectivity.json` and the scans.txt in the same folder.

Format: an array with one object per viewpoint, in index order (Matterport3DSimulator, connectivity/README.md). Poses
are camera-to-world, row-major, OpenCV axes, z up. The agents' loader asserts that `unobstructed` is symmetric.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeGuard

from nvsim.capture.raw import FARTHEST
from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import is_number, read_json, read_text
from nvsim.graph.types import Edge, NavGraph, Viewpoint, edge

SUFFIX = "_connectivity.json"
STUB = "ZMojNkEp431"
"""The scan that an export adds for agents, see `nvsim.r2r.observations.stub`."""
LARGEST_LIST = 1 << 24
"""Maximum size of a scans.txt in bytes."""
LONGEST_ID = 1000


def write_connectivity(
    graph: NavGraph, folder: Path, visible: Callable[[Viewpoint, Viewpoint], bool] | None = None
) -> Path:
    """Write the connectivity file of `graph` into `folder` and add its scan to scans.txt there. Returns the path of the
    connectivity file. Every viewpoint faces +y, level. `visible` tests whether one viewpoint sees another; without it,
    joined viewpoints see each other.

    Raises InputError if agents cannot read the scan id or a viewpoint id, if a position is not finite, or if writing
    fails.
    """
    check_scan_id(graph.scan)
    ids = list(graph.viewpoints)
    for id in ids:
        if not id or "/" in id or id != id.strip():
            raise InputError(f"The viewpoint id {id!r} cannot name a file; rename it without slashes and outer spaces.")
    index = {id: i for i, id in enumerate(ids)}
    joined = [[False] * len(ids) for _ in ids]
    for a, b in graph.edges:
        joined[index[a]][index[b]] = joined[index[b]][index[a]] = True
    entries = []
    for i, v in enumerate(graph.viewpoints.values()):
        x, y, z = (float(value) for value in v.position)
        if not all(math.isfinite(value) for value in (x, y, z, v.height)):
            raise InputError(f"Viewpoint {v.id} has no finite position; move or remove it before the export.")
        seen = joined[i]
        if visible is not None:
            seen = [j != i and bool(visible(v, other)) for j, other in enumerate(graph.viewpoints.values())]
        entries.append(
            {
                "image_id": v.id,
                "pose": [1, 0, 0, x, 0, 0, 1, y, 0, -1, 0, z, 0, 0, 0, 1],
                "included": bool(v.included),
                "visible": seen,
                "unobstructed": joined[i],
                "height": float(v.height),
            }
        )
    path = folder / f"{graph.scan}{SUFFIX}"
    # Write this file first: the simulator aborts if scans.txt lists a scan without a file.
    atomic.write_text(path, json.dumps(entries, separators=(",", ":")))
    list_scan(folder / "scans.txt", graph.scan)
    return path


def read_connectivity(path: Path) -> NavGraph:
    """Read a connectivity file. Unknown keys are ignored, 0 and 1 are accepted as booleans, and `height` and `visible`
    are optional.

    Raises InputError with the entry number if the file cannot be read, an edge goes one way only, or a pose is not
    rigid.
    """
    path = Path(path)
    entries = read_json(path, "a connectivity file", "give an R2R connectivity file")
    if not isinstance(entries, list):
        raise InputError(f"{path} does not hold a list of viewpoints; give an R2R connectivity file.")
    viewpoints: dict[str, Viewpoint] = {}
    rows: list[list[bool]] = []
    for i, entry in enumerate(entries):
        where = f"{path}, entry {i}"
        if not isinstance(entry, dict):
            raise InputError(f"{where} is not an object; every viewpoint needs image_id, pose and unobstructed.")
        id = entry.get("image_id")
        if not is_name(id) or "/" in id:
            raise InputError(f"{where}: image_id is {value_text(id)}; it must be a name without slashes.")
        if id in viewpoints:
            raise InputError(f"{where}: image_id {id} is used twice; give every viewpoint its own id.")
        height = json_number(entry.get("height", 1.5), f"{where}: height")
        included = _flags([entry.get("included", True)], 1, f"{where}: included")[0]
        viewpoints[id] = Viewpoint(id, position_in(entry.get("pose"), where), height, -1, included, "file")
        rows.append(_flags(entry.get("unobstructed"), len(entries), f"{where}: unobstructed"))
    return NavGraph(scan_of(path), viewpoints, _edges(list(viewpoints), rows, path))


def check_scan_id(scan: str) -> None:
    """Check that R2R agents can use `scan` as an id: they split keys at "_" and scans.txt at white space. Raises
    InputError if they cannot."""
    if (
        not scan
        or not scan.isascii()
        or not scan.isprintable()
        or any(c in scan for c in '_/\\:*?"<>| ')
        or scan[0] in ".-"
    ):
        raise InputError(
            f"The scan id {value_text(scan)!r} cannot be used by R2R agents; choose letters and digits, without "
            "underscore, space or slash."
        )


def list_scan(path: Path, scan: str) -> None:
    """Add a scan to scans.txt and repair a truncated last line. Raises InputError if the file cannot be read or
    written."""
    listed = read_scans(path) if os.path.lexists(path) else []
    cut = truncated_last_name(path) if listed else None
    whole = [name for name in listed if name != cut]
    if cut is not None:
        names = {scan_of(file) for file in path.parent.glob(f"*{SUFFIX}")} | {scan}
        meant = [name for name in names if name.startswith(cut) and name not in whole]
        whole += meant if len(meant) == 1 else []
    if scan not in whole or whole != listed:
        atomic.write_text(path, "".join(f"{name}\n" for name in dict.fromkeys([*whole, scan])))


def read_scans(path: Path) -> list[str]:
    """Return the scans that a scans.txt lists, without duplicates. Raises InputError if it cannot be read."""
    return list(dict.fromkeys(_list_in(path).split()))


def truncated_last_name(path: Path) -> str | None:
    """Return the last name in a scans.txt if it is truncated, otherwise None. A truncated name has no line end and no
    connectivity file. Raises InputError if the list cannot be read."""
    text = _list_in(path)
    last = "" if text[-1:].isspace() else "".join(text.split()[-1:])
    return last if last and not (path.parent / f"{last}{SUFFIX}").exists() else None


def _list_in(path: Path) -> str:
    return read_text(
        path, "a list of scans", "it lists the scans in this folder: repair it or move it away", LARGEST_LIST
    )


def scan_files(root: Path, names: Sequence[str] = ()) -> dict[str, Path]:
    """Return scan id -> connectivity file for the scans `names` of an export in `root`. Without `names`, return all
    scans that its scans.txt lists. `root` may also be the folder of the connectivity files.

    Raises InputError if scans.txt cannot be read, lists no scan, or does not list a requested scan.
    """
    folder = root / "connectivity" if (root / "connectivity").is_dir() else root
    listed = read_scans(folder / "scans.txt")
    missing, choices = [name for name in names if name not in listed], scan_choices(listed)
    if missing and choices:
        raise InputError(
            f"The scan {value_text(missing[0])} is not listed in {folder / 'scans.txt'}; choose one of {choices}."
        )
    if missing or not listed:
        raise InputError(f"{folder / 'scans.txt'} lists no scan; export one into the folder.")
    found = {}
    for name in names or listed:
        check_scan_id(name)
        found[name] = folder / f"{name}{SUFFIX}"
    return found


def scan_choices(listed: Iterable[str]) -> str:
    """Return the first five scans for a message, without the stub; "" if there are none."""
    scans = [value_text(name) for name in listed if name != STUB]
    return f"{', '.join(scans[:5])}{' ...' if len(scans) > 5 else ''}"


def scan_of(path: Path) -> str:
    """Return the scan id from the name of a connectivity file."""
    return path.name.removesuffix(SUFFIX) if path.name.endswith(SUFFIX) else path.stem


def _edges(ids: list[str], rows: list[list[bool]], path: Path) -> dict[tuple[str, str], Edge]:
    edges = {}
    for i, row in enumerate(rows):
        for j, free in enumerate(row):
            # Ignore an edge from a viewpoint to itself, as the simulator does.
            if not free or i == j:
                continue
            if not rows[j][i]:
                raise InputError(
                    f"{path}: the edge from {ids[i]} to {ids[j]} goes one way only; make `unobstructed` symmetric."
                )
            if i < j:
                found = edge(ids[i], ids[j], "file")
                edges[found.key] = found
    return edges


def position_in(pose: Any, where: str) -> tuple[float, float, float]:
    """Return the position (x, y, z), meters, of a camera-to-world pose of 16 numbers in row-major order. Raises
    InputError if the pose is not rigid."""
    if not isinstance(pose, list) or len(pose) != 16:
        raise InputError(f"{where}: pose must be a list of 16 numbers, row by row.")
    m = [json_number(value, f"{where}: pose[{k}]") for k, value in enumerate(pose)]
    axes = [(m[k], m[4 + k], m[8 + k]) for k in range(3)]
    for p in range(3):
        for q in range(3):
            product = sum(u * v for u, v in zip(axes[p], axes[q], strict=True))
            if not abs(product - (p == q)) <= 1e-2:  # also refuses an overflow
                raise InputError(f"{where}: the first three columns of pose are not a rotation; export it again.")
    if m[12:] != [0, 0, 0, 1]:
        raise InputError(f"{where}: the last row of pose is {m[12:]}, not 0 0 0 1; write the matrix row by row.")
    if max(map(abs, (m[3], m[7], m[11]))) > FARTHEST:
        raise InputError(f"{where}: the position is farther than {FARTHEST:.0e} m from the origin; use meters.")
    return m[3], m[7], m[11]


def is_name(value: Any) -> TypeGuard[str]:
    """Whether a JSON value can be a viewpoint id: a non-empty string in valid Unicode with at most LONGEST_ID
    characters."""
    return isinstance(value, str) and 0 < len(value) <= LONGEST_ID and not any("\ud800" <= c <= "\udfff" for c in value)


def _flags(values: Any, count: int, where: str) -> list[bool]:
    if not isinstance(values, list) or len(values) != count:
        raise InputError(f"{where} must be a list of {count} booleans, one for every entry of the file.")
    for value in values:
        if not isinstance(value, bool | int) or value not in (0, 1):
            raise InputError(f"{where} holds {value_text(value)}; only true, false, 0 and 1 are allowed.")
    return [bool(value) for value in values]


def json_number(value: Any, where: str) -> float:
    """Return a JSON value as a float. Raises InputError if it is not a finite number."""
    if not is_number(value):
        raise InputError(f"{where} is {value_text(value)}; it must be a finite number.")
    return float(value)
