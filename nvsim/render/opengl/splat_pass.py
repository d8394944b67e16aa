"""The first pass: draws the quads into a texture, nearest first, so that its alpha is the transmittance.

The quads are drawn in three batches. Between them, pixels that are already opaque are closed in the depth buffer. If
walls are near, most occluded splats are then never shaded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from nvsim.render.opengl.quads import QUAD_WIDTH
from nvsim.render.opengl.shaders import close_program, splat_program
from nvsim.render.types import Float32

if TYPE_CHECKING:
    import moderngl

_SHARES = (0.1, 0.3, 1.0)
"""Share of the quads at which each batch ends."""
_CLOSED = 1 / 400
"""Transmittance below which a pixel is closed: the skipped rest is less than rounding to 8 bits."""


@dataclass
class _Lot:
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
        self._lots: list[_Lot | None] = [None] * len(_SHARES)
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
            self._lots[i] = self._filled(self._lots[i], quads[begin:end])
            begin = end

    def _filled(self, lot: _Lot | None, quads: Float32) -> _Lot | None:
        if lot is None or lot.buffer.size < quads.nbytes:
            _release(lot)
            if len(quads) == 0:
                return None
            buffer = self._context.buffer(reserve=quads.nbytes + quads.nbytes // 4, dynamic=True)
            array = self._context.vertex_array(self._program, [(buffer, "2f 4f 4f/i", "centre", "axes", "paint")])
            lot = _Lot(buffer, array)
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


def _release(lot: _Lot | None) -> None:
    if lot is not None:
        lot.array.release()
        lot.buffer.release()
