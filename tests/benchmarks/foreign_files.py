"""Measure the seconds to open and save connectivity files: `python tests/benchmarks/foreign_files.py [VIEWPOINTS ...]`.

Every viewpoint of the made scan has eight neighbors. Three versions are saved: without edits, with a moved viewpoint
and a removed edge, and with a removed viewpoint, which shortens every list of the file.
"""

from __future__ import annotations

import json
import multiprocessing
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import tyro
from harness import peak_gib, report, timed

from nvsim.graph import edits
from nvsim.graph.foreign import ForeignFile


@dataclass(frozen=True)
class Arguments:
    viewpoints: tyro.conf.Positional[tuple[int, ...]] = (1500, 5000)


def write(path: Path, count: int) -> None:
    rows = []
    for i in range(count):
        near = {(i + k) % count for k in (-4, -3, -2, -1, 1, 2, 3, 4)}
        free = ["true" if j in near else "false" for j in range(count)]
        seen = ["true" if abs(i - j) < 30 else "false" for j in range(count)]
        pose = [1, 0, 0, i % 70 * 2.5, 0, 0, 1, i // 70 * 2.5, 0, -1, 0, 1.5, 0, 0, 0, 1]
        rows.append(
            f'{{"image_id": "{i:032x}", "pose": {json.dumps(pose)}, "included": true, "visible": [{", ".join(seen)}], '
            f'"unobstructed": [{", ".join(free)}], "height": 1.5}}'
        )
    path.write_text("[" + ", ".join(rows) + "]")


def main() -> None:
    for count in tyro.cli(Arguments, description=__doc__).viewpoints:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "made1_connectivity.json"
            maker = multiprocessing.Process(target=write, args=(path, count))  # not counted in this process
            maker.start()
            maker.join()
            file, opened = timed(partial(ForeignFile.open, path))
            peak = round(1024 * peak_gib())
            ids = list(file.graph.viewpoints)
            edited = edits.move_viewpoint(file.graph, ids[7], (1.0, 2.0, 1.5))
            edited = edits.remove_edges(edited, [next(iter(edited.edges))])
            saved = {}
            for name, graph in (
                ("unedited", file.graph),
                ("moved", edited),
                ("removed", edits.remove_viewpoints(edited, [ids[3]])),
            ):
                out = path.with_name("out_connectivity.json")
                _, saved[name] = timed(partial(file.save, graph, out))
            figures = {
                "viewpoints": count,
                "megabytes": path.stat().st_size >> 20,
                "open_s": round(opened, 3),
                "open_peak_mib": peak,
                **{f"save_{name}_s": round(value, 3) for name, value in saved.items()},
            }
            report(figures, as_json=True)


if __name__ == "__main__":
    main()
