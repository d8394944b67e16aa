"""The presets at the paper's scale, and the device as an option."""

from __future__ import annotations

from dataclasses import replace

import pytest

from nvsim.cli.commands.run import Run
from nvsim.cli.commands.stages import Train
from nvsim.project.stages import trained
from nvsim.training.config import PRESETS, TrainingConfig, at_paper_scale, preset
from nvsim.training.strategies.config import DensifyConfig
from nvsim_app.forms.fields import fields_of


@pytest.mark.parametrize("name", PRESETS)
def test_the_papers_scale_is_as_large_as_the_paper_and_keeps_the_losses(name: str) -> None:
    small, large = preset(name), at_paper_scale(preset(name))
    assert (large.steps, large.gaussian_cap) == (30_000, 1_000_000)
    assert large.image_size > 10_000
    assert (large.loss, large.texture, large.name) == (small.loss, small.texture, name)
    look = large.appearance
    if name == "3dgs":
        assert look.kind == "none"
    else:
        assert (look.kind, look.size, look.features, look.layers, look.width) == ("network", 48, 72, 3, 256)
        assert (look.background_layers, look.background_width) == (3, 128)


@pytest.mark.parametrize(("name", "start"), [("3dgs", 8e-4), ("splatfacto-w", 8e-5), ("splatfacto-i", 8e-5)])
def test_at_the_papers_scale_the_baselines_have_their_authors_rules(name: str, start: float) -> None:
    large = at_paper_scale(preset(name))
    assert large.rate.means == pytest.approx(start) and large.rate.means_end == pytest.approx(start / 100)
    assert large.seed_opacity == 0.1 and large.densify.adaptive.reset > 0 and large.rate.log_scales == 5e-3
    assert (large.robust.kind == "quantile") == (name != "3dgs")
    assert preset(name).robust.kind == "none"  # a short run ends before theirs begins


@pytest.mark.parametrize("command", [Train, Run])
def test_the_command_line_scales_what_the_preset_gives(command: type[Train] | type[Run]) -> None:
    arguments = command.defaults(["p", "--preset", "splatfacto-i", "--paper-scale"])
    config = arguments.config if isinstance(arguments.config, TrainingConfig) else arguments.config.train
    assert config == at_paper_scale(preset("splatfacto-i"))


@pytest.mark.parametrize(("verb", "path"), [("train", "config.device"), ("run", "device")])
def test_the_window_asks_for_the_device_and_the_scale(verb: str, path: str) -> None:
    found = {field.path: field for field in fields_of(verb)}
    assert found[path].choices == ("auto", "cpu", "cuda") and found[path].default == "auto"
    assert found["paper_scale"].kind == "switch"


def test_a_model_does_not_depend_on_the_device_that_made_it() -> None:
    config = TrainingConfig()
    assert trained._result_settings(replace(config, device="cuda")) == trained._result_settings(config)
    assert trained._result_settings(replace(config, densify=DensifyConfig("none"))) != trained._result_settings(config)
