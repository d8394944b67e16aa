"""A piece of work for a separate process, its messages, its threads, and the interface of an executor."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from nvsim.errors import InputError
from nvsim.events import Event


@dataclass(frozen=True)
class WorkItem:
    """A piece of work that runs in its own process.

    stage      the stage that the piece belongs to
    part       its number in the stage: that of the submap, or of the first frame
    label      the piece as users read it: "submap 3"
    cores      number of threads
    bytes      expected memory
    exclusive  on one machine, no other piece runs during this one
    """

    stage: str
    part: int
    label: str
    cores: int
    bytes: int
    exclusive: bool = False


@dataclass(frozen=True)
class SentFile:
    """A file from a worker: its name, its content, and the SHA-256 that the worker computed."""

    name: str
    data: bytes
    sha256: str

    @staticmethod
    def of(name: str, data: bytes) -> SentFile:
        return SentFile(name, data, hashlib.sha256(data).hexdigest())

    def check(self) -> None:
        """Raises InputError if the content was damaged on the way from the worker."""
        if hashlib.sha256(self.data).hexdigest() != self.sha256:
            raise InputError(
                f"{self.name} was damaged on its way from a worker; run the same command again to continue."
            )


@dataclass(frozen=True)
class WorkResult:
    """The last message of a piece: the return value of its work."""

    value: Any


@dataclass(frozen=True)
class StorageNotShared:
    """Returned by work that cannot read the files of its caller: the missing path. The piece must start again with
    its files sent."""

    path: str

    @property
    def reason(self) -> str:
        """The reason in words, as the beginning of a message."""
        return f"A machine of the cluster cannot read {self.path}"


Message = Event | SentFile | StorageNotShared | WorkResult
MessageStream = Generator[tuple[WorkItem, Message], None, None]
"""The messages of all pieces in order of arrival. Closing the generator stops the pieces."""


class Caller(Protocol):
    """The process that ordered a piece, as its work sees it."""

    def send_event(self, event: Event) -> None:
        """Sends an event."""

    def send(self, name: str, data: bytes) -> None:
        """Sends a file."""

    def wait_for_kernels(self) -> None:
        """Reports that all input is read, and returns when the first kernel may run."""


Work = Callable[..., object]
"""A module-level function work(caller, *given), which another process can import and run."""


@dataclass(frozen=True)
class WorkCall:
    """The work of a piece: the function, and its arguments after the caller."""

    function: Work
    arguments: tuple[object, ...]


Storage = Literal["auto", "shared", "sent"]
"""How pieces on other machines read files, see `ClusterConfig.storage`."""


class Executor(Protocol):
    """Runs pieces of work. One executor may be used for several stages in turn."""

    storage: Storage

    @property
    def remote(self) -> bool:
        """Whether pieces may run on other machines, which may lack access to the files of this one."""

    @property
    def machines(self) -> tuple[int, ...]:
        """The number of cores of each machine that can run pieces."""

    def run(self, pieces: Sequence[WorkItem], begin: Callable[[WorkItem], WorkCall], at_once: int = 0) -> MessageStream:
        """Runs the pieces in order, at most `at_once` at a time (0 for no limit), and yields their messages.

        The last message of each piece is Finished. `begin` returns the order of a piece when it starts. It is called
        again if the piece restarts because its worker was lost, or because of StorageNotShared, which is yielded
        before.

        Raises InputError if a piece fails. Then, or when the caller closes the generator, the other pieces are stopped.
        """


def threads_each(machines: Sequence[int], pieces: int) -> int:
    """The largest number of threads with which `pieces` pieces can run at once on machines with these core counts; 1 if
    there are more pieces than cores. A piece runs on one machine. Two pieces in parallel with half the threads each
    finish sooner than one after the other."""
    most = max(machines, default=1)
    wanted = min(max(1, pieces), sum(machines))
    return next((t for t in range(most, 0, -1) if pieces_at_once(machines, t) >= wanted), 1)


def pieces_at_once(machines: Sequence[int], threads: int) -> int:
    """The number of pieces with `threads` threads that can run at once."""
    return sum(cores // threads for cores in machines)
