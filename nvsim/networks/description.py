"""The description of a model: its files, their inputs and outputs, and the meaning of the outputs.

A model has one role: floor by appearance ("semantic"), surface normals ("normals"), the region at points ("prompted"),
or keypoints with descriptors and their matches ("features").
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from nvsim.networks.image_preparation import Preparation

Role = Literal["semantic", "normals", "prompted", "features"]
Meaning = Literal["logits", "probabilities", "labels"]
Direction = Literal["right", "left", "down", "up", "forward", "backward"]
Kind = Literal["", "float", "int"]
Frame = Literal["camera", "level"]

GIVEN = ("points", "labels", "height_width", "timestep", "rays")
"""Values that a model can use beside its images.

The points and labels of a prompt, the height and width of the image, the timestep of a scheduler, and the rays
(1, 3, rows, columns) of the result image's pixels. Rays are unit vectors right, down, and forward of the camera after
it is rotated to level."""

OF_PROMPTS = ("points", "labels")
OF_PAIRS = tuple(f"{name}_{k}" for name in ("keypoints", "centered", "descriptors", "size") for k in (0, 1))
"""Values of two images that a matcher can use, float32.

keypoints_0    (1, N, 2) pixels; the center of the first pixel is at 0
centered_0     (1, N, 2) distance from the image center over half the longer side, as LightGlue normalizes keypoints
descriptors_0  (1, N, D)
size_0         (1, 2) width and height, pixels
"""


def given_values(role: Role) -> tuple[str, ...]:
    """Names of the values that NVSim gives to the steps of a model with this role."""
    if role == "prompted":
        return tuple(name for name in GIVEN if name != "rays")
    known = tuple(name for name in GIVEN if name not in OF_PROMPTS)
    return (*(name for name in known if name != "rays"), *OF_PAIRS) if role == "features" else known


@dataclass(frozen=True)
class File:
    """name    name of the ONNX file, in the folder of the description
    beside  names of the files with its weights; they must not be renamed
    sha256  hexadecimal, "" if unknown
    """

    name: str
    beside: tuple[str, ...] = ()
    sha256: str = ""


@dataclass(frozen=True)
class Tensor:
    """An input or output of a file, and the value that it receives or gives.

    values    name of the value; several values are concatenated along their second axis for an input
    names     names of the tensor in exports; the first name that the file has is bound
    shape     0 for any side. It binds the tensor if the file has none of the names, and is checked otherwise
    kind      type of its numbers, "" for any
    optional  whether the file may lack the tensor
    factor    multiplied with the value
    item      index along the first axis to select, None for all
    copies    number of copies of the value along the first axis
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
    """A run of one file. If `loop` names a scheduler, the file runs once for each of its steps."""

    file: str
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    loop: str = ""


@dataclass(frozen=True)
class Constant:
    """A constant value.

    It is `numbers`: one number, or as many as `shape` holds (None: the shape of the input). With a `seed`, it is
    normally distributed noise with the shape of the value `like`, `copies` times along the first axis. If the user must
    set it, `needed` describes it."""

    numbers: tuple[float, ...] = ()
    shape: tuple[int, ...] | None = None
    seed: int | None = None
    like: str = ""
    copies: int = 1
    needed: str = ""


@dataclass(frozen=True)
class Scheduler:
    """DDIM (Song et al. 2021) as in diffusers, without noise: the parameters of a scheduler_config.json.

    state       the value that is denoised
    prediction  the value that the network predicts; `predicts` is its meaning
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
    """image      the image whose pixels the points refer to; "" for the original image
    padding    whether an empty point with label -1 must follow the points
    negatives  whether the model supports points that must not be in the region
    """

    image: str = ""
    padding: bool = False
    negatives: bool = True


@dataclass(frozen=True)
class FloorResult:
    """classes   number of classes in the output; 1 if the network detects floor only. If the output has one more
              channel, the first is the background
    floor     indices of the classes that are floor
    people    indices of the classes that are people, empty if there are none
    objects   names of objects, and the indices of the classes with each name
    scores    the value with the quality of each of several floor masks, of which the best is used; "" for a single mask
    """

    value: str
    image: str
    meaning: Meaning
    channels_last: bool = False
    classes: int = 1
    floor: tuple[int, ...] = (0,)
    scores: str = ""
    people: tuple[int, ...] = ()
    objects: tuple[tuple[str, tuple[int, ...]], ...] = ()


@dataclass(frozen=True)
class NormalsResult:
    """axes    directions of the output's first, second, and third number, for a camera that looks forward
    frame   "level" if the directions refer to the camera after it is rotated to level
    halved  whether the output is (n + 1) / 2
    there   the value that is below `least` where there is no surface, "" if there is none
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
    """image   the image that the masks cover, "" if they have the size of the original image
    scores  the value with the quality of each mask, "" if there is none
    single  use of the first of four masks, which is for unambiguous prompts: "skip" selects the best of the others,
            "best" the best of all, "first" the first
    """

    value: str
    image: str
    scores: str = ""
    single: Literal["skip", "best", "first"] = "skip"


@dataclass(frozen=True)
class FeaturesResult:
    """value         the value with the keypoints (1, N, 2): pixels of the image, the center of the first pixel at 0, or
                  -1 to 1 from the first to the last pixel of each axis
    descriptors   the value with their descriptors (1, N, D)
    scores        the value with their scores (1, N), "" if the best keypoints are first
    matches       the value with the matches of two images: (M, 2) indices, or for each keypoint of the first image the
                  index in the second, -1 without a match. "" if the model does not match
    match_scores  the value with the scores of the rows of `matches`, "" if there is none. Scores below
                  `least` are no match
    """

    value: str
    image: str
    descriptors: str
    scores: str = ""
    matches: str = ""
    match_scores: str = ""
    least: float = 0.1


Result = FloorResult | NormalsResult | MaskResult | FeaturesResult


@dataclass(frozen=True)
class Description:
    """A model as described in its TOML.

    title, made_by, licence, source   texts for the user
    names    names of the models with this form
    images   input images of the model, by name; sizes that a file requires override the sizes here
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


ROLE_WORDS: dict[Role, str] = {
    "semantic": "floor segmentation",
    "normals": "surface normals",
    "prompted": "segmentation at points",
    "features": "keypoints and their matches",
}
IMPROVES: dict[Role, str] = {
    "semantic": "floor masks: holes of a LiDAR scan, and captures without one (`nvsim floors --provider auto`); "
    "names of objects in instructions, if it knows any (`nvsim export tasks --objects NAME`)",
    "normals": "the paper's normals of the map (`nvsim map --normal-source network`), and hybrid floor masks",
    "prompted": "corrections of masks by points, and the last step of hybrid floor masks",
    "features": "camera poses of videos and photographs (`nvsim poses --features NAME`)",
}
SINGLE_FILES = {
    "lpips": "LPIPS among the metrics of `nvsim evaluate views`",
    "features": "image features in the files that agents read (`nvsim export features`)",
}
"""Files NAME.onnx or NAME.….onnx in the models folder that have no role in perception."""
