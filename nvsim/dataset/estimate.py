"""Estimate the files, the size, and the time of a dataset export."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from nvsim.dataset.agent_files import FEATURES, FRAMES, SCANS, SCENES, TASKS, count_files
from nvsim.dataset.building import FOR_AGENTS, RESULTS, DatasetOptions
from nvsim.dataset.tables import DATA
from nvsim.geometry.directions import VIEWS
from nvsim.project.project import Project
from nvsim.r2r.features.layouts import LAYOUTS
from nvsim.r2r.features.objects import FILES
from nvsim.r2r.observations.estimate import duration_text, shortage
from nvsim.r2r.observations.export import PreparedExport
from nvsim.r2r.tasks.splitting import sample_tasks

# CPU seconds: features of a viewpoint by the network (_TRUNK) and by the projection, the survey of a viewpoint's
# surroundings (_LOOK), an instruction (_TELL), the episode of a path, and a baseline's run along a path (_WALK).
_TRUNK, _PROJECTION = 1.3, 0.25
_LOOK, _TELL, _EPISODE, _WALK = 0.15, 0.03, 0.15, 0.01
_INSTRUCTION, _EPISODE_BYTES, _TRAJECTORY, _POSE_TRACE, _BOXES = 250, 1500, 1200, 8000, 2500  # bytes
_ROW, _VIEWPOINT = 500, 600  # bytes
_OBJECTS = 3  # objects at a viewpoint, each with three boxes
_FRAMES, _FRAME, _FRAME_BYTES = 6.0, 0.05, 53_000  # frames of an episode per meter; CPU seconds and bytes of a frame
_DOWN, _DOWN_BYTES = 0.08, 130_000  # the same of a frame that looks down, with its depth
_SCENE, _SCENE_BYTES = 0.25, 220_000  # CPU seconds and bytes of a scene per viewpoint


def estimate_dataset(sources: Sequence[tuple[Project, PreparedExport]], options: DatasetOptions) -> dict[str, Any]:
    """The estimate as a JSON-able dictionary, with the fields of `nvsim export scan --dry-run` and the number of paths
    by split.

    Fields: scans, kinds (of files), files, bytes, seconds, shortage. `missing` is in bytes still to be written.
    `drawn` and `todo` count viewpoints. `time` is in words. `free` is in bytes.

    Raises InputError if no path fits into a split.
    """
    o = options
    founds = [source.estimate(o.images, o.stub and not i, o.backend) for i, (_, source) in enumerate(sources)]
    kinds: list[dict[str, Any]] = [
        {"what": k.what, "folder": f"{SCANS}/{k.folder}".rstrip("/"), "files": k.files, "bytes": k.bytes}
        for f in founds
        for k in f.kinds
    ]
    drawn = sum(found.drawn for found in founds)
    tasks = sample_tasks([source.graph for _, source in sources], o.tasks.unseen, o.tasks.bounds, o.tasks.amounts)
    paths = {name: len(split) for name, split in tasks.splits.items()}
    count, each = sum(paths.values()), o.tasks.instructions
    beside: list[dict[str, Any]] = []
    for name in o.all_layouts:
        layout = LAYOUTS[name]
        size = drawn * 36 * 4 * (layout.width + (1000 if layout.classes else 0))
        if layout.tokens:
            edges = sum(len(source.graph.edges) for _, source in sources)
            size = 2 * edges * 4 * layout.tokens * layout.width
        beside.append({"what": "features", "folder": FEATURES, "files": 1, "bytes": size})
    # A joined path has every pair of instructions of its two parts, so their number is squared.
    instruction_bytes = count * each * _INSTRUCTION + sum(map(len, tasks.joined.values())) * each**2 * 2 * _INSTRUCTION
    beside.append({"what": "tasks", "folder": TASKS, "files": 5 + len(tasks.joined), "bytes": instruction_bytes})
    table = count * max(1, each) * _ROW + drawn * _VIEWPOINT
    beside.append({"what": "tables", "folder": DATA, "files": 4, "bytes": table})
    small_steps = o.all_tasks.vlnce or o.all_tasks.streamvln
    if small_steps:
        files = 6 * o.all_tasks.vlnce + 3 * o.all_tasks.streamvln
        beside.append({"what": "episodes", "folder": TASKS, "files": files, "bytes": count * _EPISODE_BYTES})
    if o.tasks.rxr:
        files = count * each + 3 + 6 * o.all_tasks.vlnce
        beside.append({"what": "RxR", "folder": TASKS, "files": files, "bytes": count * each * _POSE_TRACE})
    if o.tasks.goals:
        size = 2 * count * _EPISODE_BYTES + drawn * _BOXES
        beside.append({"what": "goals", "folder": TASKS, "files": 16 + drawn, "bytes": size})
    if o.objects:
        size = len(FILES) * drawn * _OBJECTS * 4 * LAYOUTS["vit-b16"].width
        beside.append({"what": "features of objects", "folder": FEATURES, "files": len(FILES), "bytes": size})
    frames = 0
    if o.frames:
        frames = round(_FRAMES * sum(task.distance or 0.0 for split in tasks.splits.values() for task in split))
        beside.append({"what": "frames", "folder": FRAMES, "files": frames, "bytes": frames * _FRAME_BYTES})
    if o.look_down:
        beside.append(
            {"what": "frames that look down", "folder": FRAMES, "files": 2 * frames, "bytes": frames * _DOWN_BYTES}
        )
    if o.scenes:
        beside.append(
            {"what": "scenes", "folder": SCENES, "files": 1 + 3 * len(sources), "bytes": drawn * _SCENE_BYTES}
        )
    if o.agents:
        scans = [source.graph.scan for _, source in sources]
        files = sum(count_files(name, scans, o.tasks.goals) for name in o.agents)
        size = len(o.agents) * instruction_bytes
        beside.append({"what": "agents", "folder": FOR_AGENTS, "files": files, "bytes": size})
    walks = 3 * count * max(1, each)
    beside.append(
        {
            "what": "baselines",
            "folder": RESULTS,
            "files": 3 * sum(map(bool, paths.values())),
            "bytes": walks * _TRAJECTORY,
        }
    )
    missing = sum(found.missing for found in founds) + sum(int(kind["bytes"]) for kind in beside)
    seconds = [found.seconds for found in founds]
    rest = drawn * (len(o.all_layouts) + 3 * _OBJECTS / VIEWS * o.objects) * (_PROJECTION if o.projection else _TRUNK)
    rest += drawn * _LOOK * (o.tasks.landmarks or o.tasks.goals) + count * (
        each * _TELL + walks / max(1, count) * _WALK
    )
    rest += count * _EPISODE * small_steps + frames * (_FRAME + _DOWN * o.look_down) + drawn * _SCENE * o.scenes
    whole = None if any(one is None for one in seconds) else rest + math.fsum(one or 0.0 for one in seconds)
    first = sources[0][1]
    return {
        "scans": [source.graph.scan for _, source in sources],
        "kinds": [*kinds, *beside],
        "files": sum(int(kind["files"]) for kind in [*kinds, *beside]),
        "bytes": sum(int(kind["bytes"]) for kind in [*kinds, *beside]),
        "missing": missing,
        "drawn": drawn,
        "todo": sum(found.todo for found in founds),
        "seconds": whole,
        "time": "unknown time for gsplat" if whole is None else duration_text(whole),
        "free": first.free,
        "shortage": shortage(missing, first.free, first.root),
        "paths": paths,
    }
