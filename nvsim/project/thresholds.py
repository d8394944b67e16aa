"""The thresholds that the committed graph was decided with."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

from nvsim.errors import InputError
from nvsim.mapping.config import MappingConfig
from nvsim.project import ledger
from nvsim.project.project import Project

_STAGE, _KEY = "map", "thresholds"


def recorded(config: MappingConfig) -> dict[str, Any]:
    """What the stage's summary keeps of its configuration."""
    return {_KEY: asdict(config)}


def thresholds_of(project: Project) -> MappingConfig:
    """The thresholds that the graph was built with; the defaults where no build recorded any."""
    found = ledger.record(project, _STAGE)
    kept = {} if found is None else found.summary.get(_KEY, {})
    known = {field.name for field in fields(MappingConfig)}
    try:
        # What a later program added is not ours to judge.
        return MappingConfig(**{name: value for name, value in kept.items() if name in known})
    except (TypeError, InputError):
        return MappingConfig()
