"""The simulator's errors. They have the exception types that Matterport3DSimulator raises in these cases.

They are also InputErrors, so that the command line prints only their sentence.
"""

from __future__ import annotations

from nvsim.errors import InputError


class UnknownScan(InputError, IndexError):
    """The scan id is not in scans.txt. Matterport3DSimulator raises `IndexError` (`map::at`)."""


class BatchMismatch(InputError, IndexError):
    """A list is shorter than the batch. Matterport3DSimulator raises `IndexError`."""


class InvalidValue(InputError, ValueError):
    """A viewpoint, an action, a graph file or an image is invalid. Matterport3DSimulator raises `ValueError`."""


class NotStarted(InputError, RuntimeError):
    """An action was called before an episode began. Matterport3DSimulator raises `RuntimeError`."""


class WrongType(InputError, TypeError):
    """Scalars were given where lists are needed, or the reverse. Matterport3DSimulator raises `TypeError`."""
