"""A piece of work that a process of its own can do, what is told of it on the way, and what an executor is."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from nvsim.errors import InputError
from nvsim.events import Event


@dataclass(frozen=True)
class Piece:
    """stage   whose work it is
    part     its number, which tells it from the others: that of the submap, or of the first frame
    words    what a user calls it: "submap 3"
    cores    threads it works with
    bytes    of memory it is expected to take
    alone    on one machine: while no other piece is done there
    """

    stage: str
    part: int
    words: str
    cores: int
    bytes: int
    alone: bool = False


@dataclass(frozen=True)
class SentFile:
    """A file that comes from a worker: its name there, what it holds, and the SHA-256 of that as the worker saw it."""

    name: str
    data: bytes
    sha256: str

    @staticmethod
    def of(name: str, data: bytes) -> SentFile:
        return SentFile(name, data, hashlib.sha256(data).hexdigest())

    def check(self) -> None:
        """Raises InputError where it did not arrive as it was sent."""
        if hashlib.sha256(self.data).hexdigest() != self.sha256:
            raise InputError(f"{self.name} was damaged on its way from a worker; the same command goes on from there.")


@dataclass(frozen=True)
class Finished:
    """The last message of a piece: what its work returned."""

    value: Any


@dataclass(frozen=True)
class Unseen:
    """What work returns that does not see the files of its caller, and the path that is missing: it is to be begun
    again otherwise."""

    path: str

    @property
    def why(self) -> str:
        """The beginning of a sentence for users."""
        return f"A machine of the cluster does not see {self.path}"


Message = Event | SentFile | Unseen | Finished
Told = Generator[tuple[Piece, Message], None, None]
"""What pieces tell, as it comes; closed, it stops them."""


class Caller(Protocol):
    """The one that ordered a piece, as its work sees it."""

    def tell(self, event: Event) -> None:
        """Sends an event."""

    def send(self, name: str, data: bytes) -> None:
        """Sends a file."""

    def ready(self) -> None:
        """Says that everything is read; returns when the first kernel may run."""


Work = Callable[..., object]
"""A function of a module, work(caller, *given), which a process of its own can import and do."""


@dataclass(frozen=True)
class Order:
    """What a piece begins with: the function, and what it gets after the caller."""

    work: Work
    given: tuple[object, ...]


class Executor(Protocol):
    """Does pieces of work somewhere. Each may be used for several stages, one after another."""

    @property
    def remote(self) -> bool:
        """Whether other machines may do them, which need not see the files of this one."""

    @property
    def machines(self) -> tuple[int, ...]:
        """The cores of each machine that may do some."""

    def run(self, pieces: Sequence[Piece], begin: Callable[[Piece], Order], at_once: int = 0) -> Told:
        """Does them in order, `at_once` at a time at most, and yields what they tell as it comes; the last message of
        each is Finished. `begin` is asked for the order of a piece when it begins, and again where its worker was lost
        and it begins once more, or where it was Unseen, which is yielded before that.

        Raises InputError for what one could not do; the others are stopped. They also are where the caller stops.
        """
