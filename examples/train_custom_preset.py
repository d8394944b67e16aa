"""Train with your own variant of a preset: python examples/train_custom_preset.py house.nvsim [STEPS]

The project keeps the previous models. `nvsim restore --project house.nvsim train` restores them.
"""

import sys
from dataclasses import replace
from pathlib import Path

import nvsim

steps = int(sys.argv[2]) if len(sys.argv) > 2 else 2000

# A preset is a frozen dataclass with one group of settings per topic. `replace` returns a changed copy.
preset = nvsim.training_preset("splatfacto-i")  # the paper's method
config = replace(
    preset,
    name="more floor",  # stored with the models
    steps=steps,
    gaussian_cap=50_000,
    image_size=480,
    loss=replace(preset.loss, suppression=2.0),  # twice the weight of the term that keeps Gaussians off the floor
)

with nvsim.open_project(Path(sys.argv[1]), writable=True) as project:
    # `only` selects submaps; without it, all are trained. A listener such as `print` receives the progress.
    first = project.need_submaps()[0].index
    nvsim.train_models(project, config, only=(first,))
    scene = project.scene()

if scene is not None:
    model = scene.model(first)
    print(f"Submap {first}: {len(model.gaussians.means)} Gaussians after {model.info['steps']} steps.")
