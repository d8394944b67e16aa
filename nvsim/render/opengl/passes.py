"""The two passes of a frame: splats into a texture, nearest first, and their composition over the background of their
model.

The quads are drawn in three batches. Between them, pixels that are already opaque are closed in the depth buffer. If
walls are near, most occluded splats are then never shaded.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import nvsim_resources
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.backends import Float32
from nvsim.render.floor_texture import pack_texture
from nvsim.render.opengl.quads import QUAD_WIDTH
from nvsim.splats.types import FloorTexture, SubmapModel

if TYPE_CHECKING:
    import moderngl

FOLDER = Path(nvsim_resources.__file__).parent / "shaders"


def shader_source(name: str, defines: dict[str, str] | None = None) -> str:
    """The text of a shader with `defines` after its version line."""
    text = (FOLDER / name).read_text("utf-8")
    head, version, rest = text.partition("#version 330 core\n")
    lines = "".join(f"#define {key} {value}\n" for key, value in (defines or {}).items())
    return f"{head}{version}{lines}{rest}"


def splat_program(context: moderngl.Context) -> moderngl.Program:
    """The program that draws quads as color times alpha."""
    return context.program(vertex_shader=shader_source("splat.vert"), fragment_shader=shader_source("splat.frag"))


def close_program(context: moderngl.Context) -> moderngl.Program:
    """The program that marks pixels with a transmittance below `least` in the depth buffer."""
    return context.program(vertex_shader=shader_source("screen.vert"), fragment_shader=shader_source("close.frag"))


def composite_program(context: moderngl.Context, sky: bool, levels: int) -> moderngl.Program:
    """The program that draws the splats over a background, with spherical harmonics if `sky`, and with a floor texture
    of `levels` levels."""
    defines = {"SKY": "1"} if sky else {}
    if levels:
        # GLSL 3.30 allows only constants as the index of a sampler, so each level has its own name and line.
        defines["FLOOR"] = str(levels)
        defines["LEVEL_SAMPLERS"] = " ".join(f"uniform sampler2D level{i};" for i in range(levels))
        defines["LEVEL_SUM"] = " ".join(
            f"c += level_colour(level{i}, texels[{i}], share, footprint);" for i in range(levels)
        )
    return context.program(
        vertex_shader=shader_source("screen.vert"), fragment_shader=shader_source("composite.frag", defines)
    )


_SHARES = (0.1, 0.3, 1.0)
"""Share of the quads at which each batch ends."""
_CLOSED = 1 / 400
"""Transmittance below which a pixel is closed: the skipped rest is less than rounding to 8 bits."""


@dataclass
class _QuadBatch:
    buffer: moderngl.Buffer
    array: moderngl.VertexArray
    count: int = 0


class SplatPass:
    """Owns the quads on the GPU and the image drawn from them. Its context must be current at every call."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = splat_program(context)
        self._closer = close_program(context)
        self._closing = context.vertex_array(self._closer, [])
        self._lots: list[_QuadBatch | None] = [None] * len(_SHARES)
        self._targets: tuple[Any, ...] = ()  # texture, depth, framebuffer of both, framebuffer of the depth alone

    @property
    def texture(self) -> moderngl.Texture:
        """A quarter of the color, and in alpha the transmittance; row 0 is the top of the image. Valid after `draw`."""
        texture: moderngl.Texture = self._targets[0]
        return texture

    def upload(self, quads: Float32) -> None:
        """Sets the quads (N, QUAD_WIDTH), nearest first, for the next calls of `draw`."""
        assert quads.shape[1] == QUAD_WIDTH
        begin = 0
        for i, share in enumerate(_SHARES):
            end = round(share * len(quads))
            self._lots[i] = self._fill_batch(self._lots[i], quads[begin:end])
            begin = end

    def _fill_batch(self, lot: _QuadBatch | None, quads: Float32) -> _QuadBatch | None:
        if lot is None or lot.buffer.size < quads.nbytes:
            _release(lot)
            if len(quads) == 0:
                return None
            buffer = self._context.buffer(reserve=quads.nbytes + quads.nbytes // 4, dynamic=True)
            array = self._context.vertex_array(self._program, [(buffer, "2f 4f 4f/i", "centre", "axes", "paint")])
            lot = _QuadBatch(buffer, array)
        lot.count = len(quads)
        if lot.count:
            lot.buffer.orphan()  # otherwise the GPU would have to finish the previous frame first
            lot.buffer.write(quads)
        return lot

    def draw(self, width: int, height: int) -> None:
        """Draws into `texture`, of this size in pixels."""
        import moderngl

        self._resize(width, height)
        texture, _, target, depth_alone = self._targets
        context = self._context
        self._program["size"] = (width, height)
        self._closer["least"] = _CLOSED
        target.use()
        target.depth_mask = True
        target.clear(0.0, 0.0, 0.0, 1.0, depth=1.0)
        target.depth_mask = False
        # Front to back: each splat is dimmed by those before it, and the alpha in the target is the transmittance.
        under: Any = (moderngl.DST_ALPHA, moderngl.ONE, moderngl.ZERO, moderngl.ONE_MINUS_SRC_ALPHA)
        for i, lot in enumerate(self._lots):
            if lot is None or lot.count == 0:
                continue
            if i > 0:
                depth_alone.use()
                context.enable_only(moderngl.DEPTH_TEST)
                context.depth_func = "1"  # always
                texture.use(0)
                self._closing.render(moderngl.TRIANGLES, vertices=3)
            target.use()
            context.enable_only(moderngl.BLEND | moderngl.DEPTH_TEST)
            context.depth_func = "<"
            context.blend_func = under
            lot.array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=lot.count)
        context.disable(moderngl.BLEND | moderngl.DEPTH_TEST)
        context.blend_func = moderngl.DEFAULT_BLENDING  # type: ignore[assignment]

    def _resize(self, width: int, height: int) -> None:
        if self._targets and self.texture.size == (width, height):
            return
        self._release_targets()
        context = self._context
        # 16-bit fixed point: 8 bits lose the faint layers (44 dB instead of 80), half floats the small transmittances.
        texture = context.texture((width, height), 4, dtype="nu2")
        texture.repeat_x = texture.repeat_y = False
        depth = context.depth_renderbuffer((width, height))
        # The texture is read while depth is written, which needs a framebuffer without the texture.
        self._targets = (texture, depth, context.framebuffer([texture], depth), context.framebuffer([], depth))

    def _release_targets(self) -> None:
        for old in reversed(self._targets):
            old.release()
        self._targets = ()

    def release(self) -> None:
        """Releases all OpenGL objects."""
        self._release_targets()
        for lot in self._lots:
            _release(lot)
        self._lots = [None] * len(_SHARES)
        for old in (self._closing, self._closer, self._program):
            old.release()


def _release(lot: _QuadBatch | None) -> None:
    if lot is not None:
        lot.array.release()
        lot.buffer.release()


_SPLATS, _HEIGHTS, _FIRST_LEVEL = 0, 1, 2  # texture units


class _Floor:
    """The floor of one model on the GPU."""

    def __init__(self, context: moderngl.Context, texture: FloorTexture, floor: FloorSurface) -> None:
        self.of = (texture, floor)
        self.levels = [_grid(context, level, 3) for level in texture.levels]
        self.heights = _grid(context, floor.heights, 1)
        self.grid = (*floor.origin, floor.spacing)
        self.bounds = (*texture.low, *texture.high)
        self.texels = pack_texture(texture).sizes

    def bind_textures(self) -> None:
        self.heights.use(_HEIGHTS)
        for i, level in enumerate(self.levels):
            level.use(_FIRST_LEVEL + i)

    def release(self) -> None:
        for texture in (self.heights, *self.levels):
            texture.release()


class CompositePass:
    """The shader programs by the parts of a model, and the floor of the last drawn model."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._programs: dict[tuple[bool, int], tuple[moderngl.Program, moderngl.VertexArray]] = {}
        self._floor: _Floor | None = None

    def draw(
        self,
        model: SubmapModel,
        camera: Camera,
        coefficients: Float32 | None,
        splats: moderngl.Texture,
        viewport: tuple[int, int, int, int],
        *,
        backdrop: tuple[float, float, float],
        top_first: bool,
        blue_first: bool,
    ) -> None:
        """Fills `viewport` of the framebuffer in use.

        coefficients   (25, 3) as Prepared.coefficients
        splats         as SplatPass.texture, of the camera's size; resized if the viewport has another size
        backdrop       color behind splats and background
        """
        import moderngl

        levels = self._load(model)
        program, array = self._program(coefficients is not None, levels)
        k = camera.intrinsics
        _set_uniform(program, "splats", _SPLATS)
        _set_uniform(program, "size", (k.width, k.height))
        _set_uniform(program, "viewport", viewport)
        _set_uniform(program, "top_first", top_first)
        _set_uniform(program, "blue_first", blue_first)
        _set_uniform(program, "backdrop", backdrop)
        _set_uniform(program, "lens", (k.fx, k.fy, k.cx, k.cy))
        _set_uniform(program, "to_world", np.ascontiguousarray(camera.rotation.T, np.float32))  # column by column
        if coefficients is not None:
            _set_uniform(program, "sky", np.ascontiguousarray(coefficients, np.float32))
        if self._floor is not None and levels:
            _set_uniform(program, "eye", tuple(float(v) for v in camera.position))
            _set_uniform(program, "heights", _HEIGHTS)
            _set_uniform(program, "grid", self._floor.grid)
            _set_uniform(program, "bounds", self._floor.bounds)
            _set_uniform(program, "texels", self._floor.texels)
            for i in range(levels):
                _set_uniform(program, f"level{i}", _FIRST_LEVEL + i)
            self._floor.bind_textures()
        splats.use(_SPLATS)
        self._context.enable_only(moderngl.NOTHING)
        array.render(moderngl.TRIANGLES, vertices=3)

    def _load(self, model: SubmapModel) -> int:
        texture = model.texture
        if texture is None or not texture.levels:
            return 0
        if self._floor is None or self._floor.of != (texture, model.floor):
            if self._floor is not None:
                self._floor.release()
            self._floor = _Floor(self._context, texture, model.floor)
        return len(texture.levels)

    def _program(self, sky: bool, levels: int) -> tuple[moderngl.Program, moderngl.VertexArray]:
        if (sky, levels) not in self._programs:
            program = composite_program(self._context, sky, levels)
            self._programs[sky, levels] = program, self._context.vertex_array(program, [])
        return self._programs[sky, levels]

    def release(self) -> None:
        """Releases all OpenGL objects."""
        if self._floor is not None:
            self._floor.release()
            self._floor = None
        for program, array in self._programs.values():
            array.release()
            program.release()
        self._programs.clear()


def _grid(context: moderngl.Context, values: Float32, components: int) -> moderngl.Texture:
    """A grid (rows, columns[, components]) sampled bilinearly at its centers, with border values outside."""
    rows, columns = values.shape[:2]
    data = np.ascontiguousarray(values, np.float32)
    texture = context.texture((columns, rows), components, data, dtype="f4")
    texture.repeat_x = texture.repeat_y = False
    return texture


def _set_uniform(program: moderngl.Program, name: str, value: float | tuple[float, ...] | Float32) -> None:
    """Sets a uniform, unless the compiler removed it because no output depends on it."""
    if name not in program:
        return
    uniform: Any = program[name]
    if isinstance(value, np.ndarray):
        uniform.write(value)
    else:
        uniform.value = value
