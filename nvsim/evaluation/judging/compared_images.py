"""Make the images that are compared: equal views by two or more models, as files.

OUT/images/NAME/KEY/VIEW-CAMERA.png   rendered once; KEY identifies the model, so images of other models are not reused
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from nvsim.capture.images import decode
from nvsim.errors import InputError
from nvsim.evaluation.ablation_runs import (
    AblationRow,
    SharedViews,
    TrainingRun,
    progress_of_run,
    train_or_load,
    training_run,
)
from nvsim.evaluation.judging.views import JudgedView, Kind
from nvsim.evaluation.scores import Image
from nvsim.events import Listener, Progress
from nvsim.files import atomic
from nvsim.files.opening import is_regular
from nvsim.files.placeholders import is_metadata_name
from nvsim.geometry.camera import Camera
from nvsim.project.project import Project
from nvsim.project.work import missing_result_error
from nvsim.render.model import render_model
from nvsim.render.scene import render_scene
from nvsim.splats.files import load_model
from nvsim.submaps.split import Submap

STAGE = "judge"
_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")
Draw = Callable[[Camera], Image]


@dataclass(frozen=True, eq=False)
class ContestantImages:
    """A view with one image per model.

    name     name of the view
    kind     "seen" or "novel"
    group    submap of the view, "" if unknown
    images   model name -> image file
    photo    returns the photograph (H, W, 3) float32, 0 to 1; None if there is none
    """

    name: str
    kind: Kind
    group: str
    images: Mapping[str, Path]
    photo: Callable[[], Image] | None


def by_presets(
    project: Project,
    rows: Sequence[AblationRow],
    submaps: Sequence[Submap],
    seed: int,
    views: Sequence[JudgedView],
    out: Path,
    listen: Listener,
) -> list[ContestantImages]:
    """Renders the views with presets of one project, using the models of the ablation. Missing models are trained."""
    runs = {(row.name, s.index): training_run(project, s, row.config, seed) for row in rows for s in submaps}
    todo = [run for run in {run.folder: run for run in runs.values()}.values() if not run.is_done]
    total, before = sum(run.config.steps for run in todo), 0
    for submap in submaps:
        shared = SharedViews(project, submap)
        for row in rows:
            run = runs[row.name, submap.index]
            if not run.is_done:
                title = f"{row.title}, submap {submap.index}"
                train_or_load(project, run, shared.of(run), progress_of_run(listen, STAGE, before, total, title))
                before += run.config.steps
    drawers = {row.name: _of_runs({str(s.index): runs[row.name, s.index] for s in submaps}) for row in rows}
    return _draw_contestants(drawers, views, out, listen)


def _of_runs(runs: Mapping[str, TrainingRun]) -> tuple[Callable[[JudgedView], str], Callable[[JudgedView], Draw]]:
    """Functions that give the key of a view and its renderer. Views are ordered by submap, so one model is in memory at
    a time."""
    held: list[tuple[str, Draw]] = []

    def draw(view: JudgedView) -> Draw:
        if not held or held[0][0] != view.group:
            model = load_model(runs[view.group].model_folder)

            def of(camera: Camera) -> Image:
                rgb = render_model(model, camera, frozenset({"rgb"})).rgb
                assert rgb is not None
                return rgb

            held[:] = [(view.group, of)]
        return held[0][1]

    return (lambda view: runs[view.group].folder.name), draw


def by_projects(
    projects: Mapping[str, Project], views: Sequence[JudgedView], out: Path, listen: Listener
) -> list[ContestantImages]:
    """Renders the views with several projects of one capture. Raises InputError if a project has no models, or a
    different capture or frame."""
    first_name, first = next(iter(projects.items()))
    capture = first.need_capture()
    drawers = {}
    for name, project in projects.items():
        other = project.need_capture()
        same = len(other.frames) == len(capture.frames) and all(
            a.name == b.name and np.allclose(a.camera.camera_to_world, b.camera.camera_to_world, atol=1e-4)
            for a, b in zip(capture.frames, other.frames)
        )
        if not same:
            raise InputError(
                f"{name} and {first_name} do not have equal frames and poses, so their images show different "
                "views; compare projects of one capture, imported in the same way."
            )
        drawers[name] = _of_project(project)
    return _draw_contestants(drawers, views, out, listen)


def _of_project(project: Project) -> tuple[Callable[[JudgedView], str], Callable[[JudgedView], Draw]]:
    scene = project.scene()
    if scene is None:
        raise missing_result_error(project.layout.root, "train")
    words = []
    for submap in project.submaps("train"):
        folder = project.layout.model(submap.index)
        files = sorted(folder.iterdir()) if folder.is_dir() else []
        words += [(submap.index, f.name, (s := os.stat(f)).st_size, s.st_mtime_ns) for f in files]
    key = hashlib.sha256(repr(words).encode()).hexdigest()[:16]

    def draw(camera: Camera) -> Image:
        rgb = render_scene(scene, camera, frozenset({"rgb"}))[1].rgb
        assert rgb is not None
        return rgb

    return (lambda view: key), (lambda view: draw)


def _draw_contestants(
    drawers: Mapping[str, tuple[Callable[[JudgedView], str], Callable[[JudgedView], Draw]]],
    views: Sequence[JudgedView],
    out: Path,
    listen: Listener,
) -> list[ContestantImages]:
    images: dict[str, dict[str, Path]] = {view.name: {} for view in views}
    total = len(drawers) * len(views)
    for done, (name, view) in enumerate((name, view) for name in drawers for view in views):
        key, draw = drawers[name]
        path = out / "images" / name / key(view) / f"{view.name}-{view.key}.png"
        if not is_regular(path):
            listen(Progress(STAGE, done, total, f"drawing {name}"))
            rgb = (np.clip(draw(view)(view.camera), 0, 1) * 255 + 0.5).astype(np.uint8)
            atomic.write_bytes(path, cv2.imencode(".png", rgb[..., ::-1])[1].tobytes())
        images[view.name][name] = path
    return [ContestantImages(view.name, view.kind, view.group, images[view.name], view.photo) for view in views]


def by_folders(folders: Mapping[str, Path], reference: Path | None) -> list[ContestantImages]:
    """Reads folders of rendered images that have the same names. Images below a folder `novel` are novel views, all
    others are seen views. reference: a folder of photographs with these names, if there are any.

    Raises InputError if a folder has no image, or if the folders have no common image name."""
    found = {name: _images_in(folder) for name, folder in folders.items()}
    first, *others = found.values()
    common = [name for name in first if all(name in other for other in others)]
    if not common:
        raise InputError(
            f"{' and '.join(str(f) for f in folders.values())} have no image of the same name; render the same views "
            "into each folder, with the same names."
        )
    photos = _images_in(reference) if reference is not None else {}
    return [
        ContestantImages(
            name,
            "novel" if "novel" in Path(name).parts[:-1] else "seen",
            "",
            {who: images[name] for who, images in found.items()},
            _photo(photos[name]) if name in photos else None,
        )
        for name in common
    ]


def _images_in(folder: Path) -> dict[str, Path]:
    """Name relative to the folder, without suffix -> path. Raises InputError if there is no image."""
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder of rendered images; name one.")
    images = (p for p in sorted(folder.rglob("*")) if p.suffix.lower() in _SUFFIXES and is_regular(p))
    paths = [p for p in images if not is_metadata_name(p.name)]
    if not paths:
        raise InputError(f"{folder} has no image ({', '.join(_SUFFIXES)}); name the folder that contains them.")
    return {p.relative_to(folder).with_suffix("").as_posix(): p for p in paths}


def _photo(path: Path) -> Callable[[], Image]:
    return lambda: read_shown(path)


def read_shown(path: Path) -> Image:
    """(H, W, 3) float32, 0 to 1. Raises InputError if the image cannot be read."""
    return np.asarray(decode(path) / np.float32(255), np.float32)
