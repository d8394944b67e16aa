"""Install a model: copy its files into its own folder, together with the description that they match."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error, private_folder, write_text
from nvsim.files.opening import is_regular, opened
from nvsim.files.placeholders import is_metadata_name
from nvsim.files.reading import as_reading_error
from nvsim.networks.description import Description, File
from nvsim.networks.folder import models_folder
from nvsim.networks.installed import BUNDLED, DESCRIPTION, InstalledModel, model_at, signature_of
from nvsim.networks.known_forms import known_descriptions, matching_forms, read_description

_BESIDE = ("{stem}.onnx.data", "{stem}.onnx_data", "{stem}.data", "{stem}.bin")
"""File names that exporters give to the weights of a large network."""
_LETTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.+")


def add(paths: Sequence[Path], name: str = "", form: str = "", replace: bool = False) -> InstalledModel:
    """Install the ONNX files at `paths`, which are files or folders, as one model.

    Without a `name`, the model gets the name of the known model that the files are named after. A TOML among the files
    describes them. Otherwise they must match a description that comes with NVSim: `form`, or the form with their
    tensors. The model is opened before it is installed.

    Raises InputError if no description matches, if a model of that name exists and `replace` is False, or if the files
    cannot be written. Nothing is changed in these cases.
    """
    networks, toml = _find_model_files(paths)
    if toml is not None:
        return _install(networks, toml.parent, read_description(toml), None, name or _own_name(toml), replace, toml)
    found = _form(networks, form)
    description = known_descriptions()[found[0]]
    chosen = name or _guess_model_name(description, networks) or found[0]
    return _install(networks, networks[0].parent, description, found, chosen, replace, None)


def _find_model_files(paths: Sequence[Path]) -> tuple[list[Path], Path | None]:
    """The ONNX files, and the TOML that describes them, None without one."""
    every: list[Path] = []
    for path in paths:
        if path.is_dir():
            try:
                inside = sorted(p for p in path.iterdir() if p.suffix.lower() in (".onnx", ".toml"))
                every += [p for p in inside if not is_metadata_name(p.name)]
            except OSError as error:
                raise as_reading_error(path, error) from error
        else:
            with opened(path):  # raises InputError if it is not a file
                every.append(path)
    networks = [p for p in every if p.suffix.lower() == ".onnx"]
    tomls = [p for p in every if p.suffix.lower() == ".toml"]
    given = ", ".join(map(str, paths))
    if not networks:
        raise InputError(f"There is no ONNX file in {given}; name the .onnx files of one model, or their folder.")
    if len(tomls) > 1:
        raise InputError(f"{given} has {len(tomls)} TOML files; name the files of one model.")
    if len(networks) > 8:
        raise InputError(f"{given} has {len(networks)} ONNX files; name those of one model.")
    return networks, tomls[0] if tomls else None


def _form(networks: Sequence[Path], wanted: str) -> tuple[str, dict[str, Path]]:
    """The form that the files match, and the path of each of its files."""
    if wanted and wanted not in known_descriptions():
        raise InputError(f"There is no form {wanted!r:.60}; the forms are {', '.join(known_descriptions())}.")
    forms = [(f, files) for f, files in matching_forms({p: signature_of(p) for p in networks}) if wanted in ("", f)]
    if not forms:
        names = " and ".join(p.name for p in networks)
        of = f"the form {wanted}" if wanted else f"none of the forms {', '.join(known_descriptions())}"
        raise InputError(
            f"{names} fit{'s' if len(networks) == 1 else ''} {of}; describe the model in a TOML beside "
            f"{'it' if len(networks) == 1 else 'them'} (documentation page 'Networks that you install') and add both."
        )
    return forms[0]


def _guess_model_name(description: Description, networks: Sequence[Path]) -> str:
    """The longest known model name whose parts all occur in the names of the files and their folder; "" if none."""
    words = " ".join([networks[0].absolute().parent.name, *(p.name for p in networks)]).lower()
    known = [n for n in description.names if all(part in words for part in n.replace(".", "-").split("-"))]
    return max(known, key=len, default="")


def _own_name(toml: Path) -> str:
    return toml.absolute().parent.name if toml.name == DESCRIPTION else toml.stem


def _install(
    networks: Sequence[Path],
    source: Path,
    description: Description,
    form: tuple[str, dict[str, Path]] | None,
    name: str,
    replace: bool,
    toml: Path | None,
) -> InstalledModel:
    if not name or not set(name) <= _LETTERS or name.startswith(".") or len(name) > 80:
        raise InputError(f"A model cannot be called {name!r:.80}; use letters, digits, - and . (--name NAME).")
    if name.startswith(BUNDLED):
        raise InputError(f"{name} is reserved for models that come with NVSim; choose another --name.")
    folder = models_folder()
    target = folder / name
    if target.exists() and not replace:
        raise InputError(f"{target} already exists; give --replace, or another --name.")
    with private_folder(folder / name) as made:
        files = description.files if form is None else {k: _file(p) for k, p in form[1].items()}
        where = {f.name: source for f in files.values()} | {p.name: p.parent for p in networks}
        sums = {}
        for file in files.values():
            for each in (file.name, *file.beside):
                sums[each] = _copy_with_hash(where.get(each, where[file.name]) / each, made / each)
        if form is None:
            assert toml is not None
            _copy_with_hash(toml, made / DESCRIPTION)
        else:
            write_text(made / DESCRIPTION, _toml_text(form[0], files, sums))
        model_at(made / DESCRIPTION).open("cpu")
        _install_folder(made, target)
    return model_at(target / DESCRIPTION)


def _install_folder(made: Path, target: Path) -> None:
    """Move a complete model to its final folder. An existing model is moved away first, and restored if the move
    fails."""
    old = made.with_name(made.name + "-old")
    try:
        if target.exists():
            os.replace(target, old)
        try:
            os.chmod(made, 0o755)
            os.replace(made, target)
        except OSError:
            if old.exists():
                os.replace(old, target)
            raise
    except OSError as error:
        raise as_input_error(target, error) from error
    shutil.rmtree(old, ignore_errors=True)


def _file(path: Path) -> File:
    names = (pattern.format(stem=path.stem) for pattern in _BESIDE)
    return File(path.name, tuple(n for n in names if is_regular(path.with_name(n))))


def _copy_with_hash(source: Path, target: Path) -> str:
    """Copy a file and return its SHA-256 in hexadecimal."""
    digest = hashlib.sha256()
    with opened(source) as file:
        try:
            with open(target, "xb") as written:
                while part := file.read(1 << 22):
                    digest.update(part)
                    written.write(part)
        except OSError as error:
            raise as_input_error(target, error) from error
    return digest.hexdigest()


def _toml_text(form: str, files: dict[str, File], sums: dict[str, str]) -> str:
    """The TOML of a model that uses a form. JSON strings are valid TOML strings."""

    def text(value: str) -> str:
        return json.dumps(value, ensure_ascii=False)

    lines = [f"form = {text(form)}", "", "[files]"]
    for key, file in files.items():
        beside = f", beside = [{', '.join(map(text, file.beside))}]" if file.beside else ""
        lines.append(f"{key} = {{ file = {text(file.name)}{beside}, sha256 = {text(sums[file.name])} }}")
    return "\n".join(lines) + "\n"
