"""Submaps trained side by side, each in a process of its own with its share of the cores.

A child trains what it is told and sends its events through a pipe; the parent alone writes to the project's database,
and commits a submap when its child says that the model is saved. A child ends when its parent does, however that ends.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.events import Event, Progress
from nvsim.training.config import TrainingConfig

BASE_BYTES = 600 << 20
"""What a process takes before it holds any data: interpreter, libraries, compiled kernels."""
GAUSSIAN_BYTES = 1600
"""Per Gaussian of the cap: parameters, gradient, moments, what drawing and refining need."""
MEMORY_SHARE = 0.7
"""Of the free memory, at most this share is planned for."""


@dataclass(frozen=True)
class Task:
    """A submap to train with `threads` threads; `alone` while no other is trained."""

    submap: int
    threads: int
    alone: bool


@dataclass(frozen=True)
class Trained:
    """What a child says at the end of a task: `figures` as `submap_training.train` returns them."""

    submap: int
    seconds: float
    figures: dict[str, Any]


@dataclass(frozen=True)
class _Mistake:
    sentence: str
    is_ours: bool


def plan(submaps: Sequence[int], cores: int, at_once: int) -> list[Task]:
    """How many threads each submap gets. Depends on the whole list, never on what is left of it after a run that was
    cut off, as the number of threads decides the order of sums. What does not fill all `at_once` processes at the end
    of the list is trained with every core, one after another."""
    together = max(1, min(at_once, cores, len(submaps)))
    full = len(submaps) - len(submaps) % together
    alone = [together == 1 or i >= full for i in range(len(submaps))]
    return [Task(s, cores if a else cores // together, a) for s, a in zip(submaps, alone, strict=True)]


def needed_bytes(frames: int, pixels: int, config: TrainingConfig) -> int:
    """An upper estimate of what training one submap of `frames` images of `pixels` pixels takes."""
    views = frames * pixels * 4 * 5 // 4  # colours and mask, and both at half the size
    return BASE_BYTES + views + 200 * pixels + config.gaussian_cap * GAUSSIAN_BYTES


def fitting(free_bytes: int, bytes_each: int) -> int:
    """How many trainings fit into free memory, at least one."""
    return max(1, int(MEMORY_SHARE * free_bytes) // bytes_each)


def train_together(
    root: Path, config: TrainingConfig, tasks: Sequence[Task], at_once: int, begin: Callable[[int], None]
) -> Iterator[tuple[int, Event | Trained]]:
    """Trains in order, at most `at_once` at a time; yields (submap, event) as they come, and its `Trained` last. Calls
    `begin` with each submap before its child starts.

    The first kernels of the others wait until one child has made a step: by then it has compiled them, and the others
    read them from the cache. Raises InputError for what a child could not do; the others are stopped, and go on from
    their checkpoints another time.
    """
    waiting, running = list(tasks), dict[Connection, _Child]()
    warm = False
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                if running and (waiting[0].alone or any(c.task.alone for c in running.values())):
                    break
                begin(waiting[0].submap)
                child = _Child(root, config, waiting.pop(0))
                if warm or not running:
                    child.connection.send(None)
                running[child.connection] = child
            for connection in wait(list(running)):
                assert isinstance(connection, Connection)
                child = running[connection]
                message = child.receive()
                if isinstance(message, _Mistake):
                    raise (RuntimeError if message.is_ours else InputError)(message.sentence)
                if not warm and isinstance(message, Progress | Trained):
                    warm = True
                    for other in running.values():
                        if other is not child:
                            with contextlib.suppress(OSError):  # one that is gone is told of when it is listened to
                                other.connection.send(None)
                if isinstance(message, Trained):
                    child.end(patience=2.0)
                    del running[connection]
                yield child.task.submap, message
    finally:
        for child in running.values():
            child.end()


class _Child:
    def __init__(self, root: Path, config: TrainingConfig, task: Task) -> None:
        self.task = task
        context = multiprocessing.get_context("spawn")  # a fork of a process with thread pools may hang
        self.connection, theirs = context.Pipe()
        arguments = (root, replace(config, threads=task.threads), task.submap, theirs)
        self._process: BaseProcess = context.Process(target=_work, args=arguments, daemon=True)
        self._process.start()
        theirs.close()

    def receive(self) -> Event | Trained | _Mistake:
        try:
            message: Event | Trained | _Mistake = self.connection.recv()
            return message
        except (EOFError, OSError):
            self._process.join()
            return _Mistake(
                f"the training of submap {self.task.submap} was ended from outside (code {self._process.exitcode}), "
                "most often for want of memory; the same command goes on from there, with --at-once 1 in less memory.",
                False,
            )

    def end(self, patience: float = 0.0) -> None:
        """Stops the process if it has not ended after `patience` seconds."""
        self._process.join(patience)
        self._process.terminate()
        self._process.join(5)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self.connection.close()


def _work(root: Path, config: TrainingConfig, submap: int, connection: Connection) -> None:
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent answers for it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        from nvsim.project.project import Project
        from nvsim.project.stages.submap_training import train

        with Project.open(root) as project:
            connection.send(Trained(submap, *train(project, submap, config, connection.send, connection.recv)))
    except InputError as error:
        connection.send(_Mistake(str(error), False))
    except MemoryError:
        connection.send(_Mistake("out of memory; use --at-once 1, more submaps or fewer Gaussians.", False))
    except (BrokenPipeError, EOFError):
        pass  # nobody is left to tell
    except Exception:
        connection.send(_Mistake(traceback.format_exc(), True))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        with contextlib.suppress(OSError):
            parent.join()
        os._exit(1)
