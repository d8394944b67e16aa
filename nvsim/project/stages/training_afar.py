"""Submaps trained by workers that may be on other machines.

Where they see the project, they get its path, and write checkpoint and model where a process of this machine would.
Where they do not, a submap's images, masks, floor and cloud travel to them, and its checkpoints, images and model come
back as files. Either way the parent checks the model against the hashes that its worker took, and it alone writes to
the project's database.
"""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from nvsim.cluster.config import Storage
from nvsim.cluster.piece import Caller, Order, Piece, SentFile, Unseen
from nvsim.cluster.storage import Witness
from nvsim.errors import InputError
from nvsim.events import Event, Listener, Log, Preview
from nvsim.files import atomic
from nvsim.files.regular import read_bytes
from nvsim.project import results
from nvsim.project.afar import ProjectAfar
from nvsim.project.layout import model_name
from nvsim.project.project import Project
from nvsim.project.results import remove_folder
from nvsim.project.stages.submap_training import Inputs, Trained, fit, inputs_of, train
from nvsim.training.config import TrainingConfig

CHECKPOINT, PREVIEW, MODEL = "checkpoint", "preview", "model/"
"""What files that are sent are called; behind the last the name of a file of the model."""
_SETTLING = 30.0  # seconds until what another machine wrote is to be seen on a shared storage


@dataclass(frozen=True)
class ModelFiles:
    """What a worker says at the end: the SHA-256 of each file of the model by its name."""

    trained: Trained
    hashes: dict[str, str]


class TrainingAfar:
    """Gives out the submaps of a project, and takes in what comes back."""

    def __init__(self, project: Project, config: TrainingConfig, storage: Storage, listen: Listener) -> None:
        self._project, self._config, self._storage, self._listen = project, config, storage, listen
        first = project.need_capture().frames[0].image_path
        self._witness = Witness.left_in(project.layout.checkpoints, first)
        self._arriving: set[int] = set()

    def close(self) -> None:
        self._witness.remove()

    def order(self, piece: Piece) -> Order:
        """What a worker gets to train a submap, from its checkpoint where there is one."""
        config, project = dataclasses.replace(self._config, threads=piece.cores), self._project
        checkpoint_path = project.layout.checkpoint(piece.part)
        for left in checkpoint_path.parent.glob(f".{checkpoint_path.stem}-*"):  # what a lost worker was writing
            atomic.remove(left)
        if self._storage != "sent":
            witness = None if self._storage == "shared" else self._witness
            return Order(train_in_place, (ProjectAfar.of(project), piece.part, config, witness))
        self._arriving.discard(piece.part)
        checkpoint = read_bytes(checkpoint_path) if checkpoint_path.is_file() else None
        inputs = pickle.dumps(inputs_of(project, piece.part, config))
        return Order(train_elsewhere, (inputs, piece.part, config, checkpoint))

    def unseen(self, found: Unseen) -> None:
        """From now on what workers need is sent."""
        if self._storage == "auto":
            self._listen(Log(f"{found.why}; what they need is sent to the workers.", "train"))
        self._storage = "sent"

    def receive(self, piece: Piece, file: SentFile) -> Event | None:
        """Puts a file where it belongs; an event where it is to be told of. Raises InputError where it is damaged or
        the disk refuses."""
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
            raise InputError(f"A worker sent a file {file.name!r}, which no training makes; look who it is.")
        folder = self._model(piece.part)
        if piece.part not in self._arriving:  # what a kill left of another
            self._arriving.add(piece.part)
            remove_folder(folder)
        atomic.write_bytes(atomic.make_folder(folder) / name, file.data)
        return None

    def check(self, piece: Piece, found: ModelFiles) -> None:
        """Raises InputError where the model on disk is not what the worker made."""
        folder = self._model(piece.part)
        until = time.monotonic() + _SETTLING
        while wrong := _differing(folder, found.hashes):
            if time.monotonic() > until:
                raise InputError(
                    f"{folder / wrong} is not what the worker of {piece.words} wrote; see whether its machine has "
                    "this folder, or use --storage sent."
                )
            time.sleep(0.5)

    def _model(self, submap: int) -> Path:
        made = results.made_at(self._project.connection, "train", submap)
        return self._project.layout.root / made[model_name(submap)]


def train_in_place(
    caller: Caller, afar: ProjectAfar, index: int, config: TrainingConfig, witness: Witness | None
) -> ModelFiles | Unseen:
    """Trains a submap in the project itself."""
    missing = "" if witness is None else witness.missing()
    if missing:
        return Unseen(missing)
    from nvsim.training.compilation import compile_ahead

    compile_ahead(caller.tell)
    with afar.open() as project:
        trained = train(project, index, config, caller.tell, caller.ready)
        place = results.made_at(project.connection, "train", index)[model_name(index)]
        return ModelFiles(trained, _hashes(project.layout.root / place))


def train_elsewhere(
    caller: Caller, inputs: bytes, index: int, config: TrainingConfig, checkpoint: bytes | None
) -> ModelFiles:
    """Trains a submap from what was sent, in a folder of its own, and sends back what it makes."""
    from nvsim.training.compilation import compile_ahead
    from nvsim.training.paced import Paced

    compile_ahead(caller.tell)
    needed: Inputs = pickle.loads(inputs)
    with tempfile.TemporaryDirectory(prefix="nvsim-submap-") as name:
        folder = Path(name)
        paths = {CHECKPOINT: folder / "checkpoint.ckpt", PREVIEW: folder / "preview.jpg"}
        if checkpoint is not None:
            paths[CHECKPOINT].write_bytes(checkpoint)
        sent = _stamp(paths[CHECKPOINT])
        # What a checkpoint costs on the way to the command, nobody here sees: not more often than was asked for.
        pace = Paced(time.monotonic(), config.checkpoint_seconds)

        def tell(event: Event) -> None:
            nonlocal sent
            if isinstance(event, Preview):
                caller.send(PREVIEW, paths[PREVIEW].read_bytes())
                return
            caller.tell(event)
            began, now = time.monotonic(), _stamp(paths[CHECKPOINT])
            if now != sent and pace.is_due(began):
                sent = now
                caller.send(CHECKPOINT, paths[CHECKPOINT].read_bytes())
                pace.done(began, time.monotonic())

        started = time.monotonic()
        model = folder / "model"
        figures = fit(needed, index, config, model, tell, paths[CHECKPOINT], paths[PREVIEW], None)
        hashes = _hashes(model)
        for name in sorted(hashes, key=lambda n: n == "model.json"):  # which names the others
            caller.send(MODEL + name, (model / name).read_bytes())
        return ModelFiles(Trained(time.monotonic() - started, figures), hashes)


def _stamp(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0


def _hashes(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir()) if p.is_file()}


def _differing(folder: Path, hashes: dict[str, str]) -> str:
    """The name of a file that is not as its hash says, "" where all are."""
    for name, expected in hashes.items():
        try:
            data = (folder / name).read_bytes()
        except OSError:
            return name
        if hashlib.sha256(data).hexdigest() != expected:
            return name
    return ""
