"""Runs pieces of work on the machines of a Ray cluster, one task each, and restarts pieces whose worker was lost.

A task sends its messages through a stream that ends with the task. Ray's own retries are disabled (`max_retries=0`).
They would restart a task with the memory and the checkpoint of its first attempt, and without limit after kills for
lack of memory. This module restarts tasks instead.
"""

from __future__ import annotations

import contextlib
import pickle
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

from nvsim.cluster import ray_task
from nvsim.cluster.piece import (
    Message,
    MessageStream,
    Storage,
    StorageNotShared,
    WorkCall,
    WorkItem,
    WorkResult,
    pieces_at_once,
)
from nvsim.cluster.versions import versions
from nvsim.errors import InputError
from nvsim.events import Log, Progress, Warning, Worker

RETRIES = 2
"""Maximum number of restarts after consecutive losses. An attempt that got further than all previous ones resets the
count. A long training therefore finishes even on a cluster that removes machines every minute."""


@dataclass
class Attempt:
    """The state of a piece: its requested memory, consecutive losses, and progress."""

    piece: WorkItem
    bytes: int
    losses: int = 0
    worker: str = ""
    _done: int = 0
    _further: bool = False

    def record_message(self, message: Message) -> None:
        """Records the progress of the piece."""
        if isinstance(message, Progress) and message.done > self._done:
            self._done, self._further = message.done, True

    def prepare_restart(self, for_memory: bool, most_bytes: int) -> str:
        """Prepares the piece to restart, and returns a message about the loss.

        for_memory  the worker ran out of memory
        most_bytes  memory of the largest machine

        Raises InputError if the piece was restarted too often, or no machine has more memory.
        """
        self.losses = 1 if self._further else self.losses + 1
        self._further = False
        where = f" on {self.worker}" if self.worker else ""
        if for_memory and self.bytes >= most_bytes:
            raise InputError(
                f"The work on {self.piece.label} was killed{where} because it needed more than the requested "
                f"{_gb(self.bytes)} GB of memory, and no machine has more; use more submaps, fewer Gaussians or a "
                "larger machine."
            )
        if self.losses > RETRIES:
            raise InputError(
                f"The work on {self.piece.label} lost its worker {self.losses} times without progress{where}; check "
                "Ray's logs there. Run the same command again to continue from the last checkpoint."
            )
        if for_memory:
            self.bytes = min(2 * self.bytes, most_bytes)
            return (
                f"The work on {self.piece.label} was killed{where} because memory ran out; it restarts from its last "
                f"checkpoint with {_gb(self.bytes)} GB."
            )
        return f"The worker of {self.piece.label}{where} was lost; another continues from the last checkpoint."


def _gb(count: int) -> str:
    return f"{count / 1e9:.1f}"


_LOOK = 1.0  # seconds between two checks of the cluster while no messages come
_SLOW = 30.0  # seconds without a worker after which the user is told
_PATIENCE = 6.0  # seconds in which tasks must end when asked; then their processes are killed
_AHEAD = 1  # additional pieces submitted, so that an autoscaler sees that the cluster is too small


class RayPool:
    """The Ray cluster that this process is connected to."""

    remote = True

    def __init__(self, ray: ModuleType, storage: Storage = "auto") -> None:
        self._ray, self.storage = ray, storage
        ray.cloudpickle.register_pickle_by_value(ray_task)
        self._serve = ray.remote(ray_task.run_order)
        self._warned: set[str] = set()

    @property
    def machines(self) -> tuple[int, ...]:
        """The number of cores of each machine that can run tasks."""
        found = (int(node.get("CPU", 0)) for node in self._nodes())
        return tuple(cores for cores in found if cores)

    def run(self, pieces: Sequence[WorkItem], begin: Callable[[WorkItem], WorkCall], at_once: int = 0) -> MessageStream:
        """See `Executor.run`. Also raises InputError if a piece lost its worker too often, or a worker has another
        version of NVSim."""
        waiting = deque(Attempt(piece, piece.bytes) for piece in pieces)
        running: dict[Any, Attempt] = {}  # by the stream of the task
        idle_since, has_warned = time.monotonic(), False
        try:
            while waiting or running:
                most = at_once or self._room(pieces)
                while waiting and len(running) < most:
                    attempt = waiting.popleft()
                    running[self._submit(attempt, begin(attempt.piece))] = attempt
                for stream in self._streams_with_messages(running):
                    attempt = running[stream]
                    piece = attempt.piece
                    for kind, value in self._next_messages(stream):
                        if kind == "began":
                            attempt.worker = str(value)
                            yield piece, Worker(piece.stage, attempt.worker, piece.part, piece.label, "works")
                        elif kind == "warned":
                            if str(value) not in self._warned:
                                self._warned.add(str(value))
                                yield piece, Warning(str(value), piece.stage)
                        elif kind == "message":
                            message: Message = value
                            if isinstance(message, Log | Warning) and not message.stage:
                                message = replace(message, stage=piece.stage)
                            attempt.record_message(message)
                            yield piece, message
                        elif kind == "finished":
                            del running[stream]
                            yield piece, Worker(piece.stage, attempt.worker, piece.part, piece.label, "ended")
                            assert isinstance(value, WorkResult)
                            if isinstance(value.value, StorageNotShared):
                                yield piece, value.value
                                waiting.appendleft(attempt)
                            else:
                                yield piece, value
                        elif kind in ("lost", "memory"):
                            del running[stream]
                            if attempt.worker:
                                yield piece, Worker(piece.stage, attempt.worker, piece.part, piece.label, "lost")
                            sentence = attempt.prepare_restart(kind == "memory", self._most_bytes())
                            yield piece, Warning(sentence, piece.stage)
                            attempt.worker = ""
                            waiting.appendleft(attempt)
                        else:
                            raise (RuntimeError if kind == "broken" else InputError)(str(value))
                if any(a.worker for a in running.values()):
                    idle_since, has_warned = time.monotonic(), False
                elif running and not has_warned and time.monotonic() - idle_since > _SLOW:
                    has_warned = True
                    attempt = next(iter(running.values()))
                    yield attempt.piece, Log(self._why_idle(attempt), attempt.piece.stage)
        finally:
            self._end(list(running))

    def _submit(self, attempt: Attempt, order: WorkCall) -> Any:
        """The stream of a new task."""
        cores = min(attempt.piece.cores, max(self.machines, default=1))
        memory = min(attempt.bytes, self._most_bytes())
        task = self._serve.options(
            num_cpus=cores, memory=memory, max_retries=0, num_returns="streaming", name=attempt.piece.label
        )
        return task.remote(pickle.dumps((order.function, order.arguments)), attempt.piece.cores, versions())

    def _streams_with_messages(self, running: dict[Any, Attempt]) -> list[Any]:
        """The streams that have a message; may be empty after a short wait."""
        if not running:
            return []
        self._ray.wait(list(running), num_returns=1, timeout=_LOOK)
        return list(self._ray.wait(list(running), num_returns=len(running), timeout=0)[0])

    def _next_messages(self, stream: Any) -> list[tuple[str, Any]]:
        """The next messages of a stream: pairs as `ray_task.serve` yields them, or ("lost", "") or ("memory", "")."""
        errors = self._ray.exceptions
        try:
            found: list[tuple[str, Any]] = self._ray.get(next(stream))
            return found
        except StopIteration:  # the stream ended without a final message
            return [("lost", "")]
        except errors.OutOfMemoryError:
            return [("memory", "")]
        except errors.TaskCancelledError:
            return [("mistake", "A user canceled a task on the cluster; run the same command again to continue.")]
        except errors.RayTaskError as error:
            if isinstance(error.cause, MemoryError):
                return [("memory", "")]
            return [("broken", str(error))]
        except errors.RayError:  # the process, its machine, or a message was lost
            return [("lost", "")]

    def _end(self, streams: list[Any]) -> None:
        """Asks tasks to end, and kills the processes that do not."""
        for stream in streams:
            with contextlib.suppress(Exception):
                self._ray.cancel(stream)
        until = time.monotonic() + _PATIENCE
        while streams and time.monotonic() < until:
            for stream in list(streams):
                with contextlib.suppress(Exception):
                    if not self._ray.wait([stream], timeout=0.1)[0]:
                        continue
                    self._ray.get(next(stream))
                    continue
                streams.remove(stream)
        for stream in streams:
            with contextlib.suppress(Exception):
                self._ray.cancel(stream, force=True)

    # The cluster ------------------------------------------------------------------------------------------------

    def _nodes(self) -> list[dict[str, float]]:
        return [node["Resources"] for node in self._ray.nodes() if node["Alive"]]

    def _most_bytes(self) -> int:
        return int(max((node.get("memory", 0) for node in self._nodes()), default=0))

    def _room(self, pieces: Sequence[WorkItem]) -> int:
        """The number of tasks to submit at once: all that have room, and a few that wait."""
        return max(1, pieces_at_once(self.machines, max(p.cores for p in pieces))) + _AHEAD

    def _why_idle(self, attempt: Attempt) -> str:
        cores, gigabytes = attempt.piece.cores, attempt.bytes / 1e9
        return (
            f"No worker has started {attempt.piece.label} for {_SLOW:.0f} s: it needs {cores} free cores and "
            f"{gigabytes:.1f} GB on one machine; the cluster's largest has {max(self.machines, default=0)} cores and "
            f"{self._most_bytes() / 1e9:.1f} GB."
        )
