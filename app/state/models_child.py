"""Lists, tests, and installs networks in a side process, because opening a network takes seconds and memory. Does not
use Qt."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.processes.child import Program
from app.processes.serving import Requests

Found = dict[str, Any]
"""{"catalogue": …} in the format of `nvsim.networks.catalogue.Catalogue`, with {"checked": {name: …}} for tested models
and {"added": name} for an installed model."""


@dataclass(frozen=True)
class ModelTask:
    """Tests the models `check`, or installs the absolute paths `add`; then all models are listed."""

    check: tuple[str, ...] = ()
    add: tuple[Path, ...] = ()


def _work(requests: Requests, task: ModelTask) -> Found:
    from nvsim.networks.catalogue import catalogue

    found: Found = {"checked": {}, "added": ""}
    if task.add:
        from nvsim.networks.adding import add

        found["added"] = add(list(task.add)).name
    if task.check:
        from nvsim.networks.installed import bundled, installed
        from nvsim.perception.checking import check

        known = {model.name: model for model in (*installed()[0], *bundled())}
        found["checked"] = {name: asdict(check(known[name])) for name in task.check if name in known}
    found["catalogue"] = catalogue().as_dict()
    return found


MODELS = Program(_work, "models", "The networks cannot be listed")
"""ModelTask -> Found"""
