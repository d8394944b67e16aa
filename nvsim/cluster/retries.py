"""What becomes of a piece whose worker was lost: it begins again, with more memory where it was killed for it, and not
for ever."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cluster.piece import Message, Piece
from nvsim.errors import InputError
from nvsim.events import Progress

RETRIES = 2
"""How often a piece is begun again after losses in a row. A try that got further than all before it starts the count
anew: on a cluster that takes machines away every minute, a long training still comes to its end."""


@dataclass
class Attempt:
    """A piece on its way: the memory that is asked for, losses in a row, and how far it came."""

    piece: Piece
    bytes: int
    losses: int = 0
    worker: str = ""
    _done: int = 0
    _further: bool = False

    def hear(self, message: Message) -> None:
        """Notes how far it is."""
        if isinstance(message, Progress) and message.done > self._done:
            self._done, self._further = message.done, True

    def lost(self, for_memory: bool, most_bytes: int) -> str:
        """Makes it ready to begin again; a sentence about that. `most_bytes` has the largest machine. Raises InputError
        where it was begun often enough."""
        self.losses = 1 if self._further else self.losses + 1
        self._further = False
        where = f" on {self.worker}" if self.worker else ""
        if for_memory and self.bytes >= most_bytes:
            raise InputError(
                f"The work on {self.piece.words} was killed{where} for want of memory with {_gb(self.bytes)} GB asked "
                "for, and no machine has more; use more submaps, fewer Gaussians or a larger machine."
            )
        if self.losses > RETRIES:
            raise InputError(
                f"The work on {self.piece.words} lost its worker {self.losses} times and came no further{where}; look "
                "into Ray's logs there. The same command goes on from the last checkpoint."
            )
        if for_memory:
            self.bytes = min(2 * self.bytes, most_bytes)
            return (
                f"The work on {self.piece.words} was killed{where} for want of memory; it begins again from its last "
                f"checkpoint with {_gb(self.bytes)} GB."
            )
        return f"The worker of {self.piece.words}{where} was lost; another goes on from the last checkpoint."


def _gb(count: int) -> str:
    return f"{count / 1e9:.1f}"
