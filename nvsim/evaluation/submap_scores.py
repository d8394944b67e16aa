"""Score the models of one submap on its held-out frames and on the novel views that are nearest to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from nvsim.evaluation.comparison import Shown, Tile
from nvsim.evaluation.novel import NovelView
from nvsim.evaluation.scores import Distance, Image, Scores, mean_scores, score
from nvsim.evaluation.views import HeldOut, read_held_out, score_novel
from nvsim.geometry.camera import Camera
from nvsim.project.project import Project
from nvsim.render.model import render_model
from nvsim.splats.types import SubmapModel

_SHARE = 0.3  # share of floor in an image that is good to show


@dataclass(eq=False)
class Scored:
    """frames and novel: metrics of every held-out frame and novel view; tiles: name of a shown image -> its tile."""

    frames: list[Scores]
    novel: list[Scores]
    seconds: float
    gaussians: int
    tiles: dict[str, Tile] = field(default_factory=dict)


def totals(scored: Sequence[Scored]) -> dict[str, Any]:
    """Means over all frames and views of some submaps. Seconds and Gaussians are sums."""
    return {
        **mean_scores([row for s in scored for row in s.frames]),
        **mean_scores([row for s in scored for row in s.novel]),
        "frames": sum(len(s.frames) for s in scored),
        "seconds": round(sum(s.seconds for s in scored), 1),
        "gaussians": sum(s.gaussians for s in scored),
    }


class Bench:
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
        few = _chosen([f.floor.mean() for f in self._frames], shown)
        self._shown_frames = {self._frames[i].name: self._frames[i] for i in few}
        masks = [v.floor_mask() for v in self._novel]
        shares = [0.0 if m is None else float(m.mean()) for m in masks]
        self._shown_novel = {v.name: v for v in (self._novel[i] for i in _chosen(shares, (shown + 1) // 2))}

    @property
    def pictures(self) -> list[Shown]:
        """The images to show, with their ground truth."""
        held = [Shown.of(f"held out: {name}", f.image, f.floor) for name, f in self._shown_frames.items()]
        return held + [Shown.of(f"novel: {n}", v.image(), v.floor_mask()) for n, v in self._shown_novel.items()]

    def score(self, model: SubmapModel) -> Scored:
        """Scores a model on these frames and views."""

        def render(camera: Camera) -> tuple[int, Image, Image]:
            output = render_model(model, camera, frozenset({"rgb", "alpha"}))
            assert output.rgb is not None and output.alpha is not None
            return 0, output.rgb, output.alpha

        tiles: dict[str, Tile] = {}

        def judged(frame: HeldOut) -> Scores:
            _, rgb, alpha = render(frame.camera)
            figures = score(frame.image, rgb, alpha, frame.floor, frame.valid, self._distance)
            if frame.name in self._shown_frames:
                tiles[f"held out: {frame.name}"] = Tile.of(rgb, alpha, figures)
            return figures

        frames = [judged(frame) for frame in self._frames]
        novel = [{k: v for k, v in r.items() if k.startswith("novel_")} for r in score_novel(self._novel, render)]
        for view, figures in zip(self._novel, novel, strict=True):
            if view.name in self._shown_novel:
                _, rgb, alpha = render(view.camera)
                tiles[f"novel: {view.name}"] = Tile.of(rgb, alpha, figures)
        seconds = model.info.get("training_seconds", 0.0)
        return Scored(frames, novel, float(str(seconds)), len(model.gaussians), tiles)


def _chosen(shares: Sequence[float], count: int) -> list[int]:
    """From each of `count` sections of the trajectory, the image whose share of floor is nearest to _SHARE."""
    if not shares:
        return []
    stretches = np.array_split(np.arange(len(shares)), min(count, len(shares)))
    return [int(min(stretch, key=lambda i: abs(shares[i] - _SHARE))) for stretch in stretches]
