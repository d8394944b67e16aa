"""Training as a whole, on a small room: it learns, it repeats, it resumes, and the renderer shows what it learned."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numba
import numpy as np
import pytest
from painted_background import render_background

from nvsim.benchmarks.train import measure
from nvsim.errors import InputError
from nvsim.events import Event, Metric, Preview, Progress, Warning
from nvsim.render.model import render_model
from nvsim.splats.types import SubmapModel
from nvsim.training import trainer
from nvsim.training.config import PRESETS, TrainingConfig, preset
from nvsim.training.model_fit import STEP_PARTS
from nvsim.training.strategies.config import AdaptiveConfig, CappedConfig
from nvsim.training.synthetic import SyntheticRoom, synthetic_room
from nvsim.training.trainer import MOST_STEPS, PreviewFiles, train_submap
from nvsim.training.trainer import preview as preview_of
from nvsim.training.views import TrainingView

SMALL = TrainingConfig(steps=60, gaussian_cap=3000, checkpoint_seconds=0.0)


class Killed(Exception):
    pass


@pytest.fixture(scope="module")
def room() -> SyntheticRoom:
    return synthetic_room(10, 96, 72, 4000)


def train(room: SyntheticRoom, config: TrainingConfig, **more) -> SubmapModel:
    return train_submap(room.views, room.cloud, room.floor, config, **more)


def psnr(model: SubmapModel, view: TrainingView, where: np.ndarray) -> float:
    drawn = render_model(model, view.camera).rgb
    return float(-10 * np.log10(np.mean((np.clip(drawn, 0, 1) - view.image / 255.0)[where] ** 2)))


def arrays_of(model: SubmapModel) -> list[np.ndarray]:
    g = model.gaussians
    arrays = [g.means, g.log_scales, g.quats, g.opacity_logits, g.sh]
    arrays += [] if model.background is None else list(model.background.weights.values())
    return arrays + ([] if model.texture is None else list(model.texture.levels))


def is_same(a: SubmapModel, b: SubmapModel) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(arrays_of(a), arrays_of(b), strict=True))


def test_a_room_is_learned_and_its_floor_stays_empty(room: SyntheticRoom) -> None:
    model = train(room, replace(SMALL, steps=400))
    view = room.views[4]
    assert psnr(model, view, ~view.floor) > 22
    assert psnr(model, view, view.floor) > 25
    alpha = render_model(model, view.camera).alpha
    assert alpha[view.floor].mean() < 0.1
    assert alpha[~view.floor].mean() > 0.9


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_trains(room: SyntheticRoom, name: str) -> None:
    config = preset(name)
    assert config.name == name
    model = train(room, replace(config, steps=25, gaussian_cap=2000))
    assert (model.background is None) == (name == "3dgs")
    assert (model.texture is None) == (name != "nvsim")
    assert model.info["preset"] == name
    assert all(np.isfinite(a).all() for a in arrays_of(model))


def test_an_unknown_preset_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="nvsim, splatfacto-i, splatfacto-w, 3dgs"):
        preset("nerf")


def test_the_renderer_shows_what_training_saw(room: SyntheticRoom) -> None:
    run = trainer._TrainingRun(room.views, room.cloud, room.floor, SMALL, 0, 0, lambda event: None)
    model = run.finish(None)
    for view in room.views[:3]:
        ours, alpha = run.fit.composite(view.camera)
        drawn = render_model(model, view.camera)
        np.testing.assert_allclose(drawn.rgb, ours, atol=1e-3)
        np.testing.assert_allclose(drawn.alpha, alpha, atol=1e-5)


def test_the_same_seed_gives_the_same_model_and_another_does_not(room: SyntheticRoom) -> None:
    config = replace(SMALL, steps=25)
    first = train(room, config, seed=7)
    assert is_same(first, train(room, config, seed=7))
    assert not is_same(first, train(room, config, seed=8))


def train_killed(room: SyntheticRoom, config: TrainingConfig, file: Path, step: int) -> None:
    """Leaves a checkpoint of `step` and no model."""
    save = trainer._TrainingRun._save

    def save_then_die(self: trainer._TrainingRun, path: Path) -> None:
        save(self, path)
        if self._step == step:
            raise Killed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer._TrainingRun, "_save", save_then_die)
        with pytest.raises(Killed):
            train(room, config, checkpoint=file)


RESUMED = {
    name: replace(
        preset(name),
        steps=40,
        gaussian_cap=2500,
        checkpoint_seconds=0.0,
        densify=replace(
            preset(name).densify,
            every=10,
            start=0.0,
            stop=1.0,
            capped=CappedConfig(gradient=0.0),
            adaptive=AdaptiveConfig(gradient=0.0, reset=0.4),
        ),
        robust=replace(preset(name).robust, start=0.3),
    )
    for name in PRESETS
}
RESUMED["mcmc"] = replace(RESUMED["nvsim"], densify=replace(RESUMED["nvsim"].densify, strategy="mcmc"))


@pytest.mark.parametrize("name", RESUMED)
def test_killed_and_resumed_training_is_bit_identical(room: SyntheticRoom, tmp_path: Path, name: str) -> None:
    file = tmp_path / "submap.ckpt"
    straight = train(room, RESUMED[name])
    train_killed(room, RESUMED[name], file, 23)
    events: list[Event] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "PREVIEW_SECONDS", 0.0)  # pictures made on the way must not matter either
        resumed = train(room, RESUMED[name], checkpoint=file, listen=events.append, preview=tmp_path / "p.jpg")
    assert any("continues from step 23" in getattr(e, "text", "") for e in events)
    assert is_same(straight, resumed)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="takes two threads")
def test_a_run_that_goes_on_with_another_number_of_threads_ends_as_well(room: SyntheticRoom, tmp_path: Path) -> None:
    config = replace(SMALL, steps=150, densify=replace(SMALL.densify, every=20))
    file, both, one = tmp_path / "submap.ckpt", replace(config, threads=2), replace(config, threads=1)
    straight = train(room, both)
    train_killed(room, both, file, 70)
    events: list[Event] = []
    changed = train(room, one, checkpoint=file, listen=events.append)
    assert any("threads: 1 instead of 2" in getattr(e, "text", "") for e in events)
    assert not is_same(straight, changed)
    everywhere = np.ones_like(room.views[0].floor)
    before, after = (np.mean([psnr(m, v, everywhere) for v in room.views]) for m in (straight, changed))
    assert after == pytest.approx(before, abs=0.05)


def test_a_checkpoint_of_other_inputs_is_ignored_with_a_warning(room: SyntheticRoom, tmp_path: Path) -> None:
    file, config = tmp_path / "submap.ckpt", replace(SMALL, steps=5)
    train(room, config, checkpoint=file)
    for views, other in ((room.views, replace(config, sh_degree=0)), (room.views[:-1], config)):
        events: list[Event] = []
        train_submap(views, room.cloud, room.floor, other, checkpoint=file, listen=events.append)
        assert [e for e in events if isinstance(e, Warning)]


def test_a_torn_checkpoint_is_ignored_with_a_warning(room: SyntheticRoom, tmp_path: Path) -> None:
    file, config = tmp_path / "submap.ckpt", replace(SMALL, steps=5)
    train(room, config, checkpoint=file)
    file.write_bytes(file.read_bytes()[:5000])
    events: list[Event] = []
    train(room, config, checkpoint=file, listen=events.append)
    assert [e for e in events if isinstance(e, Warning)]


@pytest.mark.parametrize("damage", ["shapes", "progress"])
def test_a_checkpoint_that_does_not_fit_lets_the_training_begin_anew(
    room: SyntheticRoom, tmp_path: Path, damage: str
) -> None:
    file, config = tmp_path / "submap.ckpt", replace(SMALL, steps=3)
    train(room, config, checkpoint=file)
    with np.load(file) as stored:
        arrays = {name: stored[name] for name in stored.files}
    if damage == "shapes":
        arrays["fit/sh.first"] = arrays["fit/sh.first"][:-1]
    else:
        about = json.loads(arrays["about"].tobytes())
        about["progress"]["order"] = [len(room.views)]
        arrays["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
    with open(file, "wb") as stream:
        np.savez(stream, **arrays)
    events: list[Event] = []
    model = train(room, config, checkpoint=file, listen=events.append)
    assert any(isinstance(e, Warning) and "Training starts again" in e.text for e in events)
    assert model.info["steps"] == 3


def test_preview_shows_image_model_alpha_and_background(room: SyntheticRoom) -> None:
    run = trainer._TrainingRun(room.views, room.cloud, room.floor, SMALL, 0, 0, lambda event: None)
    model, view = run.finish(None), room.views[2]
    picture = preview_of(run.fit, view)
    height, width = view.floor.shape
    drawn = render_model(model, view.camera)
    np.testing.assert_array_equal(picture[:height, :width], view.image)
    np.testing.assert_allclose(picture[:height, width:], 255 * np.clip(drawn.rgb, 0, 1), atol=1.5)
    np.testing.assert_allclose(picture[height:, :width, 1], 255 * drawn.alpha, atol=1.5)
    np.testing.assert_allclose(
        picture[height:, width:], 255 * np.clip(render_background(model, view.camera), 0, 1), atol=1.5
    )


def test_events_tell_progress_figures_and_picture(room: SyntheticRoom, tmp_path: Path) -> None:
    events: list[Event] = []
    train(room, replace(SMALL, steps=10), listen=events.append, preview=tmp_path / "preview.jpg", submap=3)
    last = [e for e in events if isinstance(e, Progress)][-1]
    assert (last.stage, last.done, last.total) == ("train", 10, 10)
    metrics = {e.name for e in events if isinstance(e, Metric) and e.submap == 3}
    assert metrics == {"loss", "psnr", "gaussians", "steps_per_second"}
    assert [e for e in events if isinstance(e, Preview)]
    assert (tmp_path / "preview.jpg").stat().st_size > 1000


def test_the_preview_shows_the_held_out_view_and_says_how_far_it_is_off(
    room: SyntheticRoom, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "PREVIEW_SECONDS", 0.0)
    monkeypatch.setattr(trainer, "PREVIEW_SHARE", 1e9)
    events: list[Event] = []
    kept = room.views[1]
    views = [v for v in room.views if v is not kept]
    short = replace(SMALL, steps=4, coarse_share=1.0)
    train_submap(
        views, room.cloud, room.floor, short, submap=3, listen=events.append, preview=tmp_path / "p.jpg", watched=kept
    )
    shown = [e for e in events if isinstance(e, Preview)]
    assert [(e.submap, e.step) for e in shown] == [(3, 1), (3, 2), (3, 3), (3, 4)]
    assert len({e.path for e in shown}) == 4 and f"held-out photo {kept.name}" in shown[0].caption
    picture = cv2.imread(shown[-1].path)
    height, width = kept.floor.shape  # at full size, also while it trains on smaller images
    assert picture.shape == (2 * height, 2 * width, 3)
    assert np.abs(picture[:height, :width, ::-1].astype(int) - kept.image).mean() < 6
    said = [e.value for e in events if isinstance(e, Metric) and e.name == "psnr_held_out"]
    off = picture[:height, :width].astype(float) - picture[:height, width:]
    assert len(said) == 4 and said[-1] == pytest.approx(10 * np.log10(255**2 / (off**2).mean()), abs=0.5)


def test_some_steps_of_this_run_and_of_the_one_before_are_kept(tmp_path: Path) -> None:
    image = np.zeros((8, 8, 3), np.uint8)

    def kept(run: str) -> list[int]:
        return sorted(int(p.stem.rpartition("_")[2]) for p in tmp_path.glob(f"preview_000_{run}_*.jpg"))

    (tmp_path / "preview_000_notes.jpg").write_bytes(b"somebody's own")
    for run in ("a0", "a1", "a2"):
        files = PreviewFiles(tmp_path / "preview_000.jpg", run)
        for step in range(10, 1010, 10):
            files.write(image, step)
    assert kept("a0") == [] and kept("a1") == kept("a2")
    steps = kept("a2")
    assert len(steps) == MOST_STEPS and steps[0] == 10 and steps[-1] == 1000
    gaps = np.diff(steps)
    assert gaps.max() <= 4 * gaps.min(), "they are spread over the whole run"
    files.write(image, 500)  # it went on from a checkpoint
    assert max(kept("a2")) == 500 and 10 in kept("a2")
    assert (tmp_path / "preview_000_notes.jpg").exists()


def test_a_run_that_goes_on_adds_to_the_images_it_had(room: SyntheticRoom, tmp_path: Path) -> None:
    names = []
    for steps in (4, 8):
        run = trainer._TrainingRun(
            room.views, room.cloud, room.floor, replace(SMALL, steps=steps), 0, 0, lambda event: None
        )
        run.attach(tmp_path / "c.ckpt", "key")
        run._name = "b5" if steps == 4 else run._name
        run.finish(tmp_path / "p.jpg")
        names.append(run._name)
    assert names == ["b5", "b5"]


def test_training_without_a_cloud_starts_from_the_views(room: SyntheticRoom) -> None:
    model = train_submap(room.views, None, room.floor, replace(SMALL, steps=10))
    assert len(model.gaussians) > 500


def test_no_views_is_a_sentence(room: SyntheticRoom) -> None:
    with pytest.raises(InputError, match="without images"):
        train_submap([], room.cloud, room.floor, SMALL)


def test_views_of_several_sizes_train_together(room: SyntheticRoom) -> None:
    views = [room.views[0].at_half_size(), *room.views[1:]]
    model = train_submap(views, room.cloud, room.floor, replace(SMALL, steps=12))
    assert np.isfinite(model.gaussians.means).all()


def test_the_cap_holds_through_a_whole_training(room: SyntheticRoom) -> None:
    counts: list[float] = []

    def listen(event: Event) -> None:
        if isinstance(event, Metric) and event.name == "gaussians":
            counts.append(event.value)

    growing = replace(SMALL.densify, every=5, start=0.0, capped=CappedConfig(growth=0.5, gradient=0.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "REPORT_SECONDS", 0.0)
        train(room, replace(SMALL, gaussian_cap=2200, densify=growing), listen=listen)
    assert max(counts) <= 2200
    assert counts[-1] > 1600


def test_measured_parts_are_numbers_that_make_up_the_step() -> None:
    figures = measure(gaussians=800, width=64, height=48, steps=3, warm_up=2)
    json.dumps(figures)
    assert figures["step_ms"] > 0
    assert sum(figures[f"{part}_ms"] for part in STEP_PARTS) <= 3 * figures["step_ms"]


def test_the_model_so_far_can_be_looked_at_while_training_goes_on(
    room: SyntheticRoom, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nvsim.splats.files import load_model

    monkeypatch.setattr(trainer, "PREVIEW_SECONDS", 0.0)
    seen: list[int] = []

    def listen(event: object) -> None:
        if isinstance(event, Preview) and (tmp_path / "live" / "model.json").is_file():
            seen.append(int(load_model(tmp_path / "live").info["steps"]))

    train_submap(
        room.views, room.cloud, room.floor, SMALL, listen=listen, preview=tmp_path / "p.jpg", live=tmp_path / "live"
    )
    assert seen and seen == sorted(seen) and seen[0] < SMALL.steps
