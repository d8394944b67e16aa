"""Converts errors of libraries that read files to InputError with one sentence.

A reader wraps its body in `reading(path, "a COLMAP camera file")`. It raises InputError itself if it knows more details
(line, frame, element). All other exceptions of parsers and decoders mean that the file is damaged, and must not reach
users as a traceback.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.placeholders import why_missing

_LONGEST_PATH = 400  # characters in a message; a damaged file may contain a very long path
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
    """The error message for a `path` that the system refuses to read."""
    if error.errno == errno.ENOENT and (why := why_missing(path)):
        return InputError(f"{path} {why}.")
    reason = _REASONS.get(error.errno or 0, f"{error.strerror or error}; check the path")
    name = str(path)
    name = name if len(name) <= _LONGEST_PATH else f"{name[:_LONGEST_PATH]}..."
    return InputError(f"Cannot read {name}: {reason}.")


@contextmanager
def reading(path: Path, what: str, then: str = "check that it is complete, or write it again") -> Iterator[None]:
    """Converts every exception inside the block to InputError.

    path    the file that is read
    what    the expected kind of file, with its article: "a ROS map"
    then    the advice to the user

    An InputError from the block passes unchanged. So do exceptions that end the process.
    """
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise as_reading_error(path, error) from error
    except MemoryError as error:
        raise InputError(f"{path} is too large for the memory of this machine; use a smaller file.") from error
    except Exception as error:  # any exception of a parser for invalid data
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path} is not {what} that can be read ({reason}); {then}.") from error
