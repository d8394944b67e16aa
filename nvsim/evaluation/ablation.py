"""Run the paper's ablation and the comparison of presets on one project: train, score, show and write every row.

All rows use equal steps, image size, numbers of Gaussians, and seeds, and are scored on equal images. Each submap's
model is scored on the held-out frames of its core, and on the novel views that are nearest to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from nvsim.errors import InputError
from nvsim.evaluation.ablation_runs import (
    ABLATION,
    COMPARISON,
    TABLES,
    AblationRow,
    Budget,
    SharedViews,
    TrainingRun,
    ablation_rows,
    delete_run,
    preset_rows,
    progress_of_run,
    train_or_load,
    training_run,
)
from nvsim.evaluation.comparison import ComparedImage, Tile, draw_comparison
from nvsim.evaluation.scores import Distance, Image, Scores, mean_scores, score
from nvsim.evaluation.table import ALPHA, NOVEL, SPREAD, WITH_FLOOR, WITHOUT_FLOOR, Column, csv_table, text_table
from nvsim.evaluation.truth import truth_of
from nvsim.evaluation.views import (
    HeldOut,
    NovelView,
    has_novel_views,
    held_out_frames,
    novel_views,
    read_held_out,
    score_novel,
)
from nvsim.events import Listener, Log
from nvsim.files import atomic
from nvsim.geometry.camera import Camera
from nvsim.project.project import Project
from nvsim.project.stages.floors import floors_key
from nvsim.project.work import missing_result_error
from nvsim.render.model import render_model
from nvsim.splats.types import SubmapModel
from nvsim.submaps.split import Submap, nearest_submap

_SHARE = 0.3  # share of floor in an image that is good to show
STAGE = "ablation"
_SHOWN_SUBMAPS = 4
_SHOWN_FRAMES = {1: 3, 2: 2}  # number of submaps -> shown frames per submap; 1 if there are more submaps
_HEADS = {
    ABLATION: "Ablation: every row adds to the one above it",
    COMPARISON: "Presets, with equal steps, image size and Gaussians",
}
_COST = (Column("seconds", "seconds", "training", 0), Column("gaussians", "Gaussians", "training", 0))


@dataclass(eq=False)
class ScoredRun:
    """frames and novel: metrics of every held-out frame and novel view; tiles: name of a shown image -> its tile."""

    frames: list[Scores]
    novel: list[Scores]
    seconds: float
    gaussians: int
    tiles: dict[str, Tile] = field(default_factory=dict)


def mean_over_submaps(scored: Sequence[ScoredRun]) -> dict[str, Any]:
    """Means over all frames and views of some submaps. Seconds and Gaussians are sums."""
    return {
        **mean_scores([row for s in scored for row in s.frames]),
        **mean_scores([row for s in scored for row in s.novel]),
        "frames": sum(len(s.frames) for s in scored),
        "seconds": round(sum(s.seconds for s in scored), 1),
        "gaussians": sum(s.gaussians for s in scored),
    }


class SubmapViews:
    """The held-out `frames` and the `novel` views of one submap. `shown` frames, and about half as many novel views,
    are also stored as images. Raises InputError if an image cannot be read."""

    def __init__(
        self,
        project: Project,
        truth: Path | None,
        frames: Sequence[int],
        novel: Sequence[NovelView],
        distance: Distance | None,
        shown: int,
    ) -> None:
        self._frames = [read_held_out(project, truth, i) for i in frames]
        self._novel = list(novel)
        self._distance = distance
        few = _choose_images([f.floor.mean() for f in self._frames], shown)
        self._shown_frames = {self._frames[i].name: self._frames[i] for i in few}
        masks = [v.floor_mask() for v in self._novel]
        shares = [0.0 if m is None else float(m.mean()) for m in masks]
        self._shown_novel = {v.name: v for v in (self._novel[i] for i in _choose_images(shares, (shown + 1) // 2))}

    @property
    def pictures(self) -> list[ComparedImage]:
        """The images to show, with their ground truth."""
        held = [ComparedImage.of(f"held out: {name}", f.image, f.floor) for name, f in self._shown_frames.items()]
        return held + [ComparedImage.of(f"novel: {n}", v.image(), v.floor_mask()) for n, v in self._shown_novel.items()]

    def score(self, model: SubmapModel) -> ScoredRun:
        """Scores a model on these frames and views."""

        def render(camera: Camera) -> tuple[int, Image, Image]:
            output = render_model(model, camera, frozenset({"rgb", "alpha"}))
            assert output.rgb is not None and output.alpha is not None
            return 0, output.rgb, output.alpha

        tiles: dict[str, Tile] = {}

        def score_view(frame: HeldOut) -> Scores:
            _, rgb, alpha = render(frame.camera)
            figures = score(frame.image, rgb, alpha, frame.floor, frame.valid, self._distance)
            if frame.name in self._shown_frames:
                tiles[f"held out: {frame.name}"] = Tile.of(rgb, alpha, figures)
            return figures

        frames = [score_view(frame) for frame in self._frames]
        novel = [{k: v for k, v in r.items() if k.startswith("novel_")} for r in score_novel(self._novel, render)]
        for view, figures in zip(self._novel, novel, strict=True):
            if view.name in self._shown_novel:
                _, rgb, alpha = render(view.camera)
                tiles[f"novel: {view.name}"] = Tile.of(rgb, alpha, figures)
        seconds = model.info.get("training_seconds", 0.0)
        return ScoredRun(frames, novel, float(str(seconds)), len(model.gaussians), tiles)


def _choose_images(shares: Sequence[float], count: int) -> list[int]:
    """From each of `count` sections of the trajectory, the image whose share of floor is nearest to _SHARE."""
    if not shares:
        return []
    stretches = np.array_split(np.arange(len(shares)), min(count, len(shares)))
    return [int(min(stretch, key=lambda i: abs(shares[i] - _SHARE))) for stretch in stretches]


@dataclass(frozen=True)
class AblationConfig:
    """Rows, submaps, and seeds to train and score. Empty tuples mean all. `repeat` repeats finished runs."""

    tables: tuple[str, ...] = TABLES
    rows: tuple[str, ...] = ()
    presets: tuple[str, ...] = ()
    submaps: tuple[int, ...] = ()
    seeds: tuple[int, ...] = (0,)
    budget: Budget = field(default_factory=Budget)
    repeat: bool = False


@dataclass(frozen=True, eq=False)
class AblationTable:
    """One result table.

    rows    row, title, metrics, and metric + "_spread" if there are several seeds
    parts   the metrics of every row, seed, and submap
    tiles   per shown image, one tile for each row
    """

    rows: list[dict[str, Any]]
    parts: list[dict[str, Any]]
    tiles: list[list[Tile]]


@dataclass(frozen=True, eq=False)
class AblationResult:
    """The tables by name, the images of the visual comparison, and the numbers of trained and reused runs."""

    tables: dict[str, AblationTable]
    shown: list[ComparedImage]
    trained: int
    reused: int


def evaluate_ablation(
    project: Project,
    config: AblationConfig,
    listen: Listener,
    truth: Path | None = None,
    distance: Distance | None = None,
) -> AblationResult:
    """Trains missing runs and scores all of them. Raises InputError if the project has no floor masks or no held-out
    frames, or if a named submap or row does not exist."""
    chosen, tables, folder = chosen_submaps(project, config.submaps), _tables(config), truth_of(project, truth)
    runs = {
        (row, submap.index, seed): training_run(project, submap, row.config, seed)
        for submap in chosen
        for lines in tables.values()
        for row in lines
        for seed in config.seeds
    }
    titles: dict[Path, str] = {}
    distinct: dict[Path, TrainingRun] = {}
    for (row, index, _), run in runs.items():
        titles.setdefault(run.folder, f"{row.title}, submap {index}")
        distinct.setdefault(run.folder, run)
    if config.repeat:
        for run in distinct.values():
            delete_run(run)
    todo = [run for run in distinct.values() if not run.is_done]
    listen(Log(f"{len(distinct)} runs, {len(distinct) - len(todo)} of them already finished.", STAGE))
    total, before = sum(run.config.steps for run in todo), 0
    scored: dict[Path, ScoredRun] = {}
    shown: list[tuple[int, ComparedImage]] = []
    for submap, bench in _benches(project, chosen, folder, distance):
        shown += [(submap.index, picture) for picture in bench.pictures]
        views = SharedViews(project, submap)
        for run in (r for r in distinct.values() if r.submap.index == submap.index):
            model = train_or_load(
                project, run, views.of(run), progress_of_run(listen, STAGE, before, total, titles[run.folder])
            )
            before += run.config.steps if run in todo else 0
            scored[run.folder] = bench.score(model)
    result = {}
    for name, lines in tables.items():
        of = {key: scored[run.folder] for key, run in runs.items() if key[0] in lines}
        result[name] = _table(lines, chosen, config.seeds, of, shown)
    return AblationResult(result, [s for _, s in shown], len(todo), len(distinct) - len(todo))


def _table(
    lines: Sequence[AblationRow],
    submaps: Sequence[Submap],
    seeds: Sequence[int],
    scored: dict[tuple[AblationRow, int, int], ScoredRun],
    shown: Sequence[tuple[int, ComparedImage]],
) -> AblationTable:
    rows, parts = [], []
    for row in lines:
        named = {"row": row.name, "title": row.title}
        for seed in seeds:
            parts += [
                {**named, "seed": seed, "submap": s.index, **mean_over_submaps([scored[row, s.index, seed]])}
                for s in submaps
            ]
        per_seed = [mean_over_submaps([scored[row, s.index, seed] for s in submaps]) for seed in seeds]
        rows.append({**named, **_over_seeds(per_seed)})
    tiles = [[scored[row, submap, seeds[0]].tiles[picture.name] for row in lines] for submap, picture in shown]
    return AblationTable(rows, parts, tiles)


def _over_seeds(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The mean of every metric, and with several seeds its standard deviation."""
    result: dict[str, Any] = {}
    for name in rows[0]:
        values = [r[name] for r in rows if r[name] is not None]
        result[name] = round(float(np.mean(values)), 4) if values else None
        if name in ("frames", "gaussians"):
            result[name] = round(float(np.mean(values)))
        elif len(values) > 1 and name != "seconds":
            result[name + SPREAD] = round(float(np.std(values, ddof=1)), 4)
    return result


def _tables(config: AblationConfig) -> dict[str, tuple[AblationRow, ...]]:
    if not config.tables or not config.seeds:
        raise InputError("Name at least one of --tables and one of --seeds.")
    made: dict[str, Callable[[], tuple[AblationRow, ...]]] = {
        ABLATION: lambda: ablation_rows(config.budget, config.rows),
        COMPARISON: lambda: preset_rows(config.budget, config.presets),
    }
    return {table: made[table]() for table in TABLES if table in config.tables}


def chosen_submaps(project: Project, only: tuple[int, ...]) -> list[Submap]:
    """The submaps of a project, limited to `only` if it is not empty. Raises InputError if a submap does not exist, or
    if the project has no floor masks."""
    submaps = project.need_submaps()
    if not floors_key(project):
        raise missing_result_error(project.layout.root, "floors")
    unknown = sorted(set(only) - {s.index for s in submaps})
    if unknown:
        raise InputError(f"There is no submap {unknown[0]}; the project has submaps 0 to {len(submaps) - 1}.")
    return [s for s in submaps if not only or s.index in only]


def _benches(
    project: Project, submaps: Sequence[Submap], truth: Path | None, distance: Distance | None
) -> Iterator[tuple[Submap, SubmapViews]]:
    """Yields each submap with its bench, which is made on demand. Raises InputError if no submap has a held-out
    frame."""
    kept_out = set(held_out_frames(project))
    frames = {s.index: [i for i in s.core if i in kept_out] for s in submaps}
    if not any(frames.values()):
        raise InputError("These submaps have no held-out frame; name other --submaps.")
    novel: dict[int, list[NovelView]] = {s.index: [] for s in submaps}
    if has_novel_views(truth):
        everything = project.need_submaps()
        for view in novel_views(project, truth):
            novel.setdefault(nearest_submap(everything, view.camera.position), []).append(view)
    every = max(len(submaps) / _SHOWN_SUBMAPS, 1.0)
    pictured = {submaps[int(k * every)].index for k in range(min(len(submaps), _SHOWN_SUBMAPS))}
    for submap in submaps:
        count = _SHOWN_FRAMES.get(len(submaps), 1) if submap.index in pictured else 0
        yield submap, SubmapViews(project, truth, frames[submap.index], novel[submap.index], distance, count)


def text_of(outcome: AblationResult, lpips_why: str) -> str:
    """The tables with notes. An asterisk marks the best value of a column."""
    parts = []
    for name, table in outcome.tables.items():
        columns = [Column("title", "experiment"), *WITH_FLOOR, *WITHOUT_FLOOR, *ALPHA]
        if any(row.get("novel_psnr") is not None for row in table.rows):
            columns += NOVEL
        parts.append(f"{_HEADS[name]}\n\n{text_table([*columns, *_COST], table.rows, mark_best=True)}")
    count = max((row["frames"] for table in outcome.tables.values() for row in table.rows), default=0)
    notes = [f"Means over {count} held-out frames; seconds and Gaussians are sums over the submaps."]
    if lpips_why:
        notes.append(f"LPIPS is empty: {lpips_why}.")
    return "\n".join([*parts, *notes]) + "\n"


def write_report(outcome: AblationResult, folder: Path, lpips_why: str) -> list[Path]:
    """Writes tables.txt, and a CSV file and an image per table; returns their paths. Raises InputError if the disk
    refuses."""
    files = [folder / "tables.txt"]
    atomic.write_text(files[0], text_of(outcome, lpips_why))
    for name, table in outcome.tables.items():
        files += [folder / f"{name}.csv", folder / f"{name}.png"]
        atomic.write_text(files[-2], csv_of(table))
        draw_comparison(files[-1], [row["title"] for row in table.rows], outcome.shown, table.tiles)
    return files


def csv_of(table: AblationTable) -> str:
    """One line per row, seed, and submap, and one line per row with the means."""
    first = ["row", "title", "seed", "submap"]
    rows = [{**row, "seed": "mean", "submap": "mean"} for row in table.rows] + table.parts
    return csv_table([*first, *dict.fromkeys(k for r in rows for k in r if k not in first)], rows)
