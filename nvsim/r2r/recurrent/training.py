"""Trains the recurrent agent into a folder: imitation, then A2C if requested.

The best agent on the held-out tasks is kept, and an interrupted training resumes. `curves.jsonl` has the training
curves: events as JSON lines, as `--json` prints them.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Metric, Progress, from_json, to_json
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error, make_folder
from nvsim.files.opening import plain_file, read_text
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig
from nvsim.r2r.recurrent.dataset import Dataset
from nvsim.r2r.recurrent.saved_agent import (
    ABOUT,
    WEIGHTS,
    AgentDescription,
    read_agent_description,
    read_model,
    write_agent_description,
    write_weights,
)
from nvsim.r2r.recurrent.trainer import Trainer
from nvsim.training.checkpoint import Checkpoint, load, save

FILE = "curves.jsonl"
STAGE = "r2r train"
_LARGEST = 1 << 28
CHECKPOINT = "training.npz"
_SAID_EVERY = 10  # batches


class Curves:
    """Appends every metric to the file and sends it to the listener. Metrics after `step`, from an interrupted run, are
    dropped first. Raises InputError if writing fails.
    """

    def __init__(self, folder: Path, step: int, listen: Listener) -> None:
        self._path, self._listen = folder / FILE, listen
        kept = [metric for metric in read_curves(folder) if metric.step <= step] if step else []
        atomic.write_text(self._path, "".join(to_json(metric) + "\n" for metric in kept))

    def add(self, name: str, value: float, step: int) -> None:
        """Appends the value of a metric after `step` batches. Raises InputError if writing fails."""
        metric = Metric(STAGE, name, value, step)
        try:
            with open(plain_file(self._path, os.O_WRONLY | os.O_APPEND), "a", encoding="utf-8") as file:
                file.write(to_json(metric) + "\n")
        except OSError as error:
            raise as_input_error(self._path, error) from error
        self._listen(metric)


def read_curves(folder: Path) -> list[Metric]:
    """Reads the metrics of a training and ignores incomplete lines. Raises InputError if the file is unreadable."""
    path = folder / FILE
    if not path.is_file():
        return []
    found = []
    for line in read_text(path, "a file of training curves", "remove it", _LARGEST).splitlines():
        try:
            event = from_json(line)
        except ValueError:
            continue
        if isinstance(event, Metric):
            found.append(event)
    return found


def train_agent(
    dataset: Dataset, model: ModelConfig, learning: LearningConfig, out: Path, listen: Listener
) -> dict[str, Any]:
    """Trains an agent and writes the best one to the folder `out`. Resumes an interrupted training there.

    Returns the description of the training. Raises InputError if data is missing, or `out` has an agent with other data
    or options.
    """
    with _threads(learning.threads):
        trainer = Trainer(dataset, model, learning)
        at = _TrainingFolder(trainer, model, out, _fingerprint(trainer, model, learning))
        make_folder(out)
        if (out / ABOUT).exists():
            before = read_agent_description(out)
            if before.trained.get("key") != at.key:
                raise InputError(
                    f"{out} has an agent with other data or options; choose another --out, or remove the folder."
                )
            if before.finished:
                listen(Log(f"the agent in {out} is already trained", STAGE))
                return dict(before.trained)
        elif foreign := [name for name in (WEIGHTS, FILE, CHECKPOINT) if (out / name).exists()]:
            raise InputError(f"{out / foreign[0]} exists, but belongs to no agent; choose another --out.")
        checkpoint = load(out / CHECKPOINT, at.key) if (out / CHECKPOINT).exists() else None
        if checkpoint is None:
            at.write(finished=False)  # first, so that a later run recognizes the folder as an agent
            write_weights(out, trainer.model)
        else:
            trainer.restore(checkpoint)
            listen(Log(f"resumes after batch {trainer.at.step}", STAGE))
        _loop(at, Curves(out, trainer.at.step, listen), listen)
        trained = at.write(finished=True)
        (out / CHECKPOINT).unlink(missing_ok=True)
    held = trained["held_out"]
    summary = f"{held['success']:.1%} of {held['episodes']} held-out instructions succeed, after {held['step']} batches"
    listen(Done(STAGE, summary, {"written": str(out), **trained}))
    return trained


@dataclass(frozen=True, eq=False)
class _TrainingFolder:
    """A training and its folder. `key` is a hash of all inputs."""

    trainer: Trainer
    model: ModelConfig
    out: Path
    key: str

    def write(self, finished: bool) -> dict[str, Any]:
        """Writes the description of the agent to the folder and returns that of its training."""
        t = self.trainer
        best = {"success": t.at.best[0], "spl": t.at.best[1], "step": t.at.best_step, "episodes": len(t.out)}
        trained = {
            "key": self.key,
            "held_out": best,
            "batches": t.at.step,
            "episodes": len(t.train),
            "scans": sorted({episode.task.scan for episode in t.train}),
            "scans_held_out": sorted({task.scan for task in t.out_tasks}),
            "parameters": sum(p.numel() for p in t.model.parameters()),
            "learning": asdict(t.learning),
        }
        about = AgentDescription(self.model, t.words, t.world.width, t.backbone, t.learning.steps, trained, finished)
        write_agent_description(self.out, about)
        return trained


def _loop(of: _TrainingFolder, curves: Curves, listen: Listener) -> None:
    trainer, learning, at = of.trainer, of.trainer.learning, of.trainer.at
    while True:
        if at.step >= at.last or at.tries >= learning.patience:
            if at.phase or not learning.a2c_iterations:
                return
            trainer.begin_a2c(read_model(of.out, read_agent_description(of.out)))
            listen(Log(f"starts A2C after batch {at.step}", STAGE))
        at.loss, at.losses = at.loss + trainer.batch(), at.losses + 1
        ends = at.step == at.last
        if at.step % _SAID_EVERY == 0 or ends:
            curves.add("loss", at.loss / at.losses, at.step)
            at.loss, at.losses = 0.0, 0
            words = f"{at.best[0]:.1%} success on held-out tasks" if at.best_step else ""
            listen(Progress(STAGE, at.step, at.last + (0 if at.phase else learning.a2c_iterations), words))
        if at.step % learning.evaluate_every == 0 or ends:
            found = trainer.try_out()
            curves.add("success", found[0], at.step)
            curves.add("spl", found[1], at.step)
            at.tries += 1
            if found > at.best:
                at.best, at.best_step, at.tries = found, at.step, 0
                write_weights(of.out, trainer.model)
                of.write(finished=False)
        if at.step % learning.checkpoint_every == 0:
            save(of.out / CHECKPOINT, Checkpoint(at.step, trainer.arrays(), trainer.progress), of.key)


def _fingerprint(trainer: Trainer, model: ModelConfig, learning: LearningConfig) -> str:
    """Returns a hash of options and data, without the number of threads and the interval of checkpoints."""
    digest = hashlib.blake2b(digest_size=16)
    settings = asdict(model), {**asdict(learning), "threads": 0, "checkpoint_every": 0}
    episodes = [(e.task.heading, e.words, e.path) for part in (trainer.train, trainer.out) for e in part]
    digest.update(json.dumps([1, settings, trainer.words.words, trainer.world.keys, episodes]).encode())
    w = trainer.world
    for array in (w.target, w.heading, w.elevation, w.distance, w.seen, w.features):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@contextlib.contextmanager
def _threads(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count or before)
    try:
        yield
    finally:
        torch.set_num_threads(before)
