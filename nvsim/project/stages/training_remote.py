"""Trains submaps on workers that may be on other machines.

If the workers can read the project, they get its path and write checkpoint and model into the project. Otherwise, they
get the images, masks, floor and cloud of a submap, and send back its checkpoints, previews and model as files. In both
cases, the parent compares the model with the hashes of the worker. Only the parent writes to the project's database.
"""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from nvsim.cluster.piece import Caller, SentFile, Storage, StorageNotShared, WorkCall, WorkItem
from nvsim.cluster.storage import StorageProbe
from nvsim.errors import InputError
from nvsim.events import Event, Listener, Log, Preview
from nvsim.files import atomic
from nvsim.files.opening import read_bytes
from nvsim.project.layout import model_name
from nvsim.project.project import Project
from nvsim.project.stages.remote import ProjectSnapshot
from nvsim.project.stages.submap_training import TrainedSubmap, TrainingInputs, fit, inputs_of, train
from nvsim.project.state.results import remove_folder
from nvsim.training.config import TrainingConfig

CHECKPOINT, PREVIEW, MODEL = "checkpoint", "preview", "model/"
"""Names of sent files; MODEL is a prefix before the name of a model file."""
_SETTLING = 30.0  # seconds until files of another machine are visible on shared storage


@dataclass(frozen=True)
class ModelFiles:
    """The final message of a worker: the figures of the training, and the SHA-256 of each model file by name."""

    trained: TrainedSubmap
    hashes: dict[str, str]


class RemoteTraining:
    """Sends the submaps of a project to workers, and stores the files that they return."""

    def __init__(self, project: Project, config: TrainingConfig, storage: Storage, listen: Listener) -> None:
        self._project, self._config, self._storage, self._listen = project, config, storage, listen
        first = project.need_capture().frames[0].image_path
        self._probe = StorageProbe.create_in(project.layout.checkpoints, first)
        self._arriving: set[int] = set()

    def close(self) -> None:
        self._probe.remove()

    def order(self, piece: WorkItem) -> WorkCall:
        """The order for a worker to train a submap, from its checkpoint if there is one."""
        config, project = dataclasses.replace(self._config, threads=piece.cores), self._project
        checkpoint_path = project.layout.checkpoint(piece.part)
        for left in checkpoint_path.parent.glob(f".{checkpoint_path.stem}-*"):  # incomplete files of a lost worker
            atomic.remove(left)
        if self._storage != "sent":
            probe = None if self._storage == "shared" else self._probe
            return WorkCall(train_in_place, (ProjectSnapshot.of(project), piece.part, config, probe))
        self._arriving.discard(piece.part)
        checkpoint = read_bytes(checkpoint_path) if checkpoint_path.is_file() else None
        inputs = pickle.dumps(inputs_of(project, piece.part, config))
        return WorkCall(train_elsewhere, (inputs, piece.part, config, checkpoint))

    def send_all_inputs(self, found: StorageNotShared) -> None:
        """Sends all inputs to the workers from now on, because a worker cannot read the project."""
        if self._storage == "auto":
            self._listen(Log(f"{found.reason}; NVSim sends the inputs to the workers.", "train"))
        self._storage = "sent"

    def receive(self, piece: WorkItem, file: SentFile) -> Event | None:
        """Stores a file at its place. Returns an event if listeners need one. Raises InputError if the file is damaged
        or not part of a training, or the disk reports an error."""
        file.check()
        layout = self._project.layout
        if file.name == PREVIEW:
            path = layout.preview(piece.part)
            atomic.write_bytes(atomic.make_folder(path.parent) / path.name, file.data)
            return Preview("train", str(path), f"submap {piece.part}: image, model; alpha, background")
        if file.name == CHECKPOINT:
            path = layout.checkpoint(piece.part)
            atomic.write_bytes(atomic.make_folder(path.parent) / path.name, file.data)
            return None
        name = file.name.removeprefix(MODEL)
        if name == file.name or Path(name).name != name or name.startswith("."):
            raise InputError(f"A worker sent the unexpected file {file.name!r}; check who runs this worker.")
        folder = self._model(piece.part)
        if piece.part not in self._arriving:  # remove files of an earlier, killed training
            self._arriving.add(piece.part)
            remove_folder(folder)
        atomic.write_bytes(atomic.make_folder(folder) / name, file.data)
        return None

    def check(self, piece: WorkItem, found: ModelFiles) -> None:
        """Raises InputError if the model on disk differs from the one that the worker made."""
        folder = self._model(piece.part)
        until = time.monotonic() + _SETTLING
        while wrong := _differing(folder, found.hashes):
            if time.monotonic() > until:
                raise InputError(
                    f"{folder / wrong} is not what the worker of {piece.label} wrote; check that its machine shares "
                    "this folder, or use --storage sent."
                )
            time.sleep(0.5)

    def _model(self, submap: int) -> Path:
        made = self._project.stage_results().made_at("train", submap)
        return self._project.layout.root / made[model_name(submap)]


def train_in_place(
    caller: Caller, snapshot: ProjectSnapshot, index: int, config: TrainingConfig, probe: StorageProbe | None
) -> ModelFiles | StorageNotShared:
    """Trains a submap in the project on shared storage."""
    missing = "" if probe is None else probe.missing()
    if missing:
        return StorageNotShared(missing)
    from nvsim.training.compilation import compile_ahead

    compile_ahead(caller.send_event)
    with snapshot.open() as project:
        trained = train(project, index, config, caller.send_event, caller.wait_for_kernels)
        place = project.stage_results().made_at("train", index)[model_name(index)]
        return ModelFiles(trained, _hashes(project.layout.root / place))


def train_elsewhere(
    caller: Caller, inputs: bytes, index: int, config: TrainingConfig, checkpoint: bytes | None
) -> ModelFiles:
    """Trains a submap from sent inputs in a temporary folder, and sends back the files."""
    from nvsim.training.checkpoint import RateLimiter
    from nvsim.training.compilation import compile_ahead

    compile_ahead(caller.send_event)
    needed: TrainingInputs = pickle.loads(inputs)
    with tempfile.TemporaryDirectory(prefix="nvsim-submap-") as name:
        folder = Path(name)
        paths = {CHECKPOINT: folder / "checkpoint.ckpt", PREVIEW: folder / "preview.jpg"}
        if checkpoint is not None:
            paths[CHECKPOINT].write_bytes(checkpoint)
        sent = _stamp(paths[CHECKPOINT])
        # The worker cannot measure the cost of sending a checkpoint, so it follows the requested interval.
        pace = RateLimiter(time.monotonic(), config.checkpoint_seconds)

        def send_event(event: Event) -> None:
            nonlocal sent
            if isinstance(event, Preview):
                caller.send(PREVIEW, paths[PREVIEW].read_bytes())
                return
            caller.send_event(event)
            began, now = time.monotonic(), _stamp(paths[CHECKPOINT])
            if now != sent and pace.is_due(began):
                sent = now
                caller.send(CHECKPOINT, paths[CHECKPOINT].read_bytes())
                pace.record_run(began, time.monotonic())

        started = time.monotonic()
        model = folder / "model"
        figures = fit(needed, index, config, model, send_event, paths[CHECKPOINT], paths[PREVIEW], None)
        hashes = _hashes(model)
        for name in sorted(hashes, key=lambda n: n == "model.json"):  # last, because it names the other files
            caller.send(MODEL + name, (model / name).read_bytes())
        return ModelFiles(TrainedSubmap(time.monotonic() - started, figures), hashes)


def _stamp(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0


def _hashes(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir()) if p.is_file()}


def _differing(folder: Path, hashes: dict[str, str]) -> str:
    """The name of a file that does not match its hash, "" if all match."""
    for name, expected in hashes.items():
        try:
            data = (folder / name).read_bytes()
        except OSError:
            return name
        if hashlib.sha256(data).hexdigest() != expected:
            return name
    return ""
