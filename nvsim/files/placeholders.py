"""Recognizes placeholders: files with the name of the data but without its content.

Placeholders are pointers of Git LFS and git-annex, web pages saved by a failed download, metadata files of macOS, and
files that only exist in a cloud. The functions that open foreign files call this module, such as
`nvsim.files.opening.opened`. All readers therefore report one cause. Only the first bytes are read.

Formats: git-lfs/docs/spec.md, git-annex.branchable.com/internals/pointer_file, RFC 1740 (AppleDouble), Git-Xet.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

HEAD = 512
"""Bytes of a file that `placeholder_reason` needs."""
_LONGEST_POINTER = 1024  # bytes; the specification of Git LFS allows fewer
_AGAIN = "download the file itself again"
_POINTERS = (
    (b"version https://git-lfs.github.com/spec/", "is a Git LFS pointer, not the file; run `git lfs pull`"),
    (b"version https://hawser.github.com/spec/", "is a Git LFS pointer, not the file; run `git lfs pull`"),
    (b"# xet version ", "is a Git-Xet pointer, not the file; run `git xet checkout`"),
)
_ANNEX = re.compile(rb"\A(?:/|[./]*/\.git/|\.git/)annex/objects/")  # an unlocked file, and a link checked out as text
_ANNEX_ADVICE = "is a git-annex pointer, not the file; run `git annex get`"
# A group in a lookahead never backtracks: a file of many comments would take exponential time otherwise.
_PAGE = re.compile(
    rb"\A(?:(?=(<\?xml[^>]*>|<!--.*?-->))\1\s*)*<(?:!doctype\s+html|html|head|body)\b", re.IGNORECASE | re.DOTALL
)
_XML_ERROR = re.compile(rb"\A(?:<\?xml[^>]*>\s*)?<(?:Error|ServiceException)\b")
_NO_FILE = re.compile(
    rb"\A\s*(?:404:? Not Found|Entry not found|Repository not found|Not Found|Access denied|AccessDenied"
    rb"|Invalid username or password\.?)\s*\Z",
    re.IGNORECASE,
)
_APPLE_MAGIC = (b"\x00\x05\x16\x07", b"\x00\x05\x16\x00")
_APPLE_PREFIX = "._"


def placeholder_reason(head: bytes, size: int) -> str:
    """The kind of a placeholder and the fix, worded to follow the file name; "" for a usual file.

    head  the beginning of the file; `HEAD` bytes are enough
    size  bytes of the whole file
    """
    head = head[:HEAD]
    if size < _LONGEST_POINTER:
        for start, words in _POINTERS:
            if head.startswith(start):
                return words
        if _ANNEX.match(head):
            return _ANNEX_ADVICE
        if size <= HEAD and _NO_FILE.match(head):
            return f"is the error message of a server, not the file; {_AGAIN}"
    if head.startswith(_APPLE_MAGIC):
        return "is a metadata file of macOS, not the file; use the file of that name without the leading '._'"
    text = _text_start(head)
    if text.startswith(b"<"):
        if _PAGE.match(text):
            return f"is a web page, not the file; {_AGAIN}"
        if _XML_ERROR.match(text):
            return f"is the error message of a server, not the file; {_AGAIN}"
    return ""


def why_missing(path: Path) -> str:
    """The reason why the file `path` is missing and the fix, worded to follow the file name; "" if it is unknown.

    Known reasons are a link into git-annex, a link to a missing file, a file in iCloud, and data under DVC.
    """
    try:
        if path.is_symlink():
            target = os.readlink(path)
            if "annex/objects/" in target.replace("\\", "/"):
                return "is a git-annex link to a file that is not here; run `git annex get`"
            if not path.exists():
                return f"is a link to {target[:200]!r}, which does not exist; put the file itself there"
        if (path.parent / f".{path.name}.icloud").is_file():
            return "is in iCloud and not on this disk; download it in the Finder first"
        if path.with_name(f"{path.name}.dvc").is_file():
            return "is tracked by DVC and not on this disk; run `dvc pull`"
    except (OSError, ValueError):
        pass
    return ""


def is_metadata_name(name: str) -> bool:
    """Whether the name is that of an AppleDouble file of macOS (`._NAME`) or of an iCloud placeholder
    (`.NAME.icloud`). An AppleDouble file has the suffix of the file that it describes."""
    return name.startswith(_APPLE_PREFIX) or (name.startswith(".") and name.endswith(".icloud"))


def _text_start(head: bytes) -> bytes:
    """The beginning of a text without byte order mark and white space. UTF-16 is reduced to ASCII."""
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        head = head[2:].replace(b"\0", b"")
    return (head[3:] if head.startswith(b"\xef\xbb\xbf") else head).lstrip()
