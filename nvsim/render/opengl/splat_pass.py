"""The first pass: quads into a texture of our own, nearest first, so that its alpha keeps what they let through."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nvsim.render.opengl.quads import QUAD_WIDTH
from nvsim.render.opengl.shaders import splat_program
from nvsim.render.types import Float32

if TYPE_CHECKING:
    import moderngl


class SplatPass:
    """Owns the quads on the graphics card and the picture they make. Its context must be current at every call."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = splat_program(context)
        self._buffer: moderngl.Buffer | None = None
        self._array: moderngl.VertexArray | None = None
        self._count = 0
        self._texture: moderngl.Texture | None = None
        self._target: moderngl.Framebuffer | None = None

    @property
    def texture(self) -> moderngl.Texture:
        """A quarter of the colour, and in alpha the transmittance; row 0 is the image's top. Valid after `draw`."""
        assert self._texture is not None
        return self._texture

    def upload(self, quads: Float32) -> None:
        """Draws these from now on; (N, QUAD_WIDTH), nearest first."""
        self._count = len(quads)
        if self._count == 0:
            return
        if self._buffer is None or self._buffer.size < quads.nbytes:
            for old in (self._array, self._buffer):
                if old is not None:
                    old.release()
            self._buffer = self._context.buffer(reserve=quads.nbytes + quads.nbytes // 4, dynamic=True)
            self._array = self._context.vertex_array(
                self._program, [(self._buffer, "2f 4f 4f/i", "centre", "axes", "paint")]
            )
            assert self._buffer is not None and 4 * QUAD_WIDTH == 40
        self._buffer.orphan()  # or the card would have to finish the former frame first
        self._buffer.write(quads)

    def draw(self, width: int, height: int) -> None:
        """Into `texture`, of this size in pixels."""
        import moderngl

        self._resize(width, height)
        assert self._target is not None
        context = self._context
        self._target.use()
        context.enable_only(moderngl.BLEND)
        # Front to back: what arrives is dimmed by what is there, and the alpha in the target is what is let through.
        context.blend_func = (  # type: ignore[assignment]
            moderngl.DST_ALPHA, moderngl.ONE, moderngl.ZERO, moderngl.ONE_MINUS_SRC_ALPHA,
        )  # fmt: skip
        self._target.clear(0.0, 0.0, 0.0, 1.0)
        if self._count and self._array is not None:
            self._program["size"] = (width, height)
            self._array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=self._count)
        context.disable(moderngl.BLEND)
        context.blend_func = moderngl.DEFAULT_BLENDING  # type: ignore[assignment]

    def _resize(self, width: int, height: int) -> None:
        if self._texture is not None and self._texture.size == (width, height):
            return
        self._release_target()
        # 16 bits of fixed point: 8 lose the faint layers (44 dB instead of 80), half floats the small transmittances.
        self._texture = self._context.texture((width, height), 4, dtype="nu2")
        self._texture.repeat_x = self._texture.repeat_y = False
        self._target = self._context.framebuffer([self._texture])

    def _release_target(self) -> None:
        for old in (self._target, self._texture):
            if old is not None:
                old.release()
        self._target = self._texture = None

    def release(self) -> None:
        """Gives everything back to the context."""
        self._release_target()
        for old in (self._array, self._buffer, self._program):
            if old is not None:
                old.release()
        self._array = self._buffer = None
