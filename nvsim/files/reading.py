"""The boundary of every reader: what a library raises over a damaged file leaves it as one sentence.

A reader wraps its whole body in `reading(path, "a COLMAP camera file")` and raises InputError itself wherever it knows
more (line, frame, element). Whatever else comes out of a parser, a decoder or a decompressor says no more than that the
file is not what it should be, and must not reach the user as a traceback.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.placeholders import absence

_LONGEST_PATH = 400  # characters of a message; a damaged file may name a path without end
_REASONS = {
    errno.ENOENT: "it does not exist; check the path",
    errno.EACCES: "permission is denied; make it readable",
    errno.EPERM: "permission is denied; make it readable",
    errno.EISDIR: "it is a folder, not a file; name the file in it",
    errno.ENOTDIR: "a part of the path is a file, not a folder; check the path",
    errno.ENAMETOOLONG: "its name is too long for this file system",
    errno.ELOOP: "it is a symbolic link, which is not followed here; name the file itself",
}


def as_reading_error(path: Path, error: OSError) -> InputError:
    """The sentence for a `path` that the system will not let us read."""
    if error.errno == errno.ENOENT and (why := absence(path)):
        return InputError(f"{path} {why}.")
    reason = _REASONS.get(error.errno or 0, f"{error.strerror or error}; check the path")
    name = str(path)
    name = name if len(name) <= _LONGEST_PATH else f"{name[:_LONGEST_PATH]}..."
    return InputError(f"Cannot read {name}: {reason}.")


@contextmanager
def reading(path: Path, what: str, then: str = "check that it is whole, or write it again") -> Iterator[None]:
    """Turns every failure inside the block into InputError.

    path    the file that is read
    what    what it should be, with its article: "a ROS map"
    then    what the user can do about it

    Raises InputError. An InputError from inside passes unchanged, and so does what ends the process.
    """
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise as_reading_error(path, error) from error
    except MemoryError as error:
        raise InputError(f"{path} is too large for the memory of this machine; use a smaller file.") from error
    except Exception as error:  # whatever a parser raises over bytes that make no sense to it
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path} is not {what} that can be read ({reason}); {then}.") from error
