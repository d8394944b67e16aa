"""Measure the peak memory of a training with checkpoints and previews.

python tests/benchmarks/train_memory.py [--gaussians 200000] [--frames 200] [--size 540x360] [--steps 60] [--json]

The process trains a synthetic room that is made in memory, and prints the figures of the operating system.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import tyro
from harness import peak_gib, report

from nvsim.events import Event, Metric
from nvsim.training import trainer
from nvsim.training.config import TrainingConfig
from nvsim.training.synthetic import synthetic_room
from nvsim.training.trainer import train_submap


@dataclass(frozen=True)
class Arguments:
    gaussians: int = 200_000
    frames: int = 200
    size: str = "540x360"
    steps: int = 60
    json: bool = False


def measure(gaussians: int, frames: int, width: int, height: int, steps: int) -> dict[str, float]:
    """MiB after the data is created, and at the peak of the training."""
    room = synthetic_room(frames, width, height, 3 * gaussians)
    before = peak_gib()
    counts = [0.0]

    def listen(event: Event) -> None:
        if isinstance(event, Metric) and event.name == "gaussians":
            counts.append(event.value)

    config = replace(TrainingConfig(), steps=steps, gaussian_cap=gaussians, seed_share=1.0, sh_degree=3)
    config = replace(config, checkpoint_seconds=0.0, image_size=max(width, height))
    trainer.PREVIEW_SECONDS = 0.0
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        train_submap(
            room.views,
            room.cloud,
            room.floor,
            config,
            checkpoint=where / "submap.ckpt",
            preview=where / "preview.jpg",
            listen=listen,
        )
        size = (where / "submap.ckpt").stat().st_size
    return {
        "gaussians": max(counts),
        "frames": frames,
        "with_data_mib": round(1024 * before),
        "peak_mib": round(1024 * peak_gib()),
        "checkpoint_mib": round(size / 2**20),
    }


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    width, height = (int(part) for part in arguments.size.split("x"))
    report(measure(arguments.gaussians, arguments.frames, width, height, arguments.steps), arguments.json)


if __name__ == "__main__":
    main()
