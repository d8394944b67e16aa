"""The thresholds with which the committed graph was built."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

from nvsim.errors import InputError
from nvsim.mapping.config import MappingConfig
from nvsim.project import ledger
from nvsim.project.project import Project

_STAGE, _KEY = "map", "thresholds"


def recorded(config: MappingConfig) -> dict[str, Any]:
    """The part of the stage's summary that stores its configuration."""
    return {_KEY: asdict(config)}


def thresholds_of(project: Project) -> MappingConfig:
    """The thresholds with which the graph was built; the defaults if none are recorded."""
    found = ledger.record(project, _STAGE)
    kept = {} if found is None else found.summary.get(_KEY)
    if not isinstance(kept, dict):
        return MappingConfig()
    known = {field.name for field in fields(MappingConfig)}
    try:
        # Fields of newer versions are ignored.
        return MappingConfig(**{name: value for name, value in kept.items() if name in known})
    except (TypeError, InputError):
        return MappingConfig()
