"""The models that come with NVSim, and the models that the user has installed.

In the models folder, a model is a folder NAME with model.toml and its files, or a TOML with its files. Files without a
description are also accepted under fixed names (normals.onnx, prompted.encoder.onnx, and prompted.decoder.onnx)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.opening import is_regular, opened, read_text
from nvsim.files.reading import reading
from nvsim.networks.chain import Chain
from nvsim.networks.description import ROLE_WORDS, Description, Role
from nvsim.networks.folder import models_folder
from nvsim.networks.known_forms import (
    FOLDER,
    description_from_legacy_toml,
    known_descriptions,
    matching_forms,
    read_description,
)
from nvsim.networks.onnx_session import Provider, Session, Signature
from nvsim.networks.parsing import description_in
from nvsim.networks.toml_table import LARGEST, parse_toml

DESCRIPTION = "model.toml"
OLD: dict[str, tuple[Role, tuple[str, ...]]] = {
    "normals": ("normals", ("normals.onnx",)),
    "prompted": ("prompted", ("prompted.encoder.onnx", "prompted.decoder.onnx")),
}
"""Models without a description: name -> role and files."""
BUNDLED = "bundled"
"""Name of the model that comes with NVSim, if the role is given."""
_OURS: dict[str, Role] = {"bundled-floor": "semantic", "bundled-normals": "normals"}


@dataclass(frozen=True)
class InstalledModel:
    """An installed model. `description` is None if the files must be opened to detect their form."""

    name: str
    role: Role
    folder: Path
    described_in: Path | None
    description: Description | None
    files: tuple[Path, ...]

    @property
    def sources(self) -> list[Path]:
        """Every file that the model's results depend on."""
        described = [self.described_in] if self.described_in else [self.files[0].with_suffix(".toml")]
        files = self.description.files.values() if self.description else ()
        weights = [self.folder / name for file in files for name in file.beside]
        return [path for path in (*self.files, *weights, *described) if is_regular(path)]

    @property
    def stamp(self) -> list[tuple[str, int, int]]:
        """Names, sizes, and modification times of the files. This is faster than a digest, and enough for results that
        can be recomputed."""
        found = [(path.name, path.stat()) for path in self.sources]
        return [(name, stat.st_size, stat.st_mtime_ns) for name, stat in found]

    def digest(self) -> str:
        """A hash that identifies the model and its description. Raises InputError if a file cannot be read."""
        whole = hashlib.sha256()
        for path in self.sources:
            with reading(path, "a network"), opened(path) as file:
                whole.update(hashlib.file_digest(file, "sha256").digest())
        return whole.hexdigest()[:24]

    def open(self, provider: Provider = "auto") -> Chain:
        """Open the model. Raises InputError if its files cannot be loaded or do not match its description."""
        return Chain(self.description or self._checked_description(), self.folder, provider)

    def _checked_description(self) -> Description:
        signatures = {path: signature_of(path) for path in self.files}
        beside = self.files[0].with_suffix(".toml")
        if self.role == "normals" and is_regular(beside):
            return description_in(
                description_from_legacy_toml(beside, self.files[0], *signatures[self.files[0]]), beside
            )
        forms = matching_forms(signatures, self.role)
        if not forms:
            known = ", ".join(form for form, d in known_descriptions().items() if d.role == self.role)
            names = " and ".join(path.name for path in self.files)
            raise InputError(
                f"{self.folder}: {names} fit none of the known forms ({known}); describe it in a TOML, and add it "
                "with `nvsim models add`."
            )
        form, files = forms[0]
        description = known_descriptions()[form]
        named = {key: replace(file, name=files[key].name) for key, file in description.files.items()}
        return replace(description, files=named)


def signature_of(path: Path) -> Signature:
    """Inputs and outputs of an ONNX file. Raises InputError if it cannot be loaded."""
    return Session(path).signature


@dataclass(frozen=True)
class _Problem:
    """Why the model `name` cannot be used. `role` is None if its description cannot be read."""

    name: str
    role: Role | None
    message: str


def installed_models() -> tuple[list[InstalledModel], list[str]]:
    """The models sorted by name, and a message for each invalid description."""
    models, problems = _find_installed()
    return models, [problem.message for problem in problems]


def _find_installed() -> tuple[list[InstalledModel], list[_Problem]]:
    """The models sorted by name, and the models that cannot be used."""
    folder = models_folder()
    found: dict[str, InstalledModel] = {}
    problems = []
    for name, (role, files) in OLD.items():
        paths = tuple(folder / file for file in files)
        there = [path for path in paths if is_regular(path)]
        if len(there) == len(paths):
            found[name] = InstalledModel(name, role, folder, None, None, paths)
        elif there:
            (missing, *_) = (path for path in paths if path not in there)
            message = f"{missing} is missing; a prompted model consists of an encoder and a decoder."
            problems.append(_Problem(name, role, message))
    for path in _descriptions(folder):
        try:
            model = model_at(path)
        except InputError as error:
            problems.append(_Problem(_name_of(path), None, str(error)))
        else:
            found[model.name] = model
    return [found[name] for name in sorted(found)], problems


def model_at(path: Path) -> InstalledModel:
    """The model that the TOML at `path` describes. Raises InputError if it is invalid."""
    description = read_description(path)
    files = tuple(path.parent / file.name for file in description.files.values())
    return InstalledModel(_name_of(path), description.role, path.parent, path, description, files)


def _name_of(path: Path) -> str:
    """The name of the model that the TOML at `path` describes."""
    return path.parent.name if path.name == DESCRIPTION else path.stem


def bundled_models() -> list[InstalledModel]:
    """The models that come with NVSim. Their descriptions are in `nvsim_resources/models/bundled`."""
    found = []
    for name, role in _OURS.items():
        path = FOLDER / BUNDLED / f"{role}.toml"
        if is_regular(path):
            found.append(replace(model_at(path), name=name))
    return found


def bundled_model(role: Role) -> InstalledModel | None:
    """The model of a role that comes with NVSim, None if there is none."""
    return next((model for model in bundled_models() if model.role == role), None)


def models_of(role: Role) -> list[InstalledModel]:
    """The installed models of a role; models without a description are last."""
    return sorted((m for m in installed_models()[0] if m.role == role), key=lambda m: (m.description is None, m.name))


def find_model(
    role: Role, name: str = "", purpose: str = "", suitable: Sequence[InstalledModel] | None = None
) -> InstalledModel | None:
    """The model of a role by its name; "bundled" selects the model that comes with NVSim.

    Without a name, it is the first installed model, or None. Raises InputError if no model has that name, or if the
    description of the model is invalid. Errors name the `purpose` of the model in place of its role, and list the
    `suitable` models in place of all installed models of the role."""
    models, problems = _find_installed()
    fitting_role = models_of(role)
    if not name:
        incomplete = next((p for p in problems if p.role == role), None)
        if not fitting_role and incomplete is not None:
            raise InputError(incomplete.message)
        return fitting_role[0] if fitting_role else None
    ours = bundled_models()
    for model in (*fitting_role, *(m for m in ours if m.role == role)):
        if name in (model.name, BUNDLED if model in ours else model.name):
            return model
    other = next((m for m in (*models, *ours) if m.name == name), None)
    if other is not None:
        raise InputError(f"{name} is a model for {ROLE_WORDS[other.role]}, not for {purpose or ROLE_WORDS[role]}.")
    broken = next((p for p in problems if p.name == name), None)
    if broken is not None:
        raise InputError(broken.message)
    if name == BUNDLED:
        raise InputError(f"No network for {ROLE_WORDS[role]} comes with NVSim; name an installed one, or geometry.")
    there = ", ".join(m.name for m in (fitting_role if suitable is None else suitable)) or "none"
    raise InputError(
        f"There is no model {name!r:.60} for {purpose or ROLE_WORDS[role]} in {models_folder()} "
        f"(installed: {there}); add it with `nvsim models add`."
    )


def _descriptions(folder: Path) -> list[Path]:
    """Every TOML that may describe a model with a role."""
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return []
    inside = [entry / DESCRIPTION for entry in entries if not entry.name.startswith(".")]
    loose = [entry for entry in entries if entry.suffix == ".toml" and _is_of_a_model(entry)]
    return [path for path in (*inside, *loose) if is_regular(path)]


def _is_of_a_model(path: Path) -> bool:
    """Whether a TOML has a role or a form, or cannot be read. Descriptions of backbones in this folder have no role."""
    try:
        values = parse_toml(read_text(path, "a description of a model", "save it as UTF-8", LARGEST), path)
    except InputError:
        return path.stem not in OLD
    return "role" in values or "form" in values
