"""The configuration of training: one frozen dataclass, grouped, with the paper's values and symbols."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field, replace
from typing import Literal

from nvsim.errors import InputError
from nvsim.training.strategies.config import AdaptiveConfig, DensifyConfig

Device = Literal["auto", "cpu", "cuda"]


@dataclass(frozen=True)
class LossConfig:
    """Every term is a mean over all pixels of the image, so that weights do not depend on the image size. A weight of 0
    switches its term off."""

    ssim: float = 0.2
    """lambda_SSIM: share of 1 - SSIM against L1 in the reconstruction loss (paper, section III-C)."""
    suppression: float = 1.0
    """lambda_supp: weight of |M * alpha|, which keeps Gaussians off the floor (paper, L_floor_supp)."""
    floor: float = 1.0
    """lambda_bg: weight of |M * (background - image)|, which paints the floor (paper, L_floor_bg)."""
    fill: float = 0.1
    """Weight of (1 - M) * (1 - alpha), the opposite of the suppression: pixels that are not floor must be opaque. Not
    in the paper."""
    alpha: float = 0.0
    """Weight of alpha in pixels that the background explains (Splatfacto-W: 0.15). The paper drops this term; it is for
    the ablation."""
    mask_floor: bool = False
    """Leaves the floor out of the reconstruction loss even if no floor term is on (the paper's second ablation row). A
    floor term always leaves it out."""

    @property
    def masks_floor(self) -> bool:
        """Whether the reconstruction loss leaves out the floor."""
        return self.mask_floor or self.suppression > 0 or self.floor > 0


@dataclass(frozen=True)
class RateConfig:
    """Learning rates of Adam, for scenes in meters."""

    means: float = 5e-4
    """Learning rate of the means of the Gaussians, at the first step."""
    means_end: float = 5e-5
    """Learning rate of the means at the last step; the decay is exponential."""
    log_scales: float = 1e-2
    """Learning rate of the logarithms of the standard deviations."""
    quats: float = 1e-3
    """Learning rate of the rotations."""
    opacity_logits: float = 3e-2
    """Learning rate of the logits of the opacities."""
    sh_dc: float = 2.5e-3
    """Learning rate of the constant part of the colors."""
    sh_rest: float = 1.25e-4
    """Learning rate of the harmonics of degree 1 and above."""
    network: float = 2e-3
    """Learning rate of the background and color networks, at the first step."""
    network_end: float = 2e-4
    """Learning rate of these networks at the last step."""
    embedding: float = 2e-3
    """Learning rate of the embedding; it decays like that of the networks."""
    features: float = 2.5e-3
    """Learning rate of the features that give Gaussians their color by position, at the first step."""
    features_end: float = 2.5e-4
    """Learning rate of the features at the last step."""
    texture: float = 4e-3
    """Learning rate of the floor texture, at the first step."""
    texture_end: float = 2e-4
    """Learning rate of the floor texture at the last step. A constant rate leaves colored noise on the floor."""
    exposure: float = 0.02
    """Learning rate of the logarithms of the gains, per visit to a view."""


@dataclass(frozen=True)
class RobustConfig:
    """Leaves transients (people walking by) out of the losses."""

    kind: Literal["blocks", "quantile", "none"] = "blocks"
    """"blocks": masks blocks of pixels whose error stays large over the visits of a view although the rest of it fits.
    "quantile": masks a share of the worst pixels of each image, which depends only on its error (Splatfacto-W)."""
    start: float = 0.4
    """Share of all steps before masking begins, because in earlier steps the error is large everywhere."""
    threshold: float = 0.15
    """Least error of the mean color of an outlier block."""
    factor: float = 4.0
    """An outlier block must also exceed this many times the median error of the image's blocks."""
    most: float = 0.4
    """Greatest share of an image that is masked (Splatfacto-W's upper bound)."""
    renewal: float = 0.11
    """Share of the steps after which "quantile" resets the largest error that it saw (Splatfacto-W: 6000 of 55000)."""


@dataclass(frozen=True)
class AppearanceConfig:
    """How colors depend on the camera: an embedding controls the background and the colors of the Gaussians."""

    embedding: Literal["position", "index", "none"] = "position"
    """Source of the embedding: a network of the camera position (paper, section III-C), a vector per training image
    (Splatfacto-W), or one learned vector for all ("none")."""
    evaluation: Literal["mean", "nearest"] = "mean"
    """With "index", the vector of a view that is not a training view: the mean of all, or that of the nearest
    camera."""
    size: int = 24
    """Number of values in an embedding."""
    kind: Literal["none", "linear", "network"] = "linear"
    """How Gaussians get their colors: their own only, with an offset that is bilinear in embedding and features (for
    CPUs), or from the color network of Splatfacto-W."""
    features: int = 6
    """Number of features per Gaussian from which the colors are computed."""
    layers: int = 2
    """Layers of the color network; its heads count as one."""
    width: int = 128
    """Width of the color network."""
    background_layers: int = 3
    """Layers of the background network; its heads count as one."""
    background_width: int = 128
    """Width of the background network."""
    background_interval: float = 0.0
    """Share of the steps after which each further degree of the background's harmonics is added; 0: all at once."""


@dataclass(frozen=True)
class ScanlessConfig:
    """Changes for captures with depth from images instead of a LiDAR scan, because their Gaussians start one or two
    centimeters from their correct place."""

    steps: float = 2.0
    """Factor on the number of steps."""
    means: float = 4.0
    """Factor on the learning rate of the means at the first step."""
    means_end: float = 2.0
    """Factor on the learning rate of the means at the last step."""


@dataclass(frozen=True)
class TrainingConfig:
    """Configuration of the training of one submap. `preset` returns the named ones. Raises InputError for values out of
    range."""

    name: str = "nvsim"
    """The preset from which this configuration was made."""
    steps: int = 2000
    """Updates of the model, one training image each."""
    image_size: int = 640
    """Longest side of the training images, pixels."""
    coarse_share: float = 0.5
    """Share of the steps, from the first, that train below that size."""
    coarse_levels: int = 1
    """How many times that size is halved at the first step; every size gets an equal number of steps."""
    gaussian_cap: int = 80_000
    """Greatest number of Gaussians of the model at any time."""
    seed_share: float = 0.7
    """Share of the cap that is placed at the start, if the cloud has enough points."""
    seed_height: float = 0.04
    """Meters above the floor below which cloud points do not seed Gaussians; 0 or less keeps all points."""
    seed_detail: float = 1.0
    """How much denser a LiDAR scan seeds where its colors vary: the exponent of their local deviation; 0 is uniform."""
    seed_flatness: float = 0.15
    """Thickness of the seeds of a LiDAR scan along the surface normal, relative to their width; 1 is round."""
    seed_size: float = 0.5
    """Standard deviation of the seeds relative to the mean distance of their three neighbors."""
    seed_opacity: float = 0.5
    """Opacity of a Gaussian at the start."""
    sh_degree: int = 1
    """Highest degree of the spherical harmonics of a Gaussian's color, 0 to 3."""
    sh_interval: float = 0.15
    """Share of the steps after which each further degree of the spherical harmonics is added."""
    random_background: bool = False
    """Without a background network: uses another background color at every step, so that the model becomes opaque."""
    background: bool = True
    """Whether a background network fills the transparent parts of the image (paper, section III-C)."""
    texture: bool = True
    """Whether the floor surface has a learned texture. Not in the paper."""
    exposure: bool = False
    """Whether a gain per image and channel is learned and left out of the model: for cameras with automatic
    exposure."""
    antialiased: bool = True
    """Opacity compensation of Mip-Splatting, so that training at half size and rendering at full size agree."""
    loss: LossConfig = field(default_factory=lambda: LossConfig(suppression=2.0))
    """Twice the paper's suppression, because the fill term counteracts it at the edge of the floor. The mean alpha of
    the floor in novel views is 0.017 instead of 0.021, at a cost of 0.2 dB elsewhere."""
    rate: RateConfig = field(default_factory=RateConfig)
    scanless: ScanlessConfig = field(default_factory=ScanlessConfig)
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    densify: DensifyConfig = field(default_factory=DensifyConfig)
    robust: RobustConfig = field(default_factory=RobustConfig)
    device: Device = "auto"
    """Where the Gaussians are trained: on a CUDA GPU with gsplat, on the CPU, or auto for the GPU if there is one. A
    run can continue on the other device."""
    threads: int = 0
    """Threads of the kernels; 0 means all cores. Runs are repeatable with an equal number of threads."""
    checkpoint_seconds: float = 15.0
    """Greatest time between two checkpoints, which otherwise take 2 % of the time; seconds."""

    def __post_init__(self) -> None:
        look = self.appearance
        for what, fine in (
            ("steps must be at least 1", self.steps >= 1),
            ("scanless must be 0.1 to 100", all(0.1 <= times <= 100 for times in astuple(self.scanless))),
            ("image_size must be at least 32 pixels", self.image_size >= 32),
            ("gaussian_cap must be at least 100", self.gaussian_cap >= 100),
            ("sh_degree must be 0 to 3", 0 <= self.sh_degree <= 3),
            ("coarse_share must be 0 to 1", 0 <= self.coarse_share <= 1),
            ("seed_share must be above 0 and at most 1", 0 < self.seed_share <= 1),
            ("coarse_levels must be 0 to 4", 0 <= self.coarse_levels <= 4),
            ("seed_opacity must be between 0 and 1", 0 < self.seed_opacity < 1),
            ("sh_interval must not be negative", self.sh_interval >= 0),
            ("texture needs background", self.background or not self.texture),
            ("appearance.kind needs an embedding", look.kind == "none" or look.embedding != "none"),
            ("appearance.size, features, width must be at least 1", min(look.size, look.features, look.width) >= 1),
            ("appearance.layers must be at least 2", look.layers >= 2),
            ("appearance.background-layers must be at least 1", look.background_layers >= 1),
        ):
            if not fine:
                raise InputError(f"Training configuration: {what}; change it and try again.")

    def without_scan(self) -> TrainingConfig:
        """The configuration for a capture whose depth comes from its images."""
        times, rate = self.scanless, self.rate
        faster = replace(rate, means=rate.means * times.means, means_end=rate.means_end * times.means_end)
        return replace(self, steps=max(1, round(self.steps * times.steps)), rate=faster)

    @property
    def floor_aware(self) -> bool:
        """Whether a loss term treats the floor separately."""
        return self.loss.suppression > 0 or self.loss.floor > 0


UNIT = 5.0
"""Meters per unit of nerfstudio's scenes: it scales the cameras to +-1, and a submap is about 10 m wide."""


def _splatfacto() -> TrainingConfig:
    """Splatfacto's rules (nerfstudio, models/splatfacto.py), with times as shares of its 30,000 steps and lengths times
    UNIT.

    Changes, because a fixed number of Adam steps is a larger share of a run that is twenty times shorter:

    - There is a cap, and a refinement every 100 steps as in the original, so that there are fewer refinements.
    - There is no opacity reset (original: `densify.adaptive.reset` 0.1). Dimmed Gaussians need some 150 steps to
      recover.
    - The means have our rate. The original has 8e-4 to 8e-6 m (Splatfacto-W: 8e-5 to 8e-7 m).
    - Seeds are half opaque. In the original they have 0.1, which is also its culling limit. Half of the seeds were
      removed in the first refinement, and a background explained the gaps in the walls.
    - Scales have our rate, twice the original.

    `at_paper_scale` reverts all of these. For the effect of each see resources/docs/method.md, "The baselines".
    """
    return TrainingConfig(
        name="3dgs",
        coarse_share=0.2,
        coarse_levels=2,
        seed_height=0.0,
        seed_detail=0.0,
        seed_flatness=1.0,
        seed_size=1.0,
        seed_opacity=0.5,
        sh_degree=3,
        sh_interval=1 / 30,
        background=False,
        random_background=True,
        texture=False,
        appearance=AppearanceConfig(kind="none"),
        antialiased=False,
        loss=LossConfig(suppression=0.0, floor=0.0, fill=0.0),
        rate=RateConfig(opacity_logits=5e-2),
        densify=DensifyConfig(
            strategy="adaptive",
            start=0.017,
            stop=0.5,
            prune_opacity=0.1,
            largest=0.5 * UNIT,
            adaptive=AdaptiveConfig(small=0.01 * UNIT, screen_stop=0.13, reset=0.0),
        ),
        robust=RobustConfig(kind="none"),
    )


def _splatfacto_w() -> TrainingConfig:
    """Splatfacto-W's rules (splatfactow_config.py and _model.py), with times as shares of its 55,000 steps and lengths
    times UNIT.

    Changes: as above, and no robust mask. The original mask begins at step 6000, when remaining errors are transients.
    In a shorter run, the worst pixels of an image are walls that are not learned yet. If the mask is on, no part of the
    image is exempt, because there is no sky indoors, and it applies to L1 as well as SSIM. A view outside the training
    set gets the embedding of the nearest image, because the networks never saw the mean. The alpha loss is a mean over
    the image. The embedding and the color network have the sizes of the original light model, made for any data.
    """
    base = _splatfacto()
    return replace(
        base,
        name="splatfacto-w",
        coarse_share=0.11,
        sh_interval=0.036,
        background=True,
        random_background=False,
        antialiased=True,
        loss=replace(base.loss, alpha=0.15),
        rate=RateConfig(network_end=1e-4, features=2e-2, features_end=1e-3),
        appearance=AppearanceConfig("index", "nearest", kind="network", features=32, background_interval=0.018),
        densify=replace(
            base.densify,
            start=0.018,
            stop=0.36,
            adaptive=AdaptiveConfig(small=0.01 * UNIT, screen_stop=0.27, reset=0.0),
        ),
    )


def _splatfacto_i() -> TrainingConfig:
    """The paper's model: Splatfacto-W with the floor terms, with the camera position instead of the image index, and
    without the alpha loss."""
    base = _splatfacto_w()
    return replace(
        base,
        name="splatfacto-i",
        seed_height=0.04,
        appearance=replace(base.appearance, embedding="position"),
        loss=LossConfig(suppression=1.0, floor=1.0, fill=0.0),
    )


FULL_SIZE = 16_384
"""Greatest side of an image in pixels. Images are never enlarged, so this stands for their own size."""


def at_paper_scale(config: TrainingConfig) -> TrainingConfig:
    """A preset's configuration at the size of the paper's models, which needs a GPU: 30,000 steps, full-size images, a
    million Gaussians per submap, and the embedding and networks of the full Splatfacto-W. A color network replaces the
    linear form, which is for CPUs. `splatfacto-i`, `splatfacto-w`, and `3dgs` also get back the original rules that
    short runs cannot afford, see `_splatfacto`."""
    look, kind = config.appearance, config.appearance.kind
    look = replace(look, size=48, background_layers=3, background_width=128)
    if kind != "none":
        look = replace(look, kind="network", features=72, layers=3, width=256)
    config = replace(
        config,
        steps=30_000,
        scanless=ScanlessConfig(1.0, 1.0, 1.0),
        image_size=FULL_SIZE,
        gaussian_cap=1_000_000,
        appearance=look,
        checkpoint_seconds=120.0,
    )
    if config.name == "nvsim":
        return config
    light = config.name == "3dgs"
    start, end = (1.6e-4, 1.6e-6) if light else (1.6e-5, 1.6e-7)
    adaptive = replace(config.densify.adaptive, reset=0.1 if light else 2500 / 55_000)
    return replace(
        config,
        seed_opacity=0.1,
        rate=replace(config.rate, means=start * UNIT, means_end=end * UNIT, log_scales=5e-3),
        densify=replace(config.densify, adaptive=adaptive),
        robust=RobustConfig(kind="none") if light else RobustConfig(kind="quantile", start=0.2, renewal=0.2),
    )


_PRESETS = {
    "nvsim": TrainingConfig,
    "splatfacto-i": _splatfacto_i,
    "splatfacto-w": _splatfacto_w,
    "3dgs": _splatfacto,
}
PRESETS = tuple(_PRESETS)
Preset = Literal["nvsim", "splatfacto-i", "splatfacto-w", "3dgs"]


def preset(name: str) -> TrainingConfig:
    """The configuration of a preset.

    "nvsim"         the default: the paper's method with floor texture, fill, and the linear form of its colors
    "splatfacto-i"  the paper: floor suppression and background floor loss, colors by camera position; no texture, no
                    fill
    "splatfacto-w"  the base of the paper: background and colors by image, alpha loss; no special treatment of the floor
    "3dgs"          Splatfacto, Gaussians only: no floor terms, no background, no robust mask

    Raises InputError for another name.
    """
    if name not in _PRESETS:
        raise InputError(f"There is no training preset {name!r}; choose one of {', '.join(PRESETS)}.")
    return _PRESETS[name]()
