"""Estimate the size and cost of requests before anything is sent."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from nvsim.endpoint.budget import Prices
from nvsim.endpoint.request import Detail, Image, Request


def tokens_in(request: Request) -> int:
    """Estimated tokens of a request: one per four characters, 8 per message, and those of its images."""
    letters = sum(len(p) for m in request.messages for p in m.parts if isinstance(p, str))
    overhead = 8 * len(request.messages)
    return (
        math.ceil(letters / 4) + overhead + sum(image_tokens(i.width, i.height, request.detail) for i in request.images)
    )


def image_tokens(width: int, height: int, detail: Detail) -> int:
    """Estimated tokens of an image by the rule of GPT-4o. Other models differ by some factor.

    Source: OpenAI's guide to images and vision, "Calculating costs". An image costs 85 tokens at low detail. Otherwise
    the image is scaled down to 2048 pixels and its shorter side to 768 pixels. It then costs 85 tokens and 170 more for
    each tile of 512 x 512 pixels.
    """
    if detail == "low":
        return 85
    scale = min(1.0, 2048 / max(width, height))
    scale *= min(1.0, 768 / (min(width, height) * scale))
    return 85 + 170 * math.ceil(width * scale / 512) * math.ceil(height * scale / 512)


@dataclass(frozen=True)
class RequestEstimate:
    """The amount of data and tokens that is sent to one model.

    requests, images, sent (bytes), tokens_in   totals of the requests without a stored answer
    tokens_out   token limit of all their answers
    kept         requests with a stored answer, which the other figures exclude
    """

    requests: int = 0
    images: int = 0
    sent: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    kept: int = 0

    def with_one(self, request: Request) -> RequestEstimate:
        return replace(
            self,
            requests=self.requests + 1,
            images=self.images + len(request.images),
            sent=self.sent + bytes_of(request),
            tokens_in=self.tokens_in + tokens_in(request),
            tokens_out=self.tokens_out + request.tokens,
        )

    def words(self, prices: Prices) -> str:
        """Text for the user: one sentence without its full stop."""
        if not self.requests:
            return f"nothing: all {self.kept} answers are stored"
        money = prices.of(self.tokens_in, self.tokens_out)
        cost = f"price at most {money:.2f}" if money is not None else "price unknown without --price-in and --price-out"
        kept = f"; {self.kept} more have stored answers" if self.kept else ""
        return (
            f"{self.requests} requests with {self.images} images, "
            f"{self.sent / 1e6:.1f} MB, about {_thousands(self.tokens_in)} tokens in and at most "
            f"{_thousands(self.tokens_out)} out, {cost}{kept}"
        )


def estimate_requests(requests: Iterable[tuple[Request, bool]]) -> RequestEstimate:
    """The total of these requests, each with whether its answer is stored."""
    found = RequestEstimate()
    for request, kept in requests:
        found = replace(found, kept=found.kept + 1) if kept else found.with_one(request)
    return found


def bytes_of(request: Request) -> int:
    """Bytes of the request in transit. Base64 turns three bytes of an image into four."""
    letters = sum(len(p.encode(errors="replace")) for m in request.messages for p in m.parts if isinstance(p, str))
    return letters + sum(_on_the_wire(image) for image in request.images)


def _on_the_wire(image: Image) -> int:
    return 4 * math.ceil(len(image.data) / 3)


def _thousands(count: int) -> str:
    return f"{count:,}"
