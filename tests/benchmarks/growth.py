"""Measure the cost of every stage as the building grows.

python tests/benchmarks/growth.py FOLDER --areas 300 1000 6000

For each area, a building of halls is generated, and every stage runs as a separate command. The benchmark records
seconds, processor seconds, and the peak memory of its processes, and then scores the graph. FOLDER/AREA.json keeps the
figures of finished stages, which are not run again. At the end it prints one JSON line and, for each stage, the growth
of seconds and memory from the first to the last area. The growth is relative to that of the area (1.00 is linear).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import tyro
from harness import cost, evaluated, watched

from nvsim.files.atomic import write_text


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path]
    areas: tuple[int, ...] = (300, 1000)
    stages: tuple[str, ...] = ("submaps", "floors", "train", "map")
    """Stages after the import. With --alone, depth is added."""
    seed: int = 0
    alone: bool = False
    """Remove the LiDAR scan, so that depth is estimated from the images."""
    train: tuple[str, ...] = ()
    """Options of `nvsim train`, each as one word with its value: --train steps=500."""


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    rows = [measured(arguments, area) for area in arguments.areas]
    names = [name for name in rows[0] if isinstance(rows[0][name], dict) and name != "graph"]
    print(f"{'':10}" + "".join(f"{row['area']:>10} m2" + " " * 14 for row in rows))
    for name in names:
        cells = [f"{row[name]['seconds']:9.1f} s {row[name]['gib']:6.2f} GiB   " for row in rows]
        print(f"{name:10}" + "".join(cells) + grown(rows, name))
    for row in rows:
        print(row["area"], {key: value for key, value in row.items() if key not in names})
    print(json.dumps(rows))


def grown(rows: list[dict[str, Any]], name: str) -> str:
    first, last = rows[0], rows[-1]
    area = last["area"] / first["area"]
    if area <= 1:
        return ""
    seconds = last[name]["seconds"] / max(first[name]["seconds"], 0.1) / area
    memory = last[name]["gib"] / max(first[name]["gib"], 1e-3) / area
    return f"x {seconds:.2f} time, x {memory:.2f} memory"


def measured(arguments: Arguments, area: int) -> dict[str, Any]:
    """The cost of every stage, and the figures of the graph. FOLDER/AREA.json keeps them as they are measured."""
    made, project = arguments.folder / f"{area}.building", arguments.folder / f"{area}.nvsim"
    kept = arguments.folder / f"{area}.json"
    row: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {"area": area}

    def measure(name: str, work: Callable[[], object]) -> None:
        if name not in row:
            row[name] = work()
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_text(kept, json.dumps(row))

    build = f"from nvsim.building import BuildingConfig, generate; from pathlib import Path; import sys; generate(Path(\
sys.argv[1]), BuildingConfig(seed={arguments.seed}, size='halls', area={area}))"
    measure("building", lambda: watched([sys.executable, "-c", build, str(made)]))
    capture = made / "capture"
    stages = list(arguments.stages)
    if arguments.alone:
        from images_only import without_scan

        capture = arguments.folder / f"{area}.images"
        if not capture.exists():
            without_scan(made / "capture", capture)
        if "depth" not in stages:
            stages.insert(1, "depth")
    measure("import", lambda: cost("import", str(capture), "--project", str(project)))
    words = [word for option in arguments.train for word in f"--{option}".split("=")]
    for stage in stages:
        options = words if stage == "train" else []
        measure(stage, partial(cost, stage, "--project", str(project), *options))
    if "map" in stages:
        measure("graph", lambda: graph(project, made / "ground_truth" / "map.yaml"))
    frames = json.loads((made / "capture" / "transforms.json").read_text())["frames"]
    row |= {"frames": len(frames), "bytes": sum(p.stat().st_size for p in project.rglob("*") if p.is_file())}
    return row


def graph(project: Path, truth: Path) -> dict[str, Any]:
    found = evaluated("graph", "--project", str(project), "--occupancy", str(truth))
    kept = ("nodes", "edges", "node_validity", "edge_validity", "node_validity_robot", "edge_validity_robot")
    return {key: found[key] for key in (*kept, "coverage", "components")}


if __name__ == "__main__":
    main()
