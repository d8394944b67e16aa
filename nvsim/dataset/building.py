"""Buildings to a benchmark in one folder: scans, features, tasks, the baselines' trajectories and table, and a card."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim import __version__
from nvsim.dataset.clouds import cloud_of
from nvsim.dataset.tasks import MadeTasks, TaskOptions, make_tasks
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Warning
from nvsim.files import atomic
from nvsim.files.locking import WriterLock
from nvsim.files.regular import read_bytes, read_json
from nvsim.graph.connectivity import read_connectivity
from nvsim.project.project import Project
from nvsim.r2r.agents.table import Name as AgentName
from nvsim.r2r.features.layouts import LAYOUTS
from nvsim.r2r.features.layouts import Name as LayoutName
from nvsim.r2r.observations.places import ScanPlaces
from nvsim.r2r.observations.prepared import Prepared
from nvsim.r2r.observations.record import key_of
from nvsim.r2r.observations.settings import ScanSettings
from nvsim.r2r.tasks.splitting import SPLITS
from nvsim.render.backends import Backend

if TYPE_CHECKING:
    from nvsim.graph.types import NavGraph

STAGE = "dataset"
RECORD, CARD, SCANS, FEATURES, TASKS, RESULTS = "dataset.json", "README.md", "scans", "features", "tasks", "results"
FORMAT = 1
BASELINES: tuple[AgentName, ...] = ("shortest", "random", "random-paper")


@dataclass(frozen=True)
class DatasetOptions:
    """scan       of its images
    stub       whether the stub of ZMojNkEp431 is written
    layouts    of features, () for none
    projection whether they are the fixed projection of colours and edges even where there is a network
    """

    scan: ScanSettings = field(default_factory=ScanSettings)
    stub: bool = True
    layouts: tuple[LayoutName, ...] = ("vit-b16",)
    projection: bool = False
    tasks: TaskOptions = field(default_factory=TaskOptions)
    force: bool = False
    backend: Backend = "auto"


@contextmanager
def prepared(projects: Sequence[Path], out: Path, options: DatasetOptions) -> Iterator[list[tuple[Project, Prepared]]]:
    """The projects, open to be read, and the exports of their scans, that may begin.

    Raises InputError where one may not, two would have the same scan id, or `out` holds something else.
    """
    _refuse_foreign(out)
    with ExitStack() as stack:
        found: list[tuple[Project, Prepared]] = []
        for path in projects:
            project = stack.enter_context(Project.open(path))
            found.append((project, Prepared.of(project, out / SCANS, None, options.force)))
        names = [one.graph.scan for _, one in found]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"Two projects would be the scan {name}; rename the folder of one.")
        yield found


def export_dataset(projects: Sequence[Path], out: Path, options: DatasetOptions, listen: Listener) -> dict[str, Any]:
    """Writes the dataset of `projects` into the folder `out`; returns what dataset.json says. What is finished from
    before, made from the same, is not done again.

    Raises InputError as `prepared`, where no path fits into a split, or the disk refuses.
    """
    with prepared(projects, out, options) as sources:
        atomic.make_folder(out)
        lock = WriterLock(out / ".writer")
        try:
            return _export(sources, out, options, listen)
        finally:
            (out / ".writer").unlink(missing_ok=True)
            lock.release()


def _export(
    sources: Sequence[tuple[Project, Prepared]], out: Path, options: DatasetOptions, listen: Listener
) -> dict[str, Any]:
    from nvsim.r2r.observations.export import export_scan

    # A record that is not finished says whose folder it is, should this be cut off.
    about: dict[str, Any] = {"format": FORMAT, "made_by": f"nvsim {__version__}", "finished": False}
    about["features"] = _record(out).get("features", [])
    atomic.write_text(out / RECORD, json.dumps(about, indent=1) + "\n")
    o, places, clouds = options, [], {}
    for project, source in sources:
        places += export_scan(project, out / SCANS, None, o.scan, o.stub, o.force, o.backend, None, listen)
        cloud = cloud_of(project) if o.tasks.vlnce or o.tasks.streamvln else None
        if cloud is not None:
            clouds[source.graph.scan] = cloud
    graphs = [read_connectivity(place.connectivity) for place in places]
    features = _features(out, [graph.scan for graph in graphs], o, listen)
    made = make_tasks(graphs, out / SCANS, out / TASKS, o.tasks, listen, clouds)
    for split, fewer in made.told.dataset.lacking.items():
        listen(Warning(f"{split} has {fewer} paths fewer than asked for: no more fit", STAGE))
    figures = _baselines(out, made, o.tasks.amounts.seed, listen)
    about |= {"finished": True, "scans": _scans(graphs, places), "features": features, "tasks": _tasks(made)}
    about |= {"baselines": figures, "options": json.loads(json.dumps(asdict(o), default=str))}
    from nvsim.dataset.card import card_of

    atomic.write_text(out / CARD, card_of(about))
    atomic.write_text(out / RECORD, json.dumps(_finite(about), indent=1) + "\n")
    listen(Done(STAGE, f"{len(graphs)} scans, {made.told.paths} paths in {out}", {"baselines": _finite(figures)}))
    return about


def _features(out: Path, scans: Sequence[str], options: DatasetOptions, listen: Listener) -> list[dict[str, str]]:
    """What there is of features: file, backbone, readers, and keys of what they were made from and of the file itself,
    by which the next run knows them."""
    if not options.layouts:
        return []
    from nvsim.r2r.features.choosing import choose_backbone
    from nvsim.r2r.features.exported_scan import read_exported_scans
    from nvsim.r2r.features.extraction import extract

    before = {one["layout"]: one for one in _record(out).get("features", [])}
    exported, found = read_exported_scans(out / SCANS, scans), []
    images = {scan: _digest(ScanPlaces(out / SCANS, scan).manifest) for scan in scans}
    for name in dict.fromkeys(options.layouts):
        layout, file = LAYOUTS[name], out / FEATURES / LAYOUTS[name].file
        backbone, warning = choose_backbone(layout, None, 12, "auto", options.projection)
        if warning:
            listen(Warning(warning, FEATURES))
        one = {"layout": str(name), "file": layout.file, "backbone": backbone.name, "read_by": layout.readers}
        one["made_from"] = key_of(name, str(backbone.digest), images, __version__)
        old = before.get(name, {})
        if old.get("made_from") != one["made_from"] or not file.is_file() or _digest(file) != old.get("sha256"):
            extract(exported, layout, backbone, out / FEATURES, listen)
        found.append({**one, "sha256": _digest(file)})
        about = {**_record(out), "features": [*(o for o in before.values() if o["layout"] != name), *found]}
        atomic.write_text(out / RECORD, json.dumps(about, indent=1) + "\n")
    return found


def _digest(path: Path) -> str:
    return hashlib.sha256(read_bytes(path)).hexdigest()


def _record(out: Path) -> dict[str, Any]:
    """dataset.json as it is, {} where there is none. Raises InputError where it is damaged."""
    if not os.path.lexists(out / RECORD):
        return {}
    data = read_json(out / RECORD, "the record of a dataset", "remove it, or choose another --out")
    features = data.get("features", []) if isinstance(data, dict) else None
    if not isinstance(features, list) or not all(isinstance(f, dict) and "layout" in f for f in features):
        raise InputError(f"{out / RECORD} is damaged; remove it, or choose another --out.")
    return dict(data)


def _baselines(out: Path, made: MadeTasks, seed: int, listen: Listener) -> dict[str, dict[str, Any]]:
    """Split -> agent -> figures, of splits with paths; their trajectories go to files as for the leaderboard."""
    from nvsim.evaluation.navigation import figures_of
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.agents.running import run_agent
    from nvsim.r2r.agents.table import agent_of
    from nvsim.r2r.metrics.scores import score
    from nvsim.r2r.metrics.submission import write_submission

    found: dict[str, dict[str, Any]] = {}
    for split in SPLITS:
        if not made.told.dataset.splits[split]:
            continue
        benchmark = Benchmark.read(out / SCANS, out / TASKS / f"R2R_{split}.json")
        found[split] = {}
        for name in BASELINES:
            walked = run_agent(agent_of(name, benchmark.graphs, seed), benchmark.tasks, benchmark.folder)
            write_submission(out / RESULTS / f"{name}_{split}.json", walked)
            found[split][name.upper()] = figures_of(score(benchmark.tasks, walked, benchmark.distances))
        listen(Log(f"{split}: {len(benchmark.tasks)} paths walked by {', '.join(BASELINES)}", STAGE))
    return found


def _scans(graphs: Sequence[NavGraph], places: Sequence[ScanPlaces]) -> dict[str, dict[str, int]]:
    return {
        place.scan: {
            "viewpoints": sum(v.included for v in graph.viewpoints.values()),
            "edges": len(graph.edges),
        }
        for graph, place in zip(graphs, places, strict=True)
    }


def _tasks(made: MadeTasks) -> dict[str, Any]:
    splits = {name: len(tasks) for name, tasks in made.told.dataset.splits.items()}
    return {"paths": splits, "instructions": made.about, "episodes": made.episodes}


def _refuse_foreign(out: Path) -> None:
    """Raises InputError where `out` holds what is not of a dataset of ours."""
    if not os.path.lexists(out):
        return
    if not out.is_dir():
        raise InputError(f"{out} is no folder; choose another --out.")
    if os.path.lexists(out / RECORD):
        data = _record(out)
        if data.get("format") == FORMAT and "made_by" in data:
            return
    elif not any(out.iterdir()):
        return
    raise InputError(f"{out} holds something else than a dataset of NVSim; choose another --out, or an empty folder.")


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    """The same with None for what is not a finite number, as JSON knows none."""
    import math

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [plain(inner) for inner in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {key: plain(value) for key, value in values.items()}
