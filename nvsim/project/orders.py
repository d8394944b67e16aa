"""What a job is to do: its order, as a value, and as the file that anyone may have written."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nvsim.errors import shown
from nvsim.files.nofollow import read_regular
from nvsim.project.proof import is_proven, proof_of
from nvsim.project.work import WORK

_NAME = "order.json"
_MOST = 1 << 20  # bytes of the file
_WHAT = "order"


@dataclass(frozen=True)
class Order:
    """What is to be run: `nvsim VERB ARGUMENTS`. A heavy job waits until no other heavy one runs on the project.
    `ordered` in seconds since the epoch; `title` is for the user."""

    verb: str
    arguments: tuple[str, ...]
    title: str
    heavy: bool = True
    ordered: float = 0.0


def encode_order(root: Path, number: int, order: Order) -> str:
    """The file's text, with the proof that this user ordered it on the project at `root`. Raises InputError when the
    secret for it cannot be read or made."""
    return json.dumps({**asdict(order), "proof": proof_of(root, _WHAT, [number, asdict(order)])})


def read_order(root: Path, number: int, folder: Path) -> tuple[Order, bool]:
    """The order of the job in `folder`, and whether this user ordered exactly this, as this job, on this project.
    Raises OSError or ValueError when there is none, or only a damaged one."""
    try:
        data = json.loads(read_regular(folder / _NAME, _MOST))
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error
    order = _order(data)
    return order, order.verb in WORK and is_proven(root, _WHAT, [number, asdict(order)], data.get("proof"))


def order_path(folder: Path) -> Path:
    return folder / _NAME


def _order(data: Any) -> Order:
    if not isinstance(data, Mapping) or set(data) - {"proof"} != {"verb", "arguments", "title", "heavy", "ordered"}:
        raise ValueError("it has not the fields of an order")
    verb, arguments, title, heavy = (data[name] for name in ("verb", "arguments", "title", "heavy"))
    if not isinstance(arguments, list) or not all(isinstance(text, str) for text in (verb, title, *arguments)):
        raise ValueError("its words are no texts")
    if not isinstance(heavy, bool):
        raise ValueError("heavy is neither true nor false")
    return Order(verb, tuple(arguments), title, heavy, number_in(data["ordered"]))


def number_in(value: Any) -> float:
    """A finite number of a JSON file. Raises ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e15 or math.isnan(value):
        raise ValueError(f"{shown(value, 40)} is not a number that it can have")
    return float(value)
