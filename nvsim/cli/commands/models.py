"""Commands on networks: list, install, check and train them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.terminal import as_json, print_lines
from nvsim.errors import InputError
from nvsim.recipes.config import RecipeConfig


@dataclass(frozen=True)
class Models:
    """List the installed networks with folder, author and license, and other networks that would improve results."""

    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        from nvsim.networks.catalog import catalog

        found = catalog()
        if self.json:
            print_lines(as_json(found.as_dict()))
            return 0
        print_lines(f"Models are in {found.folder}")
        for row in found.models:
            print_lines("", f"{row.name}: {row.title}", f"  gives {row.role}, improves {row.improves}")
            for line in (row.made_by and f"made by {row.made_by}", row.licence and f"license: {row.licence}"):
                if line:
                    print_lines(f"  {line}")
            print_lines(f"  {row.megabytes:,.0f} MB: {', '.join(row.files)}")
        for problem in found.problems:
            print_lines("", f"warning: {problem}")
        if found.lacking:
            print_lines("", "Not installed (download the files yourself, then run `nvsim models add FILE…`):")
        for lack in found.lacking:
            print_lines("", f"{lack.role}, which improves {lack.improves}:")
            for known in lack.known:
                print_lines(f"  {', '.join(known.names)} ({known.form}; {known.licence})", f"    {known.source}")
        return 0


@dataclass(frozen=True)
class ModelsAdd:
    """Install a network: copy the ONNX files of one model, or their folder, into the models folder with a matching
    description. The model is opened first to test it."""

    paths: Positional[tuple[Path, ...]]
    """The ONNX files of one model, with its TOML file if there is one, or the folder that contains them."""
    name: str = ""
    """Name of the model. Default: taken from its file names."""
    form: str = ""
    """The built-in description to use, such as sam2-osam. Default: the one whose tensors match."""
    replace: bool = False
    """Replace an installed model of this name."""

    def run(self) -> int:
        from nvsim.networks.description import IMPROVES, ROLE_WORDS
        from nvsim.networks.installation import add

        model = add(self.paths, self.name, self.form, self.replace)
        assert model.description is not None
        print_lines(f"{model.name} is installed in {model.folder}: {model.description.title}")
        print_lines(f"It gives {ROLE_WORDS[model.role]} and improves {IMPROVES[model.role]}.")
        return 0


@dataclass(frozen=True)
class ModelsCheck:
    """Compare installed models with their descriptions: files, checksums, tensors, and their output for a test image.
    Exits with code 1 if a model does not match its description."""

    names: Positional[tuple[str, ...]] = ()
    """Models to check. Default: all."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Returns 1 if a model has a problem. Raises InputError if a named model is not installed."""
        from nvsim.networks.installed import bundled_models, installed_models
        from nvsim.perception.checking import check

        models, problems = installed_models()
        known = {model.name: model for model in (*models, *bundled_models())}
        for name in self.names:
            if name not in known:
                raise InputError(f"There is no model {name!r:.60} (installed: {', '.join(known) or 'none'}).")
        found: dict[str, Any] = {}
        for name in self.names or known:
            result = check(known[name])
            found[name] = asdict(result)
            if not self.json:
                print_lines(f"{name}: {result.problem or f'{result.says}, {1000 * result.seconds:.0f} ms per image'}")
        broken = [] if self.names else problems
        if self.json:
            print_lines(as_json({"models": found, "problems": broken}))
        else:
            for problem in broken:
                print_lines(f"warning: {problem}")
            if not found and not broken:
                print_lines("No model is installed; `nvsim models` lists the ones that NVSim knows.")
        return 1 if broken or any(row["problem"] for row in found.values()) else 0


@dataclass(frozen=True)
class ModelsTrain:
    """Train a network of floor and surface normals in the way the bundled one was trained: on generated interiors, and
    on photographs and renders of projects, labeled by their point clouds.

    Continues a stopped training, and a finished one if you give more steps. Needs pip install "nvsim[train-networks]".
    Install the result with `nvsim models add FOLDER/semantic.toml FOLDER/interior.onnx --name NAME`, and likewise with
    normals.toml.
    """

    folder: Positional[Path]
    """Folder for examples, checkpoints and the network; 25 MB per interior."""
    projects: tuple[Path, ...] = ()
    """Projects with a LiDAR scan or with depth of images, and with floor masks. Trained projects also give renders."""
    start: Path | None = None
    """The folder of another training, or its ONNX file. Training starts from its weights."""
    json: bool = False
    """Print events as JSON lines."""
    config: Inline[RecipeConfig] = field(default_factory=RecipeConfig)

    def run(self) -> int:
        """Runs the command. Raises InputError if an option is out of range."""
        from nvsim.cli.console import event_listener

        c = self.config
        for name, least in (
            ("steps", 1),
            ("interiors", 1),
            ("views", 1),
            ("captured", 1),
            ("batch", 1),
            ("threads", 1),
        ):
            if getattr(c, name) < least:
                raise InputError(f"--{name.replace('_', '-')} {getattr(c, name)} is too small; give {least} or more.")
        if not 0 <= c.captures_share < 1:
            raise InputError(f"--captures-share {c.captures_share} is out of range; give 0 or more, and less than 1.")
        if c.save_every < 1:
            raise InputError(f"--save-every {c.save_every} is too small; give 1 or more.")
        from nvsim.recipes.making import make

        with event_listener(self.json) as listen:
            make(self.folder, c, self.projects, self.start, listen)
        return 0
