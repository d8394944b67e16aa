"""Messages between a process and its child. Arrays are sent as raw bytes and not copied into the pickle."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any


@dataclass(frozen=True)
class Request:
    """memory  bytes that the child may use for this request in addition to its current memory, None for no limit"""

    value: Any
    memory: int | None = None


@dataclass(frozen=True)
class Answer:
    value: Any


@dataclass(frozen=True)
class Notice:
    """Progress of a request. Any number of notices may come before its answer."""

    value: Any


@dataclass(frozen=True)
class ReportedInputError:
    """An InputError of the child."""

    sentence: str


@dataclass(frozen=True)
class OutOfMemory:
    pass


@dataclass(frozen=True)
class ReportedBug:
    """An exception in the child that is a bug in NVSim."""

    traceback: str


def send(connection: Connection, message: Any) -> None:
    """Sends a message that can be pickled. Raises OSError if the other end is closed."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    raws = [buffer.raw() for buffer in buffers]
    connection.send_bytes(pickle.dumps((head, [raw.nbytes for raw in raws])))
    for raw in raws:
        if raw.nbytes:
            connection.send_bytes(raw)


def receive(connection: Connection) -> Any:
    """Waits for a message. Raises EOFError or OSError if the other end is closed."""
    head, sizes = pickle.loads(connection.recv_bytes())
    buffers = [bytearray(size) for size in sizes]
    for buffer in buffers:
        if buffer:
            connection.recv_bytes_into(buffer)
    return pickle.loads(head, buffers=buffers)
