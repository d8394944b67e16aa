"""List the installed models, and the known models that could be installed, for the command line and the window."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

from nvsim.files.opening import is_regular
from nvsim.networks.description import IMPROVES, ROLE_WORDS, SINGLE_FILES, Role
from nvsim.networks.folder import models_folder
from nvsim.networks.installed import InstalledModel, bundled_models, installed_models
from nvsim.networks.known_forms import known_descriptions


@dataclass(frozen=True)
class ListedModel:
    """An installed model, as text."""

    name: str
    role: str
    title: str
    improves: str
    made_by: str
    licence: str
    source: str
    files: tuple[str, ...]
    megabytes: float


@dataclass(frozen=True)
class KnownForm:
    """A form for which NVSim has a description."""

    form: str
    title: str
    names: tuple[str, ...]
    made_by: str
    licence: str
    source: str


@dataclass(frozen=True)
class MissingRole:
    """A role for which no model is installed."""

    role: str
    improves: str
    known: tuple[KnownForm, ...]


@dataclass(frozen=True)
class Catalog:
    folder: Path
    models: tuple[ListedModel, ...]
    problems: tuple[str, ...]
    lacking: tuple[MissingRole, ...]

    def as_dict(self) -> dict[str, Any]:
        return {**asdict(self), "folder": str(self.folder)}


def catalog() -> Catalog:
    """The installed models and the roles without one. No network is opened."""
    models, problems = installed_models()
    roles: tuple[Role, ...] = get_args(Role)
    played = {model.role for model in models}
    return Catalog(
        models_folder(),
        (*map(_list_model, (*models, *bundled_models())), *_single_files()),
        tuple(problems),
        tuple(MissingRole(ROLE_WORDS[r], IMPROVES[r], _known_forms(r)) for r in roles if r not in played),
    )


def _list_model(model: InstalledModel) -> ListedModel:
    d = model.description
    title = d.title if d else f"installed as {', '.join(p.name for p in model.files)}; its form is detected on opening"
    paths = model.sources
    return ListedModel(
        model.name, ROLE_WORDS[model.role], title, IMPROVES[model.role], d.made_by if d else "",
        d.licence if d else "", d.source if d else "", tuple(p.name for p in paths), _megabytes(paths),
    )  # fmt: skip


def _single_files() -> list[ListedModel]:
    found = []
    try:
        names = sorted(os.listdir(models_folder()))
    except OSError:
        return []
    for name in names:
        path = models_folder() / name
        kind = name.split(".")[0]
        if kind in SINGLE_FILES and name.endswith(".onnx") and is_regular(path):
            title = "an image distance" if kind == "lpips" else "a feature backbone"
            found.append(
                ListedModel(path.stem, kind, title, SINGLE_FILES[kind], "", "", "", (name,), _megabytes([path]))
            )
    return found


def _known_forms(role: Role) -> tuple[KnownForm, ...]:
    return tuple(
        KnownForm(form, d.title, d.names, d.made_by, d.licence, d.source)
        for form, d in known_descriptions().items()
        if d.role == role
    )


def _megabytes(paths: list[Path]) -> float:
    return sum(path.stat().st_size for path in paths if is_regular(path)) / 1e6
