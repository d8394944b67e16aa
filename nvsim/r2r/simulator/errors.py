"""What the simulator refuses, one sentence each, as the exceptions that Matterport3DSimulator raises for the same.

They are InputErrors as well, so that the command line prints the sentence alone.
"""

from __future__ import annotations

from nvsim.errors import InputError


class UnknownScan(InputError, IndexError):
    """A scan id that scans.txt does not list: `IndexError` (`map::at`) there."""


class BatchMismatch(InputError, IndexError):
    """A list shorter than the batch: `IndexError` there."""


class InvalidValue(InputError, ValueError):
    """A viewpoint, an action, a graph file or an image that cannot be used: `ValueError` there."""


class NotStarted(InputError, RuntimeError):
    """An action before any episode: `RuntimeError` there."""


class WrongType(InputError, TypeError):
    """Scalars where the batch wants lists, or the other way round: `TypeError` there."""
