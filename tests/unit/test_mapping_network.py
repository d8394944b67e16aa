"""The criterion of a network's normals, through a real network that reads them from the colors of a scene painted by
its normals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from columns import flat_floor
from described_models import described
from normal_networks import metric3d
from numpy.typing import NDArray

from nvsim.benchmarks.map_builder import HALL, hall
from nvsim.cli.arguments import parse
from nvsim.cli.commands.stages import FALLS_BACK, Map, paper_map_config, report_network_fallback, with_normal_source
from nvsim.errors import InputError
from nvsim.events import Event
from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.graph.types import Evidence, NavGraph
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import Corridor, headings, offset_ahead
from nvsim.mapping.criteria import decide
from nvsim.mapping.evidence.rethreshold import Rethresholder
from nvsim.mapping.families import with_normals
from nvsim.mapping.views.floor_view import measure
from nvsim.mapping.views.view_sources import render_pitched_views
from nvsim.project import ledger, pipeline
from nvsim.project.config import CaptureConfig, RunConfig
from nvsim.project.project import Project
from nvsim.project.scene_views import SceneViews
from nvsim.project.stages.mapped import NETWORK, check_normals, network_of, without_other_networks
from nvsim.splats.types import Background, SubmapModel

UNIT = 0.28209479177387814  # the constant spherical harmonic
LEVEL = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # world x, y, z to a level camera's right, down, forward
PITCHED = np.array([0.0, -(0.5**0.5), -(0.5**0.5)])  # up, in a camera that looks down by 45 degrees
BOTH = MappingConfig(criteria=("alpha", "normal", "network-normal"), settle=False, jitter=0.0, max_viewpoints=6)


def painted(floor: np.ndarray) -> SubmapModel:
    """The hall with every Gaussian in the color of its normal in the world, over a floor of the color of `floor`."""
    model = hall()
    g = model.gaussians
    normals = matrix_from_quaternion(g.quats.astype(np.float64))[:, :, 2]
    sh = (normals / 2 / UNIT)[:, None, :].astype(np.float32)
    f = np.float32
    weights = {"embed.0.weight": np.zeros((1, 27), f), "embed.0.bias": np.zeros(1, f),
               "trunk.0.weight": np.zeros((1, 1), f), "trunk.0.bias": np.zeros(1, f),
               "base.weight": np.zeros((3, 1), f), "base.bias": ((floor + 1) / 2 / UNIT).astype(f),
               "rest.weight": np.zeros((72, 1), f), "rest.bias": np.zeros(72, f)}  # fmt: skip
    return replace(model, gaussians=replace(g, sh=sh), background=Background(weights))


def source(model: SubmapModel, config: MappingConfig) -> SceneViews:
    scene = SimpleNamespace(model_at=lambda _: (0, model), model=lambda _: model, second=lambda _: None)
    return SceneViews(scene, config)  # type: ignore[arg-type]


def known(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    xy = points[..., :2]
    return np.asarray(((xy > 0) & (xy < np.array(HALL))).all(axis=-1))


def around(model: SubmapModel, place: tuple[float, float], config: MappingConfig) -> list[Evidence]:
    corridors = {
        k: [Corridor(place, tuple(np.array(place) + offset_ahead(h, 2.5)))] for k, h in enumerate(headings(config))
    }
    views = render_pitched_views(source(model, config), np.array([*place, 1.3]), corridors, flat_floor, config)
    return [measure(views[k], "v", k, c, flat_floor, known) for k, (c,) in corridors.items()]


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the user's networks, empty."""
    folder = tmp_path / "models"
    folder.mkdir()
    monkeypatch.setenv("NVSIM_MODELS", str(folder))
    return folder / "normals.onnx"


@pytest.mark.parametrize("width", [448, 512])  # a multiple of 28, and one that is filled up
def test_a_network_on_the_panorama_tells_floor_from_what_stands_upright(models: Path, width: int) -> None:
    metric3d(models, LEVEL)
    config = replace(BOTH, views="panorama", panorama_width=width)
    decisions = set()
    for place in ((4.7, 4.5), (1.5, 1.2)):
        for e in around(painted(np.array([0.0, 0, 1])), place, config):
            assert e.network_up is not None
            up, alpha = e.network_up / 255, e.alpha / 255
            assert up[alpha < 0.02].min() > 0.95 and up[alpha > 0.98].max(initial=0) < 0.1
            alone = replace(config, criteria=("network-normal",))
            assert decide(e, alone) == ("open" if decide(e, config) == "open" else "network-normal")
            decisions.add(decide(e, alone))
    assert decisions == {"open", "network-normal"}


def test_on_pitched_views_the_normals_are_turned_into_the_world(models: Path) -> None:
    metric3d(models)
    for e in around(painted(PITCHED), (4.7, 4.5), BOTH):
        assert e.network_up is not None and e.views == "pitched"
        floor = e.alpha < 5
        assert floor.sum() > 100 and (e.network_up[floor] > 250).all(), "whatever the heading"


def test_both_must_pass_and_either_is_decided_again_without_rendering(models: Path, monkeypatch) -> None:
    metric3d(models, np.zeros((3, 3)), (0.0, 0.0, -1.0))  # sees upright surfaces everywhere
    walk = np.array([[1.5, 1.3, 1.3], [2.0, 1.3, 1.3]])
    config = replace(BOTH, views="panorama", panorama_width=256, standing=False)
    model = painted(np.array([0.0, 0, 1]))

    def built(config: MappingConfig, **more: object):  # type: ignore[no-untyped-def]
        return build_map(source(model, config), walk, flat_floor, known, config, scan="n", **more)  # type: ignore[arg-type]

    start = walk[0]
    refused = built(replace(config, isolated=True), start=start)
    assert not refused.graph.edges and refused.report["decisions"].get("network-normal", 0) > 0
    again = built(replace(config, criteria=("alpha", "normal"), max_viewpoints=1), previous=refused.graph, start=start)
    assert again.report["rendered_viewpoints"] == 0
    assert again.report["decisions"]["limit"] > 0, "the Gaussians alone let it through"
    loose = replace(config, tau_network_normal=-0.1, row_network_normal=-0.1)
    found = Rethresholder(refused.graph).decide(loose)
    assert found.new_steps > 0 == Rethresholder(refused.graph).decide(config).new_steps
    plain = built(replace(config, criteria=("alpha", "normal"), max_viewpoints=1), start=start).graph
    measured = built(replace(config, isolated=True, max_viewpoints=1), previous=plain, start=start)
    assert measured.report["rendered_viewpoints"] == 1, "a network cannot be asked about what was not measured by it"


def test_a_network_looks_at_a_viewpoint_once(models: Path, monkeypatch) -> None:
    metric3d(models, LEVEL)
    config = replace(BOTH, views="panorama", panorama_width=256)
    views, seen = source(painted(np.array([0.0, 0, 1])), config), []
    look = views.surface_normals.normals
    monkeypatch.setattr(views.surface_normals, "normals", lambda image, at: seen.append(at.position) or look(image, at))
    walk = np.array([[1.5, 1.3, 1.3], [4.0, 1.3, 1.3]])
    report = build_map(views, walk, flat_floor, known, config, scan="n").report
    assert report["viewpoints"] > 3 and report["rendered_views"] == len(seen) == len(np.unique(seen, axis=0))


def test_what_another_network_saw_is_not_taken_for_what_this_one_sees(models: Path, tmp_path: Path) -> None:
    metric3d(models, LEVEL)
    config = replace(BOTH, views="panorama", panorama_width=256)
    seen = {e.key: e for e in around(painted(np.array([0.0, 0, 1])), (4.7, 4.5), config)}
    graph = NavGraph("n", evidence=seen)
    with Project.create_or_open(tmp_path / "p.nvsim") as project:
        ledger.begin_part(project, "map", "key")
        ledger.finish(project, "map", 1.0, {NETWORK: network_of(config)})
        assert without_other_networks(graph, project, config) is graph
        metric3d(models)
        stripped = without_other_networks(graph, project, config)
        assert stripped is not None and all(e.network_up is None for e in stripped.evidence.values())
        assert without_other_networks(graph, project, MappingConfig()) is graph and network_of(MappingConfig()) == ""


def test_of_several_networks_the_named_one_is_asked(models: Path) -> None:
    for name, matrix, offset in (("level", LEVEL, (0.0, 0.0, 0.0)), ("upright", np.zeros((3, 3)), (0.0, 0.0, -1.0))):
        (models.parent / name).mkdir()
        described("metric3d-huggingface", metric3d(models.parent / name / "n.onnx", matrix, offset))
    keys, ups = set(), []
    for name in ("level", "upright"):
        config = replace(BOTH, views="panorama", panorama_width=256, normals_model=name)
        keys.add(network_of(config))
        assert config.key == replace(config, normals_model="").key, "what is installed counts, not what it is called"
        found = around(painted(np.array([0.0, 0, 1])), (4.7, 4.5), config)
        ups.append(max(int(e.network_up.max()) for e in found if e.network_up is not None))
    assert len(keys) == 2 and ups[0] > 250 and ups[1] < 30
    with pytest.raises(InputError, match="no model 'other' for surface normals .*installed: level, upright"):
        check_normals(replace(BOTH, normals_model="other"))


def test_the_flag_names_families_beside_the_others() -> None:
    assert with_normals(("alpha", "normal", "slice"), "network") == ("alpha", "network-normal", "slice")
    assert with_normals(("alpha",), "both") == ("alpha", "normal", "network-normal")
    assert with_normals(("alpha", "network-normal"), "gaussians") == ("alpha", "normal")
    assert with_normals(("normal",), "criteria") == ("normal",)
    words = ["--project", "p.nvsim", "--normal-source", "both", "--views", "panorama"]
    told = parse(Map, words, "map")
    found = with_normal_source(told.config, told.normal_source)
    assert found.views == "panorama" and found.criteria == ("alpha", "normal", "network-normal")


def test_the_papers_map_takes_the_network_that_is_there_and_says_when_there_is_none(models: Path) -> None:
    said: list[Event] = []
    config = paper_map_config()
    assert config.views == "panorama" and config.criteria == ("alpha", "normal")
    report_network_fallback(config, "gaussians", said.append)
    report_network_fallback(replace(config, criteria=("alpha",)), "criteria", said.append)
    assert not said, "who asks for it needs no telling"
    report_network_fallback(config, "criteria", said.append)
    assert [event.text for event in said] == [FALLS_BACK]  # type: ignore[attr-defined]
    metric3d(models)
    assert paper_map_config().criteria == ("alpha", "network-normal")
    report_network_fallback(paper_map_config(), "criteria", said.append)
    assert len(said) == 1


def test_without_a_network_the_main_job_is_refused_before_anything_is_made(models: Path, tmp_path: Path) -> None:
    config = RunConfig(map=replace(BOTH, criteria=("alpha", "network-normal")))
    with (
        Project.create_or_open(tmp_path / "p.nvsim") as project,
        pytest.raises(InputError, match=r"No network.*normals\.onnx.*--normal-source gaussians"),
    ):
        pipeline.run(project, tmp_path / "nowhere", CaptureConfig(), config, lambda _: None)
