"""Opens the executor that the options select: the processes of this machine, or a running Ray cluster. The connection
to Ray has a time limit, and uses the token of the cluster."""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.local import LocalPool
from nvsim.cluster.piece import Executor
from nvsim.errors import InputError

_ANSWER = 5.0  # seconds in which the port of the head must answer
_LIMIT = (
    45.0  # seconds for the whole connection; Ray gives up after 20 s without permission, and never if no head answers
)


@contextlib.contextmanager
def open_executor(config: ClusterConfig) -> Iterator[Executor]:
    """The executor of the options, until the block ends. Ray is imported only if it is selected.

    Raises InputError if Ray is selected and not installed, or if no cluster answers.
    """
    if config.executor == "local":
        yield LocalPool()
        return
    from nvsim.cluster.ray_pool import RayPool

    with connect_to_cluster(config.address) as ray:
        yield RayPool(ray, config.storage)


@contextlib.contextmanager
def connect_to_cluster(address: str) -> Iterator[ModuleType]:
    """The module `ray`, connected to the cluster at `address` ("auto" or HOST:PORT) until the block ends. Raises
    InputError if Ray is not installed, or the cluster does not answer or refuses the connection."""
    import logging

    host, port = _parse_address(address)
    # Ray requests the token by itself only for "auto". An existing value of the variable has priority.
    os.environ.setdefault("RAY_AUTH_MODE", "token")
    try:
        import ray
    except ImportError as error:
        raise InputError(
            "Ray is not installed, which --executor ray needs; install the extra: pip install 'nvsim[cluster]'."
        ) from error
    logging.getLogger("ray").setLevel(logging.CRITICAL)  # Ray raises the same errors
    # Ray prints messages about ended workers between the events of NVSim, and has no option against it.
    vars(importlib.import_module("ray._private.worker"))["print_to_stdstream"] = lambda *_, **__: None
    if port:
        try:
            socket.create_connection((host, port), timeout=_ANSWER).close()
        except OSError as error:
            raise InputError(
                f"Nothing answers at {address} ({error.strerror or error}); start the head of the cluster there with "
                "`ray start --head`, or correct --address."
            ) from error
    failed: list[BaseException] = []

    def begin() -> None:
        options: dict[str, Any] = {"log_to_driver": False, "configure_logging": False}
        try:
            ray.init(address=address, **options)
        except BaseException as error:
            failed.append(error)

    # In a thread because it may wait forever. In a thread, Ray also leaves the command's signal handlers unchanged.
    thread = threading.Thread(target=begin, daemon=True)
    with _suppress_native_lines():
        thread.start()
        thread.join(_LIMIT)
    if thread.is_alive():
        raise InputError(f"The Ray cluster at {address} did not answer in {_LIMIT:.0f} s; check that its head runs.")
    if failed:
        raise InputError(_explain_failure(address, failed[0])) from failed[0]
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGTERM, signal.SIGINT):  # Ray's own handler prints a trace before it passes them on
            signal.signal(number, signal.getsignal(number))
    try:
        yield ray
    finally:
        ray.shutdown()


@contextlib.contextmanager
def _suppress_native_lines() -> Iterator[None]:
    """Suppresses lines that Ray writes to stderr from native code, one per second while a head refuses access."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        os.close(nowhere)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _parse_address(address: str) -> tuple[str, int]:
    """Host and port, ("", 0) for "auto"."""
    if address == "auto":
        return "", 0
    host, _, port = address.rpartition(":")
    if not host or "/" in host or not port.isascii() or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise InputError(f"--address {address} is not a Ray cluster address; use HOST:PORT (port 6379), or auto.")
    return host.strip("[]"), int(port)


def _explain_failure(address: str, error: BaseException) -> str:
    words = " ".join(str(error).split())
    if address == "auto" and isinstance(error, ConnectionError) and "Could not find" in words:
        return (
            "This machine belongs to no Ray cluster; start one with `ray start --head`, join one with "
            "`ray start --address HOST:PORT`, or pass --address HOST:PORT."
        )
    if type(error).__name__ == "AuthenticationError" or "uthenticat" in words:
        return (
            f"The Ray cluster at {address} needs a token; copy ~/.ray/auth_token from its head to this machine. "
            "`ray get-auth-token --generate` creates it there, before the head starts with RAY_AUTH_MODE=token."
        )
    return (
        f"The Ray cluster at {address} refused the connection ({words[:200]}); check that its head runs, that Ray and "
        "Python have the same versions, and that ~/.ray/auth_token equals that of the head."
    )
