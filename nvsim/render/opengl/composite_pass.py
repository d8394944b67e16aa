"""The second pass: the splats over the background of their model, evaluated at every pixel of the target."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.floor_texture import pack_texture
from nvsim.render.opengl.shaders import composite_program
from nvsim.render.types import Float32
from nvsim.splats.types import FloorTexture, SubmapModel

if TYPE_CHECKING:
    import moderngl

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

    def use(self) -> None:
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
        _set(program, "splats", _SPLATS)
        _set(program, "size", (k.width, k.height))
        _set(program, "viewport", viewport)
        _set(program, "top_first", top_first)
        _set(program, "blue_first", blue_first)
        _set(program, "backdrop", backdrop)
        _set(program, "lens", (k.fx, k.fy, k.cx, k.cy))
        _set(program, "to_world", np.ascontiguousarray(camera.rotation.T, np.float32))  # column by column
        if coefficients is not None:
            _set(program, "sky", np.ascontiguousarray(coefficients, np.float32))
        if self._floor is not None and levels:
            _set(program, "eye", tuple(float(v) for v in camera.position))
            _set(program, "heights", _HEIGHTS)
            _set(program, "grid", self._floor.grid)
            _set(program, "bounds", self._floor.bounds)
            _set(program, "texels", self._floor.texels)
            for i in range(levels):
                _set(program, f"level{i}", _FIRST_LEVEL + i)
            self._floor.use()
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


def _set(program: moderngl.Program, name: str, value: float | tuple[float, ...] | Float32) -> None:
    """Sets a uniform, unless the compiler removed it because no output depends on it."""
    if name not in program:
        return
    uniform: Any = program[name]
    if isinstance(value, np.ndarray):
        uniform.write(value)
    else:
        uniform.value = value
