"""Export projects as one dataset folder: scans, features, tasks, results of the baselines, folders for agents, and a
README."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim import __version__
from nvsim.cluster.piece import Executor
from nvsim.dataset.agent_files import (
    AGENTS,
    FEATURES,
    FRAMES,
    SCANS,
    SCENES,
    TASKS,
    AgentName,
    DatasetParts,
    check_agents,
    write_agent,
)
from nvsim.dataset.tables import card_of, write_tables
from nvsim.dataset.task_options import TaskOptions
from nvsim.dataset.tasks import WrittenTasks, check_options, make_tasks
from nvsim.errors import InputError
from nvsim.evaluation.navigation import figures_of
from nvsim.events import Done, Listener, Log, Warning
from nvsim.files import atomic
from nvsim.files.locking import WriterLock
from nvsim.files.opening import opened, read_json
from nvsim.files.reading import reading
from nvsim.graph.connectivity import read_connectivity
from nvsim.project.project import Project
from nvsim.r2r.agents.baselines import Name as BaselineName
from nvsim.r2r.agents.baselines import agent_of
from nvsim.r2r.agents.benchmark import Benchmark, run_agent
from nvsim.r2r.episodes.episode import scene_id
from nvsim.r2r.features.layouts import LAYOUTS, Layout, missing_package_error
from nvsim.r2r.features.layouts import Name as LayoutName
from nvsim.r2r.metrics.scores import score
from nvsim.r2r.metrics.submission import write_submission
from nvsim.r2r.observations.export import PreparedExport, export_scan
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings
from nvsim.r2r.observations.record import key_of
from nvsim.r2r.tasks.exporting import BOXES, GOALS
from nvsim.r2r.tasks.splitting import SPLITS, sample_tasks
from nvsim.render.backends import Backend

if TYPE_CHECKING:
    from nvsim.graph.types import NavGraph

STAGE = "dataset"
RECORD, CARD, RESULTS, FOR_AGENTS = "dataset.json", "README.md", "results", "agents"
FORMAT = 1
BASELINES: tuple[BaselineName, ...] = ("shortest", "random", "random-paper")


@dataclass(frozen=True)
class DatasetOptions:
    """Options of a dataset export.

    scan       settings of the exported images
    stub       whether to write the stub of the scan ZMojNkEp431
    layouts    feature layouts, () for none
    projection whether features are the fixed projection of colors and edges even if a network is available
    tasks      options of the tasks
    force      whether to export a scan although its graph has findings that agents cannot handle
    backend    renderer of the images
    agents     agents that get a folder in agents/; their features and views are exported too
    vocabulary file with the word pieces of the agents' BERT, None if no agent needs it
    """

    scan: ScanSettings = field(default_factory=ScanSettings)
    stub: bool = True
    layouts: tuple[LayoutName, ...] = ("vit-b16",)
    projection: bool = False
    tasks: TaskOptions = field(default_factory=TaskOptions)
    force: bool = False
    backend: Backend = "auto"
    agents: tuple[AgentName, ...] = ()
    vocabulary: Path | None = None

    @property
    def all_layouts(self) -> tuple[LayoutName, ...]:
        """The layouts of the features, with those that the agents read."""
        needed = (layout for agent in self.agents for layout in AGENTS[agent].features)
        return tuple(dict.fromkeys([*self.layouts, *needed]))

    @property
    def all_tasks(self) -> TaskOptions:
        """The options of the tasks, with the annotations and episodes that the agents read."""
        o = self.tasks
        return replace(o, streamvln=o.streamvln or self.frames, vlnce=o.vlnce or self.scenes)

    @property
    def frames(self) -> bool:
        """Whether an agent reads the frames of episodes."""
        return any(AGENTS[name].frames for name in self.agents)

    @property
    def look_down(self) -> bool:
        """Whether an agent reads frames that look down."""
        return any(AGENTS[name].look_down for name in self.agents)

    @property
    def scenes(self) -> bool:
        """Whether an agent opens scenes for Habitat."""
        return any(AGENTS[name].scenes for name in self.agents)

    @property
    def objects(self) -> bool:
        """Whether an agent reads features of objects."""
        return self.tasks.goals and any(AGENTS[name].goals for name in self.agents)

    @property
    def images(self) -> ScanSettings:
        """The settings of the images, with the views that the agents read."""
        return replace(self.scan, views=self.scan.views or any(AGENTS[name].views for name in self.agents))


@contextmanager
def prepare_exports(
    projects: Sequence[Path], out: Path, options: DatasetOptions
) -> Iterator[list[tuple[Project, PreparedExport]]]:
    """Yields the projects, opened for reading, with their prepared scan exports.

    Raises InputError if an export may not start, if two projects have equal scan ids, if `out` contains other files, or
    if a package, the vocabulary, or instructions that the files need are missing.
    """
    _refuse_foreign(out)
    for layout in options.all_layouts:
        if sentence := missing_package_error(LAYOUTS[layout]):
            raise InputError(sentence)
    check_agents(options.agents, options.vocabulary, options.tasks.instructions)
    check_options(options.tasks)
    with ExitStack() as stack:
        found: list[tuple[Project, PreparedExport]] = []
        for path in projects:
            project = stack.enter_context(Project.open(path))
            found.append((project, PreparedExport.of(project, out / SCANS, None, options.force)))
        names = [one.graph.scan for _, one in found]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"Two projects would export the scan {name}; rename the folder of one of them.")
        yield found


def export_dataset(
    projects: Sequence[Path],
    out: Path,
    options: DatasetOptions,
    listen: Listener,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Writes the dataset of `projects` into the folder `out`; returns the content of dataset.json. Parts that are
    complete and have unchanged inputs are reused. If `executor` is a cluster, it renders the images.

    Raises InputError in the cases of `prepare_exports`, if no path fits into a split, or if the disk refuses.
    """
    with prepare_exports(projects, out, options) as sources:
        o = options.tasks  # no images are drawn if no path fits
        sample_tasks([source.graph for _, source in sources], o.unseen, o.bounds, o.amounts)
        atomic.make_folder(out)
        lock = WriterLock(out / ".writer")
        try:
            return _export(sources, out, options, listen, executor)
        finally:
            (out / ".writer").unlink(missing_ok=True)
            lock.release()


def _export(
    sources: Sequence[tuple[Project, PreparedExport]],
    out: Path,
    options: DatasetOptions,
    listen: Listener,
    executor: Executor | None,
) -> dict[str, Any]:
    # If the export is interrupted, this unfinished record identifies the folder.
    about: dict[str, Any] = {"format": FORMAT, "made_by": f"nvsim {__version__}", "finished": False}
    before = _record(out)
    about["features"] = before.get("features", [])
    about |= {key: before[key] for key in ("scenes_made_from", "objects_made_from") if key in before}
    atomic.write_text(out / RECORD, json.dumps(about, indent=1) + "\n")
    o, places, clouds = options, [], {}
    for project, source in sources:
        places += export_scan(project, out / SCANS, None, o.images, o.stub, o.force, o.backend, None, listen, executor)
        cloud = project.dense_points() if o.all_tasks.strips else None
        if cloud is not None:
            clouds[source.graph.scan] = cloud
    graphs = [read_connectivity(place.connectivity) for place in places]
    features = _features(out, [graph.scan for graph in graphs], o, listen)
    made = make_tasks(graphs, out / SCANS, out / TASKS, o.all_tasks, listen, clouds)
    for split, fewer in made.instructed.dataset.lacking.items():
        listen(Warning(f"{split} has {fewer} paths fewer than requested, because no more fit", STAGE))
    if o.frames:
        from nvsim.dataset.frames import write_frames

        models = {source.graph.scan: source.source for _, source in sources}
        write_frames(models, made.walks, out / FRAMES, listen, o.look_down)
    if o.scenes:
        about["scenes_made_from"] = _scenes(out, [graph.scan for graph in graphs], clouds, listen)
    if o.objects:
        about["objects_made_from"] = _object_features(out, [graph.scan for graph in graphs], o, listen)
    _folders_of_agents(out, [graph.scan for graph in graphs], o, listen)
    write_tables(out, SCANS, graphs, made.instructed.dataset.splits)
    figures = _baselines(out, made, o.tasks.amounts.seed, listen)
    about |= {"finished": True, "scans": _scans(graphs, places), "features": features, "tasks": _tasks(made)}
    about |= {"agents": list(o.agents), "candidates": any(AGENTS[name].candidates for name in o.agents)}
    about |= {"frames": o.frames, "scenes": o.scenes, "objects": o.objects}
    about |= {"baselines": figures, "options": json.loads(json.dumps(asdict(o), default=str))}
    atomic.write_text(out / CARD, card_of(about))
    atomic.write_text(out / RECORD, json.dumps(_finite(about), indent=1) + "\n")
    listen(Done(STAGE, f"{len(graphs)} scans, {made.instructed.paths} paths in {out}", {"baselines": _finite(figures)}))
    return about


def _scenes(out: Path, scans: Sequence[str], clouds: Mapping[str, NDArray[np.floating]], listen: Listener) -> str:
    """Writes the scenes for Habitat, unless they were made from equal images and clouds; returns their key."""
    from nvsim.dataset.habitat.scene import CONFIG, write_scenes

    images = _images(out, scans)
    points = {scan: hashlib.sha256(np.ascontiguousarray(cloud).tobytes()).hexdigest() for scan, cloud in clouds.items()}
    key = key_of(images, points, __version__)
    files = [out / SCENES / CONFIG, *(out / SCENES / scene_id(scan) for scan in scans)]
    if _record(out).get("scenes_made_from") != key or not all(path.is_file() for path in files):
        write_scenes(out / SCANS, out / SCENES, tuple(scans), clouds=clouds, listen=listen)
    return key


def _folders_of_agents(out: Path, scans: Sequence[str], options: DatasetOptions, listen: Listener) -> None:
    vocabulary = check_agents(options.agents, options.vocabulary, options.tasks.instructions)
    parts = DatasetParts(out, tuple(scans), vocabulary, options.tasks.goals)
    if any(AGENTS[name].candidates for name in options.agents):
        parts.write_candidates()
    for name in options.agents:
        written = write_agent(parts, name, out / FOR_AGENTS / name)
        listen(Log(f"{AGENTS[name].title}: {len(written)} files and folders in {FOR_AGENTS}/{name}", STAGE))


def _features(out: Path, scans: Sequence[str], options: DatasetOptions, listen: Listener) -> list[dict[str, str]]:
    """Extracts the features; returns for each file its layout, name, backbone, and readers. Hashes of the inputs and of
    the file let the next run reuse it."""
    if not options.all_layouts:
        return []
    from nvsim.r2r.features.exported_scan import read_exported_scans
    from nvsim.r2r.features.extraction import extract_layouts
    from nvsim.r2r.features.network import choose_backbone

    before = {one["layout"]: one for one in _record(out).get("features", [])}
    exported = read_exported_scans(out / SCANS, scans)
    images = _images(out, scans)
    found, outdated = dict[str, dict[str, str]](), []
    for name in options.all_layouts:
        layout = LAYOUTS[name]
        backbone, warning = choose_backbone(layout, None, 12, "auto", options.projection)
        if warning:
            listen(Warning(warning, FEATURES))
        one = {"layout": str(name), "file": layout.file, "backbone": backbone.name, "read_by": layout.readers}
        one["made_from"] = key_of(name, str(backbone.digest), images, __version__)
        found[name], old = one, before.get(name, {})
        file = _features_file(out, layout)
        if old.get("made_from") != one["made_from"] or not file.is_file() or _digest(file) != old.get("sha256"):
            outdated.append((layout, backbone))
    for layouts, _ in extract_layouts(exported, outdated, out / FEATURES, listen):
        for layout in layouts:
            before[layout.name] = {**found[layout.name], "sha256": _digest(_features_file(out, layout))}
        about = {**_record(out), "features": list(before.values())}
        atomic.write_text(out / RECORD, json.dumps(about, indent=1) + "\n")
    return [before[name] for name in found]


def _object_features(out: Path, scans: Sequence[str], options: DatasetOptions, listen: Listener) -> str:
    """Computes the features of the objects of goals, unless they were made from equal images and boxes; returns their
    key."""
    from nvsim.r2r.features.exported_scan import read_exported_scans
    from nvsim.r2r.features.network import choose_backbone
    from nvsim.r2r.features.objects import FILES, write_object_features

    layout, boxes = LAYOUTS["vit-b16"], out / TASKS / GOALS / BOXES
    backbone, _ = choose_backbone(layout, None, 12, "auto", options.projection)
    key = key_of(str(backbone.digest), _images(out, scans), _digest(boxes), __version__)
    if _record(out).get("objects_made_from") != key or not all((out / FEATURES / name).is_file() for name in FILES):
        found = read_json(boxes, "boxes of objects", "export the dataset again")
        exported = read_exported_scans(out / SCANS, scans)
        write_object_features(exported, found, backbone, layout.width, out / FEATURES, listen)
    return key


def _images(out: Path, scans: Sequence[str]) -> dict[str, str]:
    """The hash of the images of each scan."""
    return {scan: _digest(ScanPlaces(out / SCANS, scan).manifest) for scan in scans}


def _features_file(out: Path, layout: Layout) -> Path:
    return out / FEATURES / layout.file / ("data.mdb" if layout.tokens else "")


def _digest(path: Path) -> str:
    with reading(path, "a file of a dataset", "export it again"), opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _record(out: Path) -> dict[str, Any]:
    """The content of dataset.json, {} if there is none. Raises InputError if it is damaged."""
    if not os.path.lexists(out / RECORD):
        return {}
    data = read_json(out / RECORD, "the record of a dataset", "remove it, or choose another --out")
    features = data.get("features", []) if isinstance(data, dict) else None
    if not isinstance(features, list) or not all(isinstance(f, dict) and "layout" in f for f in features):
        raise InputError(f"{out / RECORD} is damaged; remove it, or choose another --out.")
    return dict(data)


def _baselines(out: Path, made: WrittenTasks, seed: int, listen: Listener) -> dict[str, dict[str, Any]]:
    """Runs the baselines on every split that has paths; returns split -> agent -> metrics. The trajectories are written
    in the format of the R2R leaderboard."""
    found: dict[str, dict[str, Any]] = {}
    for split in SPLITS:
        if not made.instructed.dataset.splits[split]:
            continue
        benchmark = Benchmark.read(out / SCANS, out / TASKS / f"R2R_{split}.json")
        found[split] = {}
        for name in BASELINES:
            walked = run_agent(agent_of(name, benchmark.graphs, seed), benchmark.tasks, benchmark.folder)
            write_submission(out / RESULTS / f"{name}_{split}.json", walked)
            found[split][name.upper()] = figures_of(score(benchmark.tasks, walked, benchmark.distances))
        listen(Log(f"{split}: {len(benchmark.tasks)} paths tested with {', '.join(BASELINES)}", STAGE))
    return found


def _scans(graphs: Sequence[NavGraph], places: Sequence[ScanPlaces]) -> dict[str, dict[str, int]]:
    return {
        place.scan: {
            "viewpoints": sum(v.included for v in graph.viewpoints.values()),
            "edges": len(graph.edges),
        }
        for graph, place in zip(graphs, places, strict=True)
    }


def _tasks(made: WrittenTasks) -> dict[str, Any]:
    splits = {name: len(tasks) for name, tasks in made.instructed.dataset.splits.items()}
    return {"paths": splits, "instructions": made.about, "episodes": made.episodes}


def _refuse_foreign(out: Path) -> None:
    """Raises InputError if `out` contains files but is not a dataset of NVSim."""
    if not os.path.lexists(out):
        return
    if not out.is_dir():
        raise InputError(f"{out} is not a folder; choose another --out.")
    if os.path.lexists(out / RECORD):
        data = _record(out)
        if data.get("format") == FORMAT and "made_by" in data:
            return
    elif not any(out.iterdir()):
        return
    raise InputError(f"{out} contains files that are not an NVSim dataset; choose another --out, or an empty folder.")


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values with None for NaN and infinity, which JSON cannot represent."""

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [plain(inner) for inner in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {key: plain(value) for key, value in values.items()}
