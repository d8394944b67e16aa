"""The configuration of training: one frozen dataclass, grouped, with the paper's values and symbols."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field, replace
from typing import Literal

from nvsim.errors import InputError
from nvsim.training.strategies.config import AdaptiveConfig, DensifyConfig

Device = Literal["auto", "cpu", "cuda"]


@dataclass(frozen=True)
class LossConfig:
    """Every term is a mean over all pixels of the image, so that a weight means the same at every size. A weight of 0
    switches its term off."""

    ssim: float = 0.2
    """lambda_SSIM: share of 1 - SSIM against L1 in the reconstruction loss (paper, section III-C)."""
    suppression: float = 1.0
    """lambda_supp: weight of |M * alpha|, which keeps Gaussians off the floor (paper, L_floor_supp)."""
    floor: float = 1.0
    """lambda_bg: weight of |M * (background - image)|, which paints the floor (paper, L_floor_bg)."""
    fill: float = 0.1
    """Weight of (1 - M) * (1 - alpha), the mirror image of the suppression: what is not floor is a surface. Not in the
    paper."""
    alpha: float = 0.0
    """Weight of alpha where the background explains the pixel (Splatfacto-W: 0.15). The paper drops it; for the
    ablation."""
    mask_floor: bool = False
    """Takes the floor out of the reconstruction loss although no floor term is on (the paper's second ablation row). A
    floor term takes it out in any case."""

    @property
    def masks_floor(self) -> bool:
        """Whether the reconstruction loss leaves out the floor."""
        return self.mask_floor or self.suppression > 0 or self.floor > 0


@dataclass(frozen=True)
class RateConfig:
    """Learning rates of Adam, for scenes in metres."""

    means: float = 5e-4
    """Of the centres, at the first step."""
    means_end: float = 5e-5
    """Decays exponentially from the first to the last step."""
    log_scales: float = 1e-2
    """Of the logarithms of the standard deviations."""
    quats: float = 1e-3
    """Of the rotations."""
    opacity_logits: float = 3e-2
    """Of the logits of the opacities."""
    sh_dc: float = 2.5e-3
    """Of the colours' constant part."""
    sh_rest: float = 1.25e-4
    """Of the harmonics of degree 1 and above."""
    network: float = 2e-3
    """Of the background and colour networks, at the first step."""
    network_end: float = 2e-4
    """At the last step."""
    embedding: float = 2e-3
    """Decays as the networks' rate does."""
    features: float = 2.5e-3
    """Of the vectors from which Gaussians are coloured by position."""
    features_end: float = 2.5e-4
    """At the last step."""
    texture: float = 4e-3
    """Of the floor texture, at the first step."""
    texture_end: float = 2e-4
    """A constant rate leaves coloured noise on the floor."""
    exposure: float = 0.02
    """Of the logarithms of the gains, per visit to a view."""


@dataclass(frozen=True)
class RobustConfig:
    """Transients (people walking by) are taken out of the losses."""

    kind: Literal["blocks", "quantile", "none"] = "blocks"
    """"blocks": blocks of pixels that stay wrong over the visits of a view although the rest of it fits. "quantile":
    Splatfacto-W's, a share of the worst pixels of each image that follows its error, whatever the picture shows."""
    start: float = 0.4
    """Share of all steps before anything is masked: until then everything is wrong."""
    threshold: float = 0.15
    """A block is an outlier when its mean colour is off by more than this..."""
    factor: float = 4.0
    """...and this many times the median over the image's blocks."""
    most: float = 0.4
    """No more than this share of an image is masked (Splatfacto-W's upper bound)."""
    renewal: float = 0.11
    """Share of the steps after which "quantile" forgets the largest error it saw (Splatfacto-W: 6000 of 55000)."""


@dataclass(frozen=True)
class AppearanceConfig:
    """What makes the look depend on the camera: an embedding, which feeds the background and the Gaussians' colours."""

    embedding: Literal["position", "index", "none"] = "position"
    """Of what: a network of the camera position (paper, section III-C), a vector per training image (Splatfacto-W), or
    nothing, one learned vector."""
    evaluation: Literal["mean", "nearest"] = "mean"
    """The vector of a view that was not trained on, with "index": the mean of all, or that of the nearest camera."""
    size: int = 24
    """Numbers in an embedding."""
    kind: Literal["none", "linear", "network"] = "linear"
    """How Gaussians are coloured: by themselves, with an offset that is bilinear in embedding and features (for CPUs),
    or by the colour network of Splatfacto-W."""
    features: int = 6
    """Numbers per Gaussian that the colours are made from."""
    layers: int = 2
    """Layers of the colour network, its heads counting as one."""
    width: int = 128
    """Width of the colour network."""
    background_layers: int = 3
    """Layers of the background network, its heads counting as one."""
    background_width: int = 128
    """Width of the background network."""
    background_interval: float = 0.0
    """Share of the steps after which each further degree of the background's harmonics joins; 0: all at once."""


@dataclass(frozen=True)
class ScanlessConfig:
    """What changes where the depth of the images stands in for a scan: Gaussians begin a centimetre or two beside where
    they belong."""

    steps: float = 2.0
    """Times as many steps."""
    means: float = 4.0
    """Times as fast the centres move at the first step,"""
    means_end: float = 2.0
    """and at the last."""


@dataclass(frozen=True)
class TrainingConfig:
    """How one submap is trained. `preset` makes the named ones."""

    name: str = "nvsim"
    """The preset this was made from."""
    steps: int = 2000
    """Updates of the model, one training image each."""
    image_size: int = 640
    """Longest side of the training images, pixels."""
    coarse_share: float = 0.5
    """Share of the steps, from the first, that train below that size."""
    coarse_levels: int = 1
    """How often that size is halved at the first step; every level gets as many steps."""
    gaussian_cap: int = 80_000
    """The model never has more Gaussians than this."""
    seed_share: float = 0.7
    """Share of the cap that is placed at the start, when the cloud has that many points."""
    seed_height: float = 0.04
    """Metres above the floor below which the cloud seeds no Gaussian; 0 or less keeps all points."""
    seed_detail: float = 1.0
    """How much denser a scan seeds where its colours vary: the exponent of their local deviation; 0 is evenly."""
    seed_flatness: float = 0.15
    """Thickness of a scan's seeds along the surface normal, per their width; 1 is round."""
    seed_size: float = 0.5
    """Standard deviation of the seeds per mean distance of their three neighbours."""
    seed_opacity: float = 0.5
    """Opacity of a Gaussian at the start."""
    sh_degree: int = 1
    """Highest degree of the spherical harmonics of a Gaussian's colour, 0 to 3."""
    sh_interval: float = 0.15
    """Share of the steps after which each further degree of the spherical harmonics joins."""
    random_background: bool = False
    """Without a background network: another colour at every step shines through, so that nothing stays open."""
    background: bool = True
    """Whether a background network fills what the Gaussians leave open (paper, section III-C)."""
    texture: bool = True
    """Whether the floor surface carries a learned texture. Not in the paper."""
    exposure: bool = False
    """Whether a gain per image and channel is learned and left out of the model: for cameras that meter as they go."""
    antialiased: bool = True
    """Opacity compensation of Mip-Splatting, so that training at half size and drawing at full size agree."""
    loss: LossConfig = field(default_factory=lambda: LossConfig(suppression=2.0))
    """Twice the paper's suppression, because the fill term pulls the other way at the floor's rim: the floor of novel
    views has a mean alpha of 0.017 in place of 0.021, for 0.2 dB elsewhere."""
    rate: RateConfig = field(default_factory=RateConfig)
    scanless: ScanlessConfig = field(default_factory=ScanlessConfig)
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    densify: DensifyConfig = field(default_factory=DensifyConfig)
    robust: RobustConfig = field(default_factory=RobustConfig)
    device: Device = "auto"
    """Where the Gaussians are trained: on a CUDA card by gsplat, on the CPU, or auto for the card where there is one. A
    run that began on one goes on on the other."""
    threads: int = 0
    """Threads of the kernels; 0 means all cores. Runs are repeatable for one count."""
    checkpoint_seconds: float = 15.0
    """Most time between two checkpoints: as often as they take 2 % of the time, and at least so often; seconds."""

    def __post_init__(self) -> None:
        look = self.appearance
        for what, fine in (
            ("steps must be at least 1", self.steps >= 1),
            ("scanless must lie in 0.1 to 100", all(0.1 <= times <= 100 for times in astuple(self.scanless))),
            ("image_size must be at least 32 pixels", self.image_size >= 32),
            ("gaussian_cap must be at least 100", self.gaussian_cap >= 100),
            ("sh_degree must be 0 to 3", 0 <= self.sh_degree <= 3),
            ("coarse_share must lie in 0 to 1", 0 <= self.coarse_share <= 1),
            ("seed_share must lie above 0 and at most at 1", 0 < self.seed_share <= 1),
            ("coarse_levels must be 0 to 4", 0 <= self.coarse_levels <= 4),
            ("seed_opacity must lie in 0 to 1", 0 < self.seed_opacity < 1),
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
        """The same for a capture whose depth comes from its images."""
        times, rate = self.scanless, self.rate
        faster = replace(rate, means=rate.means * times.means, means_end=rate.means_end * times.means_end)
        return replace(self, steps=max(1, round(self.steps * times.steps)), rate=faster)

    @property
    def floor_aware(self) -> bool:
        """Whether any term treats the floor in its own way."""
        return self.loss.suppression > 0 or self.loss.floor > 0


UNIT = 5.0
"""Metres that a unit of nerfstudio's scenes is taken for: it scales the cameras to +-1, and a submap is about 10 m."""


def _splatfacto() -> TrainingConfig:
    """Splatfacto's rules (nerfstudio, models/splatfacto.py) by shares of its 30,000 steps, lengths times UNIT.

    Changed, because what takes Adam a number of steps takes it as many in a run that is twenty times shorter:
    - the cap, and a refinement every 100 steps as there, so that these are fewer;
    - no opacity reset (`densify.adaptive.reset` 0.1 is theirs): its dimmed Gaussians need some 150 steps to recover;
    - the means move at our rate; theirs is 8e-4 to 8e-6 m (Splatfacto-W: 8e-5 to 8e-7 m);
    - seeds are half opaque, theirs 0.1, which is where they cull: half of the seeds were gone after the first
      refinement, and a background explained the walls that they left open;
    - scales move at our rate, twice theirs.
    `at_paper_scale` takes all of this back. What each is worth: resources/docs/method.md, "The baselines".
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
    """Splatfacto-W's rules (splatfactow_config.py and _model.py) by shares of its 55,000 steps, lengths times UNIT.

    Changed: as above, and there is no robust mask: theirs begins at step 6000, when what is still wrong is a transient.
    In a run that is over before, the worst pixels of an image are walls that are not learned yet. Where it is on,
    nothing is exempt from it, as there is no sky indoors, and it takes a pixel out of L1 too, not of SSIM alone. A view
    that was not trained on takes the embedding of the nearest image: the mean is one that the networks never saw. Their
    alpha loss is a mean over the image here. The embedding and the colour network have the sizes of their light model,
    made for any data.
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
    """The paper: Splatfacto-W with the floor terms, with the camera position in place of the image index, and without
    the alpha loss."""
    base = _splatfacto_w()
    return replace(
        base,
        name="splatfacto-i",
        seed_height=0.04,
        appearance=replace(base.appearance, embedding="position"),
        loss=LossConfig(suppression=1.0, floor=1.0, fill=0.0),
    )


FULL_SIZE = 16_384
"""Pixels that no side of an image exceeds: images are never enlarged, so that it means their own size."""


def at_paper_scale(config: TrainingConfig) -> TrainingConfig:
    """A preset's configuration as large as the paper's models, which asks for a card: 30,000 steps, images of full
    size, a million Gaussians in a submap, embedding and networks of the full Splatfacto-W, and by a network also what
    is coloured by the linear form made for CPUs. With as many steps as the originals, `splatfacto-i`, `splatfacto-w`
    and `3dgs` get back the rules of theirs that short runs cannot afford, see `_splatfacto`."""
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
    """The configuration of a name.

    "nvsim"         the default: the paper's method with floor texture, fill, and the linear form of its colours
    "splatfacto-i"  the paper: floor suppression and background floor loss, colours by camera position; no texture, no
                    fill
    "splatfacto-w"  its base: background and colours by image, alpha loss; the floor is as everything else
    "3dgs"          Splatfacto, Gaussians only: no floor terms, no background, no robust mask

    Raises InputError for another name.
    """
    if name not in _PRESETS:
        raise InputError(f"There is no training preset {name!r}; choose one of {', '.join(PRESETS)}.")
    return _PRESETS[name]()
