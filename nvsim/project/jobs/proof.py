"""Proofs that this user gave an order on this machine: a keyed hash, with a secret stored outside of all projects.

A project from another person may contain any jobs and settings. Data without a valid proof for this project was not
ordered here. The proof includes the path of the project, so a copy of the project has no valid proofs.
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
from nvsim.files.opening import open_regular
from nvsim.files.user_folders import xdg_folder

_SIZE = 32  # bytes of the secret


def secret_path() -> Path:
    """The path of this user's secret, in the state folder of the XDG specification."""
    return xdg_folder("XDG_STATE_HOME", ".local/state") / "nvsim" / "orders.key"


def proof_of(root: Path, what: str, said: Any) -> str:
    """The proof that `said` (JSON values) was ordered here for the project at `root`. `what` is its kind, such as
    "order". The first proof creates the secret. Raises InputError if the secret cannot be read or written."""
    text = json.dumps([what, os.path.realpath(root), said], sort_keys=True, separators=(",", ":"))
    return hmac.new(_secret(make=True), text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest()


def is_proven(root: Path, what: str, said: Any, proof: object) -> bool:
    """Whether `proof` is the result of `proof_of` for these arguments. Also False if there is no secret yet."""
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
                f"{path} is not a secret that only you can read; remove it, and order your jobs again."
            ) from error
        raise as_input_error(path, error) from error


def _read(path: Path) -> bytes:
    descriptor = open_regular(path, os.O_RDONLY)
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        data = file.read(_SIZE + 1)
    others = stat.S_IRWXG | stat.S_IRWXO
    if found.st_uid != os.geteuid() or found.st_mode & others or len(data) != _SIZE:
        raise OSError(errno.EINVAL, "other users can read it, or it is incomplete", str(path))
    return data


def _made(path: Path) -> bytes:
    """A new secret, written atomically. If two processes create one, both use the first."""
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
