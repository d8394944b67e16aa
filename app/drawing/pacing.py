"""How large the frames of a moving camera may be, so that they come often enough."""

from __future__ import annotations

SMALLEST = (480, 270)  # a moving image is never coarser than this


class Pacing:
    """Learns what a pixel costs and answers with the image size that holds the pace.

    target_ms   milliseconds from asking for a moving frame to having it (34: about 28 frames a second with painting)
    """

    def __init__(self, target_ms: float = 34.0) -> None:
        self._target = target_ms
        self._area_share = 0.25

    def moving_size(self, width: int, height: int) -> tuple[int, int]:
        """The size in pixels for a moving camera in a window of `width` x `height` device pixels; same shape."""
        factor = self._area_share**0.5
        least = max(SMALLEST[0] / width, SMALLEST[1] / height)
        factor = min(1.0, max(factor, least))
        if factor > 0.97:
            return width, height
        # Steps of 16 pixels: a size that changes with every frame would shimmer.
        w = min(width, max(SMALLEST[0], round(width * factor / 16) * 16))
        return w, max(1, round(height * w / width))

    def learn(self, width: int, height: int, full_width: int, full_height: int, milliseconds: float) -> None:
        """A frame of `width` x `height` took `milliseconds`."""
        share = width * height / max(1, full_width * full_height)
        wanted = share * self._target / max(milliseconds, 0.5)
        # Down at once, up slowly: a late frame is felt, a slightly coarse one hardly.
        blend = 0.6 if wanted < self._area_share else 0.15
        self._area_share = min(1.0, max(0.005, self._area_share + blend * (wanted - self._area_share)))
