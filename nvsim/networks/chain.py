"""Run a described model: open its files, bind their tensors, and run its steps in order.

A diffusion network runs the steps of DDIM (Song et al. 2021, eq. 12 with eta 0), with the timesteps of diffusers'
DDIMScheduler.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.networks.binding import BoundTensor, bind_tensors, describe_nodes
from nvsim.networks.description import OF_PAIRS, OF_PROMPTS, Constant, Description, Scheduler, Step
from nvsim.networks.image_preparation import Image, Placement, Preparation
from nvsim.networks.onnx_session import TYPES, Node, Provider, SharedFile, providers, shared_file


class Ddim:
    """timesteps  (steps,) int64, indices of training timesteps, noisiest first"""

    def __init__(self, scheduler: Scheduler) -> None:
        s = self._said = scheduler
        if s.betas == "linear":
            betas = np.linspace(s.first_beta, s.last_beta, s.trained)
        else:
            betas = np.linspace(s.first_beta**0.5, s.last_beta**0.5, s.trained) ** 2
        self._alphas = np.cumprod(1 - betas)
        self._stride = s.trained // s.steps
        if s.spacing == "leading":
            times = np.arange(s.steps)[::-1] * self._stride + s.offset
        else:
            times = np.round(np.arange(s.trained, 0, -s.trained / s.steps)) - 1
        self.timesteps = np.clip(times, 0, s.trained - 1).astype(np.int64)

    def step(self, state: NDArray[Any], prediction: NDArray[Any], timestep: int) -> NDArray[np.float32]:
        """`state` after one denoising step, float32; `prediction` is the output of the network at `timestep`.

        All arrays have the shape of `state`."""
        before = timestep - self._stride
        end = 1.0 if self._said.ends_at_one else self._alphas[0]
        alpha, next_alpha = self._alphas[timestep], self._alphas[before] if before >= 0 else end
        x, said = np.asarray(state, np.float64), np.asarray(prediction, np.float64)
        kept, noisy = alpha**0.5, (1 - alpha) ** 0.5
        if self._said.predicts == "epsilon":
            clean, noise = (x - noisy * said) / kept, said
        elif self._said.predicts == "sample":
            clean, noise = said, (x - kept * said) / noisy
        else:
            clean, noise = kept * x - noisy * said, kept * said + noisy * x
        return np.asarray(next_alpha**0.5 * clean + (1 - next_alpha) ** 0.5 * noise, np.float32)


Values = dict[str, NDArray[Any]]
_MOST = 4096  # pixels per side
Rays = Callable[[Placement], NDArray[np.float32]]
"""Function that gives the rays of a network's image, (1, 3, rows, columns) float32; see `description.GIVEN`."""


@dataclass(frozen=True)
class _BoundStep:
    """A step with its file and its bound tensors."""

    step: Step
    path: Path
    file: SharedFile
    inputs: tuple[BoundTensor, ...]
    outputs: tuple[BoundTensor, ...]

    @property
    def names(self) -> list[str]:
        """Names of the file's outputs that the step uses."""
        return list(dict.fromkeys(b.node.name for b in self.outputs))


@dataclass(frozen=True, eq=False)
class ProcessedImage:
    """An image that a model has processed: every value that does not depend on a prompt, and the placement of the image
    in each of the description's images, by name."""

    image: Image
    values: Values
    placements: dict[str, Placement]


class Chain:
    """An opened model. Raises InputError if its files cannot be loaded or do not match the description."""

    def __init__(self, description: Description, folder: Path, provider: Provider = "auto") -> None:
        self.description = description
        for name, constant in description.constants.items():
            if constant.needed:
                raise InputError(
                    f"{description.title}: its TOML must set the constant {name}: {constant.needed}, as "
                    f"[constants] {name} = {{ value = [...] }}."
                )
        self.paths = {key: folder / file.name for key, file in description.files.items()}
        asked = providers(provider)
        files = {key: shared_file(path, asked) for key, path in self.paths.items()}
        runs = [_bind_step(step, self.paths[step.file], files[step.file]) for step in description.steps]
        self.images = _with_file_sizes(description, runs)
        self._ddim = {name: Ddim(scheduler) for name, scheduler in description.schedulers.items()}
        # Steps that depend on a prompt or a pair run once for each of them; all others run once per image.
        self._once: list[_BoundStep] = []
        self._each: list[_BoundStep] = []
        prompted = {*OF_PROMPTS, *OF_PAIRS}
        for run in runs:
            if any(prompted.intersection(b.tensor.values) for b in run.inputs):
                prompted |= {v for b in run.outputs for v in b.tensor.values}
                self._each.append(run)
            else:
                self._once.append(run)
                run.file.will_ask(self, run.names)

    @property
    def takes_rays(self) -> bool:
        """Whether the model needs the rays of an image's pixels."""
        return any("rays" in t.values for step in self.description.steps for t in step.inputs)

    def show(self, image: Image, rays: Rays | None = None) -> ProcessedImage:
        """Process an image (H, W, 3) uint8 RGB. `rays` is called if the model needs the rays of pixels."""
        values: Values = {"height_width": np.array(image.shape[:2])}
        placements = {}
        for name, preparation in self.images.items():
            prepared, placements[name] = preparation.placed(image)
            values[name] = prepared if preparation.layout == "HWC" else prepared[None]
        if rays is not None and self.takes_rays:
            values["rays"] = rays(placements[self.description.result.image])
        for run in self._once:
            self._run(run, values)
        return ProcessedImage(image, values, placements)

    def ask(self, shown: ProcessedImage | None, given: Mapping[str, NDArray[Any]]) -> Values:
        """Every value for a prompt or a pair of images, by name. `given` holds the prompt: points (K, 2) float32 in
        pixel indices of the network's image, and labels (K,) float32. For a pair, it holds the values that
        `description.OF_PAIRS` lists, and `shown` is None."""
        values = {**(shown.values if shown is not None else {}), **given}
        for run in self._each:
            self._run(run, values)
        return values

    def value(self, values: Mapping[str, NDArray[Any]], name: str) -> NDArray[np.float32]:
        """A value of the result as float32, in the shape of the network's output. Raises InputError if it is missing or
        not finite."""
        found = values.get(name)
        if found is None:
            raise InputError(f"{next(iter(self.paths.values()))} gives no {name}; export it with that output.")
        found = np.asarray(found)
        if not np.isfinite(found).all():
            raise InputError(
                f"{next(iter(self.paths.values()))} gives a {name} that is not finite; check mean and std, or export "
                "it again."
            )
        return found.astype(np.float32)

    def _run(self, run: _BoundStep, values: Values) -> None:
        with reading(run.path, "a network that runs", "export it again"):
            if not run.step.loop:
                self._once_through(run, values)
                return
            ddim, said = self._ddim[run.step.loop], self.description.schedulers[run.step.loop]
            values[said.state] = self._value(said.state, values)
            for timestep in ddim.timesteps:
                values["timestep"] = np.array([timestep])
                self._once_through(run, values)
                values[said.state] = ddim.step(values[said.state], values[said.prediction], int(timestep))

    def _once_through(self, run: _BoundStep, values: Values) -> None:
        feed = {b.node.name: self._input_array(b, values) for b in run.inputs}
        found = dict(zip(run.names, run.file.run(run.names, feed), strict=True))
        for b in run.outputs:
            values[b.tensor.values[0]] = _repeat_for_batch(_apply_change(np.asarray(found[b.node.name]), b), b)

    def _input_array(self, bound: BoundTensor, values: Values) -> NDArray[Any]:
        """The array for an input of the network."""
        parts = [self._value(name, values, bound.node) for name in bound.tensor.values]
        value = _apply_change(parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1), bound)
        value = _repeat_for_batch(_to_rank(value, bound.node), bound)
        return np.ascontiguousarray(value, TYPES.get(bound.node.type, np.float32))

    def _value(self, name: str, values: Values, node: Node | None = None) -> NDArray[Any]:
        if name in values:
            return values[name]
        constant = self.description.constants.get(name)
        if constant is None and name == "rays":
            raise InputError(f"{self.description.title} needs the camera of an image; use an image with a pose.")
        if constant is None:
            raise InputError(f"{name} is used before it is computed; correct the order of the steps.")
        return _constant(constant, values, node)


def _bind_step(step: Step, path: Path, file: SharedFile) -> _BoundStep:
    takes, gives = file.session.signature
    inputs = bind_tensors(step.inputs, takes, path, inputs=True)
    return _BoundStep(step, path, file, inputs, bind_tensors(step.outputs, gives, path, inputs=False))


def _with_file_sizes(description: Description, runs: Sequence[_BoundStep]) -> dict[str, Preparation]:
    """The images of the description, in the sizes that the files require."""
    images = dict(description.images)
    for run in runs:
        for bound in run.inputs:
            for name in set(bound.tensor.values) & set(images):
                shape = list(bound.node.shape)
                preparation = images[name]
                axis = {"NCHW": 2, "NHWC": 1, "HWC": 0}[preparation.layout]
                if len(shape) != (3 if preparation.layout == "HWC" else 4) or bound.node.type not in TYPES:
                    raise InputError(
                        f"{run.path} takes {describe_nodes([bound.node])} as an image, but its description says "
                        f"{preparation.layout}; correct the layout."
                    )
                sides = [n if isinstance(n, int) else 0 for n in shape[axis : axis + 2]]
                if not all(0 <= n <= _MOST for n in sides) or (0 in shape):
                    raise InputError(
                        f"{run.path} takes images of {shape[axis + 1]} x {shape[axis]} pixels; export it with dynamic "
                        "size."
                    )
                images[name] = preparation.of_size(*sides)
    return images


def _apply_change(value: NDArray[Any], bound: BoundTensor) -> NDArray[Any]:
    tensor = bound.tensor
    if tensor.item is not None:
        value = value[tensor.item : tensor.item + 1]
    return value * tensor.factor if tensor.factor != 1 else value


def _repeat_for_batch(value: NDArray[Any], bound: BoundTensor) -> NDArray[Any]:
    return np.repeat(value, bound.tensor.copies, axis=0) if bound.tensor.copies > 1 else value


def _to_rank(value: NDArray[Any], node: Node) -> NDArray[Any]:
    """`value` with the rank of the input `node`. Axes of length 1 are added or removed at the front. A single number is
    broadcast to an input of fixed size."""
    rank = len(node.shape)
    while value.ndim < rank:
        value = value[None]
    while value.ndim > rank and value.shape[0] == 1:
        value = value[0]
    if value.size == 1 and all(isinstance(n, int) for n in node.shape):
        value = np.broadcast_to(value, [int(n) for n in node.shape if isinstance(n, int)])
    return value


def _constant(constant: Constant, values: Values, node: Node | None) -> NDArray[Any]:
    if constant.seed is not None:
        shape = values[constant.like].shape if constant.like else constant.shape or (1,)
        noise = np.random.default_rng(constant.seed).standard_normal(shape)
        return np.repeat(noise, constant.copies, axis=0)
    numbers = np.array(constant.numbers)
    if constant.shape is not None:
        return np.full(constant.shape, numbers[0]) if len(numbers) == 1 else numbers.reshape(constant.shape)
    if len(numbers) == 1 and node is not None:
        return np.full([n if isinstance(n, int) else 1 for n in node.shape], numbers[0])
    return numbers
