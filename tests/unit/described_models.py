"""Models installed for a test: a folder with model.toml that follows a form, opened on the CPU."""

from __future__ import annotations

from pathlib import Path

from nvsim.networks.chain import Chain
from nvsim.networks.installed import DESCRIPTION, model_at
from nvsim.networks.known_forms import known_descriptions


def described(form: str, *paths: Path, more: str = "") -> Chain:
    """The files at `paths`, in the order of the form's, opened by its description, with `more` TOML."""
    lines = [
        f'{key} = {{ file = "{path.name}" }}' for key, path in zip(known_descriptions()[form].files, paths, strict=True)
    ]
    said = paths[0].parent / DESCRIPTION
    said.write_text(f'form = "{form}"\n{more}\n[files]\n' + "\n".join(lines) + "\n")
    return model_at(said).open("cpu")
