"""Proofs that this user on this machine said something: a keyed hash with a secret that lies outside of every project.

A project that somebody sent may hold orders and settings of any kind. What carries no proof, or one for another
project, was not said here. The proof is over the project's place too, so that it does not travel with a copy.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import hmac
import json
import os
import secrets
import stat
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error
from nvsim.files.nofollow import open_regular
from nvsim.files.user_folders import xdg_folder

_SIZE = 32  # bytes of the secret


def secret_path() -> Path:
    """Where the secret of this user lies: in the state folder of the XDG rules."""
    return xdg_folder("XDG_STATE_HOME", ".local/state") / "nvsim" / "orders.key"


def proof_of(root: Path, what: str, said: Any) -> str:
    """The proof that `said` (JSON values), a `what` such as "order", was said here for the project at `root`. The
    secret is made with the first proof. Raises InputError when it cannot be read or written."""
    text = json.dumps([what, os.path.realpath(root), said], sort_keys=True, separators=(",", ":"))
    return hmac.new(_secret(make=True), text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest()


def is_proven(root: Path, what: str, said: Any, proof: object) -> bool:
    """Whether `proof` is the one that `proof_of` gave for the same. False as well where there is no secret yet."""
    if not isinstance(proof, str) or not proof.isascii():
        return False
    text = json.dumps([what, os.path.realpath(root), said], sort_keys=True, separators=(",", ":"))
    try:
        secret = _secret(make=False)
    except InputError:
        return False
    return hmac.compare_digest(
        hmac.new(secret, text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest(), proof
    )


def _secret(make: bool) -> bytes:
    path = secret_path()
    try:
        try:
            return _read(path)
        except FileNotFoundError:
            if not make:
                raise
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        return _made(path)
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ELOOP, errno.EINVAL):
            raise InputError(
                f"{path} is not the file of a secret that only you can read; remove it, and order your jobs anew."
            ) from error
        raise as_input_error(path, error) from error


def _read(path: Path) -> bytes:
    descriptor = open_regular(path, os.O_RDONLY)
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        data = file.read(_SIZE + 1)
    others = stat.S_IRWXG | stat.S_IRWXO
    if found.st_uid != os.geteuid() or found.st_mode & others or len(data) != _SIZE:
        raise OSError(errno.EINVAL, "it can be read by others, or is not whole", str(path))
    return data


def _made(path: Path) -> bytes:
    """A new secret, whole or not at all; where two processes make one at the same time, the first one's."""
    temporary = path.with_name(f".{path.name}-{os.getpid()}-{secrets.token_hex(4)}")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        with open(descriptor, "wb") as file:
            file.write(secrets.token_bytes(_SIZE))
            file.flush()
            os.fsync(descriptor)
        with contextlib.suppress(FileExistsError):
            os.link(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return _read(path)
