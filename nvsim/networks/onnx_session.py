"""Open a user's network with onnxruntime in a separate process.

Models can share a session: a file that gives floor and normals runs once per image. The second model that needs its
outputs gets the cached results.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np
import psutil
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.kernel_threads import allowed_threads
from nvsim.networks.external_data import check_external_data
from nvsim.networks.onnx_server import (
    LoadedModel,
    LoadRequest,
    Node,
    OnnxServer,
    RunFailure,
    RunRequest,
    import_onnxruntime,
)
from nvsim.processes.child import Child, Limits

Provider = Literal["auto", "cpu", "cuda"]
_PROVIDERS = {
    "auto": ("CUDAExecutionProvider", "CPUExecutionProvider"),
    "cpu": ("CPUExecutionProvider",),
    "cuda": ("CUDAExecutionProvider",),
}
TYPES: dict[str, Any] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(uint8)": np.uint8,
    "tensor(bool)": np.bool_,
}
"""onnxruntime's name of a tensor type -> the NumPy type of a network input."""
Signature = tuple[tuple[Node, ...], tuple[Node, ...]]
"""Inputs and outputs of a file."""
_SECONDS, _SECONDS_PER_MB = 10.0, 1.0
"""Time limit for loading a file: a constant, plus a term per megabyte. The limit of a run also grows with the megabytes
of its inputs. Common networks use a tenth of it on two busy cores."""
_MEMORY, _MEMORY_PER_BYTE, _MEMORY_PER_INPUT = 4 << 30, 10, 500
"""Memory limit in bytes: a constant, plus factors for each byte of the file and of its inputs."""
_SHARE = 0.8
"""Share of the free memory, an upper limit for any file."""


class DoesNotRun(InputError):
    """A network rejects its inputs. `reason` is the reason in the words of onnxruntime."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path} is not a network that runs ({reason}); export it again.")
        self.reason = reason


class Session:
    """The network in the file at `path`, on the first of `providers` that can run it. It may be used from any thread;
    runs are sequential.

    inputs, outputs  of the file
    metadata         properties stored in the file
    provider         the provider in use

    Raises InputError if the file cannot be loaded, refers to weight files that may not be opened, or needs too much
    time or memory.
    """

    def __init__(self, path: Path, providers: Sequence[str] = ("CPUExecutionProvider",)) -> None:
        self._path, self._bytes = path, check_external_data(path)
        self._child: Child[LoadRequest | RunRequest, Any] = Child(
            OnnxServer, str(path), "export it again, or use another network"
        )
        weakref.finalize(self, self._child.release)
        found = self._child.ask(LoadRequest(path, tuple(providers), allowed_threads()), self._limits(0))
        if isinstance(found, RunFailure):
            raise InputError(f"{path} cannot be loaded as an ONNX network ({found.reason}); export it again.")
        loaded: LoadedModel = found
        self.inputs, self.outputs, self.metadata = loaded.inputs, loaded.outputs, loaded.metadata
        self.provider = loaded.provider
        if loaded.provider not in providers:
            raise InputError(f"{path} cannot run on {providers[0]} here; install its libraries, or use the CPU.")

    def run(self, names: Sequence[str] | None, feed: Mapping[str, np.ndarray[Any, Any]]) -> list[Any]:
        """The outputs `names` (None for all) as a list of arrays, with the shapes in `outputs`.

        `feed` holds one array per input, by name, with the shape in `inputs`. Raises DoesNotRun if the network rejects
        its inputs. Raises InputError if it crashes or needs too much time or memory."""
        limits = self._limits(sum(value.nbytes for value in feed.values()))
        found = self._child.ask(RunRequest(None if names is None else list(names), dict(feed)), limits)
        if isinstance(found, RunFailure):
            raise DoesNotRun(self._path, found.reason)
        return list(found)

    def _limits(self, given: int) -> Limits:
        """Limits for the file and `given` bytes of inputs."""
        memory = _MEMORY + _MEMORY_PER_BYTE * self._bytes + _MEMORY_PER_INPUT * given
        free = round(_SHARE * psutil.virtual_memory().available)
        return Limits(_SECONDS + _SECONDS_PER_MB * self._bytes / 1e6 * (1 + given / 1e6), min(memory, free))

    @property
    def signature(self) -> Signature:
        return self.inputs, self.outputs


def providers(wanted: Provider) -> list[str]:
    """The onnxruntime providers to use, best first. Raises InputError if none of them is available."""
    here = import_onnxruntime().get_available_providers()
    found = [name for name in _PROVIDERS[wanted] if name in here]
    if not found:
        raise InputError(
            f"This onnxruntime cannot run on {wanted if wanted != 'auto' else 'cpu or cuda'} (it has "
            f"{', '.join(here) or 'nothing'}); install onnxruntime{'-gpu' if wanted == 'cuda' else ''}."
        )
    return found


Feed = Mapping[str, NDArray[Any]]
_KEPT = 4  # cached results; the same number of images may be processed in parallel


class SharedFile:
    def __init__(self, session: Session) -> None:
        self.session = session
        self._askers: WeakKeyDictionary[object, tuple[str, ...]] = WeakKeyDictionary()
        self._answers: deque[tuple[Feed, dict[str, Any]]] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()

    def will_ask(self, asker: object, names: Sequence[str]) -> None:
        """Register that `asker` runs this file for the outputs `names`, until it is garbage-collected."""
        with self._lock:
            self._askers[asker] = (*self._askers.get(asker, ()), *names)

    def run(self, names: Sequence[str], feed: Feed) -> list[Any]:
        """The outputs `names` as a list of arrays; `feed` holds one array per input, by name. Shapes are those of the
        file's inputs and outputs."""
        with self._lock:
            askers, answers = list(self._askers.values()), list(self._answers)
        if len(askers) < 2:
            return self.session.run(names, feed)
        wanted = list(dict.fromkeys(name for asked in askers for name in asked))
        for before, found in answers:
            if all(name in found for name in names) and _are_equal(before, feed):
                return [found[name] for name in names]
        whole = dict(zip(wanted, self.session.run(wanted, feed), strict=True))
        with self._lock:
            self._answers.append((feed, whole))
        return [whole[name] for name in names]


_opened: WeakValueDictionary[tuple[Any, ...], SharedFile] = WeakValueDictionary()
_opening = threading.Lock()


def shared_file(path: Path, providers: Sequence[str]) -> SharedFile:
    """The opened file at `path`. A file that is open already is shared if it has not changed on disk. Raises InputError
    if it cannot be loaded."""
    with _opening:
        key = _key(path, providers)
        found = None if key is None else _opened.get(key)
        if found is None:
            found = SharedFile(Session(path, providers))
            if key is not None:
                _opened[key] = found
        return found


def _key(path: Path, providers: Sequence[str]) -> tuple[Any, ...] | None:
    try:
        about = os.stat(path)
    except OSError:
        return None  # opening the file reports the error
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, tuple(providers)


def _are_equal(a: Feed, b: Feed) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)
