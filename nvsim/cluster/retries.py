"""Restarts a piece whose worker was lost, with more memory if it ran out of memory, and a limited number of times."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cluster.piece import Message, Piece
from nvsim.errors import InputError
from nvsim.events import Progress

RETRIES = 2
"""Maximum number of restarts after consecutive losses. An attempt that got further than all previous ones resets the
count. A long training therefore finishes even on a cluster that removes machines every minute."""


@dataclass
class Attempt:
    """The state of a piece: its requested memory, consecutive losses, and progress."""

    piece: Piece
    bytes: int
    losses: int = 0
    worker: str = ""
    _done: int = 0
    _further: bool = False

    def hear(self, message: Message) -> None:
        """Records the progress of the piece."""
        if isinstance(message, Progress) and message.done > self._done:
            self._done, self._further = message.done, True

    def lost(self, for_memory: bool, most_bytes: int) -> str:
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
                f"The work on {self.piece.words} was killed{where} because it needed more than the requested "
                f"{_gb(self.bytes)} GB of memory, and no machine has more; use more submaps, fewer Gaussians or a "
                "larger machine."
            )
        if self.losses > RETRIES:
            raise InputError(
                f"The work on {self.piece.words} lost its worker {self.losses} times without progress{where}; check "
                "Ray's logs there. Run the same command again to continue from the last checkpoint."
            )
        if for_memory:
            self.bytes = min(2 * self.bytes, most_bytes)
            return (
                f"The work on {self.piece.words} was killed{where} because memory ran out; it restarts from its last "
                f"checkpoint with {_gb(self.bytes)} GB."
            )
        return f"The worker of {self.piece.words}{where} was lost; another continues from the last checkpoint."


def _gb(count: int) -> str:
    return f"{count / 1e9:.1f}"
