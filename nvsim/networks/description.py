"""What is said of a model: its files, what goes into them and comes out, and what that means. A model plays one role:
floor by its looks ("semantic"), surface normals ("normals"), or the region at points ("prompted")."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from nvsim.networks.preparing import Preparation

Role = Literal["semantic", "normals", "prompted"]
Meaning = Literal["logits", "probabilities", "labels"]
Direction = Literal["right", "left", "down", "up", "forward", "backward"]
Kind = Literal["", "float", "int"]
Frame = Literal["camera", "level"]

GIVEN = ("points", "labels", "height_width", "timestep", "rays")
"""Values that a model is given beside its images: points and labels of a prompt, the image's height and width, the step
of a scheduler, and (1, 3, rows, columns) the rays of the pixels of the result's image: unit vectors right, down and
forward of the camera turned level."""

OF_PROMPTS = ("points", "labels")


@dataclass(frozen=True)
class File:
    """name    of the ONNX file, beside the description
    beside  names of files that hold its weights; they must not be renamed
    sha256  hexadecimal, "" where nobody said
    """

    name: str
    beside: tuple[str, ...] = ()
    sha256: str = ""


@dataclass(frozen=True)
class Tensor:
    """One input or output of a file, and the value that it takes or gives.

    values    the value's name; several are joined along their second axis before they go in
    names     what exports call the tensor; it is bound by the first that the file has
    shape     0 where any; binds where the file has none of the names, and is checked where it has
    kind      of its numbers, "" where any
    optional  whether files without it are right too
    factor    is multiplied with the value
    item      the entry along the first axis that is taken, None for all
    copies    of the value along the first axis
    """

    values: tuple[str, ...]
    names: tuple[str, ...] = ()
    shape: tuple[int, ...] | None = None
    kind: Kind = ""
    optional: bool = False
    factor: float = 1.0
    item: int | None = None
    copies: int = 1


@dataclass(frozen=True)
class Step:
    """A run of one file; with a scheduler's name in `loop`, one run for each of its steps."""

    file: str
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    loop: str = ""


@dataclass(frozen=True)
class Constant:
    """A value that is always the same: `numbers`, one or as many as `shape` holds (None: as the input has it), or, with
    a `seed`, normally distributed ones of the shape of the value `like`, `copies` times along the first axis. Where the
    user must say it, `needed` tells what it is."""

    numbers: tuple[float, ...] = ()
    shape: tuple[int, ...] | None = None
    seed: int | None = None
    like: str = ""
    copies: int = 1
    needed: str = ""


@dataclass(frozen=True)
class Scheduler:
    """DDIM (Song et al. 2021) as diffusers has it, without noise: the numbers of a scheduler_config.json.

    state       the value that is denoised
    prediction  the value that the network says of it, and what that is
    """

    state: str
    prediction: str
    predicts: Literal["epsilon", "v_prediction", "sample"]
    steps: int = 10
    trained: int = 1000
    first_beta: float = 0.00085
    last_beta: float = 0.012
    betas: Literal["scaled_linear", "linear"] = "scaled_linear"
    spacing: Literal["leading", "trailing"] = "leading"
    offset: int = 1
    ends_at_one: bool = False


@dataclass(frozen=True)
class Points:
    """image      whose pixels the points are given in; "" for those of the image as it was asked about
    padding    whether a point that is none, label -1, is to follow them
    negatives  whether the model knows points that must not be in the region
    """

    image: str = ""
    padding: bool = False
    negatives: bool = True


@dataclass(frozen=True)
class FloorResult:
    """classes   of the output; 1 of a network that knows floor only. An output with one more has background first
    floor     which of them are floor
    scores    the value with the quality of each of several masks of floor, of which the best is taken; "" where there
              is one
    """

    value: str
    image: str
    meaning: Meaning
    channels_last: bool = False
    classes: int = 1
    floor: tuple[int, ...] = (0,)
    scores: str = ""


@dataclass(frozen=True)
class NormalsResult:
    """axes    where the output's first, second and third number point, for a camera that looks forward
    frame   "level" where they are those of the camera turned level
    halved  whether the output is (n + 1) / 2
    there   the value that is below `least` where there is no surface, "" where there is none
    """

    value: str
    image: str
    axes: tuple[Direction, Direction, Direction]
    channels_last: bool = False
    halved: bool = False
    there: str = ""
    least: float = 0.5
    frame: Frame = "camera"


@dataclass(frozen=True)
class MaskResult:
    """image   which image the masks cover, "" where they have the size of the one that was asked about
    scores  the value with the quality of each mask, "" where there is none
    single  of four masks the first is the one for clear prompts: "skip" takes the best of the others, "best" the best
            of all, "first" the first
    """

    value: str
    image: str
    scores: str = ""
    single: Literal["skip", "best", "first"] = "skip"


Result = FloorResult | NormalsResult | MaskResult


@dataclass(frozen=True)
class Description:
    """A model as its TOML says it.

    title, made_by, licence, source   texts for the user
    names    what models of this form are called
    images   what the model is shown, by name; the sizes that a file prescribes come before those said here
    """

    role: Role
    title: str
    files: dict[str, File]
    images: dict[str, Preparation]
    steps: tuple[Step, ...]
    result: Result
    points: Points | None = None
    constants: dict[str, Constant] = field(default_factory=dict)
    schedulers: dict[str, Scheduler] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    made_by: str = ""
    licence: str = ""
    source: str = ""
