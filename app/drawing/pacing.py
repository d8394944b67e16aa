"""The image size while the camera moves, chosen so that the frame rate is sufficient."""

from __future__ import annotations

SMALLEST = (480, 270)  # smallest image of a moving camera, pixels


class Pacing:
    """Learns the render time per pixel and chooses the image size that reaches the target time.

    target_ms   milliseconds from the request of a moving frame to its arrival (34: about 28 frames per second)
    """

    def __init__(self, target_ms: float = 34.0) -> None:
        self._target = target_ms
        self._area_share = 0.25

    def moving_size(self, width: int, height: int) -> tuple[int, int]:
        """The image size in pixels for a moving camera in a view of `width` x `height` device pixels. The aspect ratio
        is preserved."""
        factor = self._area_share**0.5
        least = max(SMALLEST[0] / width, SMALLEST[1] / height)
        factor = min(1.0, max(factor, least))
        if factor > 0.97:
            return width, height
        # Round to 16 pixels, because an image whose size changes with every frame flickers.
        w = min(width, max(SMALLEST[0], round(width * factor / 16) * 16))
        return w, max(1, round(height * w / width))

    def learn(self, width: int, height: int, full_width: int, full_height: int, milliseconds: float) -> None:
        """Records that a frame of `width` x `height` pixels took `milliseconds`."""
        share = width * height / max(1, full_width * full_height)
        wanted = share * self._target / max(milliseconds, 0.5)
        # Shrink quickly and grow slowly: a late frame disturbs more than a slightly coarse one.
        blend = 0.6 if wanted < self._area_share else 0.15
        self._area_share = min(1.0, max(0.005, self._area_share + blend * (wanted - self._area_share)))
