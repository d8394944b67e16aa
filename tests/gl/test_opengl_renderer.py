"""The OpenGL renderer without a window, held to the kernels and to closed forms."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from opengl_scenes import CAMERA, MODELS, room

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.model import render_model
from nvsim.render.opengl.renderer import OpenGLRenderer
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians, SubmapModel

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def renderer(opengl: None) -> Iterator[OpenGLRenderer]:
    with OpenGLRenderer() as made:
        yield made


def by_kernels(model: SubmapModel, camera: Camera) -> np.ndarray:
    rgb = render_model(model, camera, frozenset({"rgb"})).rgb
    assert rgb is not None
    return 255 * np.clip(rgb.astype(np.float64), 0, 1)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((a.astype(np.float64) - b) ** 2) / 255**2))


@pytest.mark.parametrize("name", MODELS)
def test_it_draws_what_the_kernels_draw(renderer: OpenGLRenderer, name: str) -> None:
    expected, drawn = by_kernels(MODELS[name], CAMERA), renderer.render(MODELS[name], CAMERA)
    assert expected.std() > 10 and drawn.shape == (119, 161, 3)
    assert psnr(drawn, expected) > 50  # rounding to 8 bits alone gives 58.9


def one(mean: tuple[float, float, float], logit: float, color: tuple[float, float, float]) -> Gaussians:
    arrays = ([mean], np.full((1, 3), np.log(0.3)), [[1, 0, 0, 0]], [logit], [[(np.array(color) - 0.5) / DC]])
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))


def test_one_gaussian_has_the_alpha_of_the_formula(renderer: OpenGLRenderer) -> None:
    """Over a white backdrop, in the middle of the picture: opacity * red + (1 - opacity) * white, and beside it the
    Gaussian function of the distance in pixels."""
    camera = Camera(Intrinsics(101, 101, 100.0, 100.0, 50.5, 50.5), camera_pose(np.zeros(3), 0.0))
    model = SubmapModel(one((0, 6, 0), 0.0, (1, 0, 0)), None, None, FloorSurface.flat(-1), antialiased=False)
    picture = renderer.render(model, camera, backdrop=(1.0, 1.0, 1.0))
    variance = (100 * 0.3 / 6) ** 2 + 0.3
    for dx in (0, 3, 8, 15, 30):
        alpha = 0.5 * np.exp(-(dx**2) / 2 / variance)
        alpha = 0 if alpha < 1 / 255 else alpha
        assert picture[50, 50 + dx] == pytest.approx([255, 255 * (1 - alpha), 255 * (1 - alpha)], abs=1)


@pytest.mark.parametrize(("heading", "front"), [(0.0, 0), (np.pi, 1)])
def test_what_is_nearer_hides_what_is_behind(renderer: OpenGLRenderer, heading: float, front: int) -> None:
    red, green = one((0, 2, 0), 9.0, (1, 0, 0)), one((0, 4, 0), 9.0, (0, 1, 0))
    both = Gaussians(*(np.concatenate([getattr(g, f) for g in (green, red)]) for f in vars(red)))
    camera = Camera(Intrinsics.from_fov(40, 30, 1.0), camera_pose(np.array([0.0, 6.0 if front else 0.0, 0.0]), heading))
    middle = renderer.render(SubmapModel(both, None, None, FloorSurface.flat(-1)), camera)[15, 20]
    assert middle[front] > 245 and middle[1 - front] < 10


def test_colors_may_depend_on_the_camera_position(renderer: OpenGLRenderer) -> None:
    class Dimmed:
        def colored(self, gaussians: Gaussians, position: np.ndarray) -> Gaussians:
            return replace(gaussians, sh=gaussians.sh - np.float32(position[0]))

    model = replace(MODELS["background"], appearance=Dimmed())
    left = Camera(CAMERA.intrinsics, camera_pose(np.array([0.5, 2.0, 1.4]), 0.7, -0.35))
    pictures = [renderer.render(model, camera) for camera in (CAMERA, left)]
    for picture, camera in zip(pictures, (CAMERA, left), strict=True):
        assert psnr(picture, by_kernels(model, camera)) > 50
    assert psnr(pictures[1], by_kernels(MODELS["background"], left)) < 40


def test_the_benchmark_compares_both_on_everything_that_a_model_has(opengl: None) -> None:
    from nvsim.render.opengl.benchmark import measure, with_floor_and_background

    figures = measure(with_floor_and_background(room(500)), CAMERA, rounds=2)
    assert figures["psnr_db"] > 50 and figures["renderer"] and figures["size"] == [161, 119]
    parts = sum(figures[f"{part}_ms"] for part in ("project", "sort", "upload", "draw"))
    assert parts == pytest.approx(figures["frame_ms"], rel=0.3)
    assert 0 < figures["new_fps"] <= figures["fps"]


def test_what_windows_want_is_the_same_picture_with_blue_first(renderer: OpenGLRenderer) -> None:
    pixels = renderer.render_bgrx(MODELS["flat floor"], CAMERA)
    assert pixels.flags.c_contiguous and (pixels[..., 3] == 255).all()
    assert (pixels[..., 2::-1] == renderer.render(MODELS["flat floor"], CAMERA)).all()


def test_a_framebuffer_shows_the_last_view_until_the_next_is_ready(opengl: None) -> None:
    """One that is larger than the camera's picture shows it enlarged; its first row is the lowest."""
    import moderngl

    heard = threading.Event()
    context = moderngl.create_context(require=330, standalone=True, backend="egl")
    renderer = OpenGLRenderer(context, on_ready=heard.set)
    target = context.simple_framebuffer((161, 119))
    second = replace(CAMERA, camera_to_world=camera_pose(np.array([3.0, 2.0, 1.4]), 1.9, -0.2))
    model = MODELS["stairs and ramp"]

    def seen() -> np.ndarray:
        return np.frombuffer(target.read(components=3), np.uint8).reshape(119, 161, 3)[::-1]

    first = renderer.draw(model, CAMERA, target)
    assert first is None or first is CAMERA
    assert heard.wait(20)
    assert renderer.draw(model, CAMERA, target) is CAMERA
    assert psnr(seen(), by_kernels(model, CAMERA)) > 50
    shown = renderer.draw(model, second, target)
    assert shown in (CAMERA, second)  # it did not wait
    assert psnr(seen(), by_kernels(model, shown)) > 50
    renderer.wait_until_ready()
    assert renderer.draw(model, second, target) is second
    assert psnr(seen(), by_kernels(model, second)) > 50
    target.viewport = (1, 0, 160, 118)
    half = replace(second, intrinsics=second.intrinsics.scaled(80, 59))
    renderer.draw(model, half, target)
    renderer.wait_until_ready()
    assert renderer.draw(model, half, target) is half
    enlarged = seen()[1:, 1:].reshape(59, 2, 80, 2, 3).mean(axis=(1, 3))
    assert psnr(enlarged, by_kernels(model, half)) > 25
    renderer.release()
    assert context.error == "GL_NO_ERROR"
    target.release()
    context.release()


def test_what_fails_while_preparing_is_raised_where_the_picture_is_wanted(renderer: OpenGLRenderer) -> None:
    class Broken:
        def colored(self, gaussians: Gaussians, position: np.ndarray) -> Gaussians:
            raise FloatingPointError("the network overflowed")

    with pytest.raises(FloatingPointError, match="overflowed"):
        renderer.render(replace(MODELS["classic"], appearance=Broken()), CAMERA)
    assert psnr(renderer.render(MODELS["classic"], CAMERA), by_kernels(MODELS["classic"], CAMERA)) > 50


def test_a_released_renderer_leaves_no_thread_and_says_so_when_used(opengl: None) -> None:
    before = threading.active_count()
    renderer = OpenGLRenderer()
    renderer.render(SubmapModel(room(50), None, None, FloorSurface.flat(0)), CAMERA)
    assert threading.active_count() == before + 1
    renderer.release()
    renderer.release()
    assert threading.active_count() == before
    with pytest.raises(RuntimeError, match="released"):
        renderer.render(MODELS["classic"], CAMERA)


def test_the_window_shows_the_same_whoever_draws(opengl: None) -> None:
    """Also splats without a background, which lie over a neutral one."""
    from nvsim_app.drawing.painter import Models, Painter
    from nvsim_app.drawing.renderer_choice import CPU, OPENGL

    for model in (MODELS["stairs and ramp"], SubmapModel(room(300), None, None, FloorSurface.flat(0.0))):
        painter = Painter(Models(lambda camera, model=model: (0, model)))
        drawn = {name: painter.paint(CAMERA, "rgb", name, moving=True) for name in (CPU, OPENGL)}
        assert [renderer for _, _, renderer in drawn.values()] == [CPU, OPENGL] and not painter.remarks
        assert psnr(drawn[CPU][1], drawn[OPENGL][1]) > 45
        painter.release()
