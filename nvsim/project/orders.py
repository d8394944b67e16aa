"""The order of a job, as a value and as an untrusted file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nvsim.errors import shown
from nvsim.files.opening import read_regular
from nvsim.project.proof import is_proven, proof_of
from nvsim.project.work import WORK

_NAME = "order.json"
_MOST = 1 << 20  # bytes of the file
_WHAT = "order"


@dataclass(frozen=True)
class Order:
    """The command of a job: `nvsim VERB ARGUMENTS`.

    title    name of the job for the user
    heavy    wait until no other heavy job runs on the project
    ordered  seconds since the epoch
    """

    verb: str
    arguments: tuple[str, ...]
    title: str
    heavy: bool = True
    ordered: float = 0.0


def encode_order(root: Path, number: int, order: Order) -> str:
    """The text of the order file, with the proof that this user ordered it on the project at `root`. Raises InputError
    if the secret for the proof cannot be read or created."""
    return json.dumps({**asdict(order), "proof": proof_of(root, _WHAT, [number, asdict(order)])})


def read_order(root: Path, number: int, folder: Path) -> tuple[Order, bool]:
    """The order of the job in `folder`, and whether this user ordered exactly this job on this project. Raises OSError
    or ValueError if the order is missing or damaged."""
    try:
        data = json.loads(read_regular(folder / _NAME, _MOST))
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    order = _order(data)
    return order, order.verb in WORK and is_proven(root, _WHAT, [number, asdict(order)], data.get("proof"))


def order_path(folder: Path) -> Path:
    return folder / _NAME


def _order(data: Any) -> Order:
    if not isinstance(data, Mapping) or set(data) - {"proof"} != {"verb", "arguments", "title", "heavy", "ordered"}:
        raise ValueError("it does not have the fields of an order")
    verb, arguments, title, heavy = (data[name] for name in ("verb", "arguments", "title", "heavy"))
    if not isinstance(arguments, list) or not all(isinstance(text, str) for text in (verb, title, *arguments)):
        raise ValueError("a text field is not text")
    if not isinstance(heavy, bool):
        raise ValueError("heavy is neither true nor false")
    return Order(verb, tuple(arguments), title, heavy, number_in(data["ordered"]))


def number_in(value: Any) -> float:
    """A finite number of a JSON file. Raises ValueError for all other values."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e15 or math.isnan(value):
        raise ValueError(f"{shown(value, 40)} is not a valid number")
    return float(value)
