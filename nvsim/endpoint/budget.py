"""The token and money budget of one command, and the estimate of its size and cost before anything is sent.

Earlier spending counts for the budget too: all stored answers of the model in the answer folder.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from nvsim.endpoint.request import Answer, Detail, Image, Request
from nvsim.errors import InputError


@dataclass(frozen=True)
class Prices:
    """Prices of a million input and output tokens, in any currency. None if not given. Raises InputError if a price is
    negative or not finite."""

    into: float | None = None
    out: float | None = None

    def __post_init__(self) -> None:
        for price in (self.into, self.out):
            if price is not None and not 0 <= price < math.inf:
                raise InputError(f"{price} is not a valid price of a million tokens; give 0 or more.")

    @property
    def known(self) -> bool:
        return self.into is not None and self.out is not None

    def of(self, tokens_in: float, tokens_out: float) -> float | None:
        """The price of so many tokens, None if a price is missing."""
        if self.into is None or self.out is None:
            return None
        return (tokens_in * self.into + tokens_out * self.out) / 1e6


class BudgetSpent(InputError):
    """The next request would exceed the budget."""


class Budget:
    """A limit in tokens and in money, None for no limit. Raises InputError if a limit is not positive, or if a limit in
    money comes without prices."""

    def __init__(self, prices: Prices, tokens: int | None = None, money: float | None = None) -> None:
        if money is not None and not prices.known:
            raise InputError("A budget in money needs prices; give --price-in and --price-out per million tokens.")
        for flag, value in (("--budget-tokens", tokens), ("--budget-money", money)):
            if value is not None and not value > 0:
                raise InputError(f"{flag} {value} is not a valid budget; give a positive number.")
        self.prices, self._most_tokens, self._most_money = prices, tokens, money
        self.tokens_in = self.tokens_out = 0
        self.asked = self.used_again = 0
        self._held_in = self._held_out = 0
        self._counted = 1.0  # largest ratio so far of the endpoint's token count to our estimate
        self._changed = threading.Condition()

    @contextmanager
    def reserve(self, estimate: int, tokens_out: int) -> Iterator[None]:
        """Reserves the largest cost of a request while it runs. Waits if other requests have reserved the rest. Raises
        BudgetSpent if the budget is too small even without other reservations."""
        with self._changed:
            while not self._is_within_budget(tokens_in := math.ceil(estimate * self._counted), tokens_out):
                if not (self._held_in or self._held_out):
                    raise BudgetSpent(self._words())
                self._changed.wait()
            self._held_in += tokens_in
            self._held_out += tokens_out
        try:
            yield
        finally:
            with self._changed:
                self._held_in -= tokens_in
                self._held_out -= tokens_out
                self._changed.notify_all()

    def add_earlier_tokens(self, tokens_in: int, tokens_out: int) -> None:
        """Adds the tokens that earlier commands spent."""
        with self._changed:
            self.tokens_in += tokens_in
            self.tokens_out += tokens_out

    def count(self, answer: Answer, estimate: int) -> None:
        """Adds the tokens of an answer. estimate: input tokens that we had estimated for its request. If the endpoint
        counted more, later estimates are scaled up by the same ratio."""
        with self._changed:
            self._counted = max(self._counted, answer.tokens_in / max(estimate, 1))
            self.tokens_in += answer.tokens_in
            self.tokens_out += answer.tokens_out
            self.asked += 1

    def count_again(self) -> None:
        """Counts a stored answer, which costs nothing."""
        with self._changed:
            self.used_again += 1

    @property
    def cost(self) -> float | None:
        return self.prices.of(self.tokens_in, self.tokens_out)

    def _is_within_budget(self, tokens_in: int, tokens_out: int) -> bool:
        into, out = self.tokens_in + self._held_in + tokens_in, self.tokens_out + self._held_out + tokens_out
        money = self.prices.of(into, out)
        if self._most_money is not None and money is not None and money > self._most_money:
            return False
        return self._most_tokens is None or into + out <= self._most_tokens

    def _words(self) -> str:
        spent = f"{self.tokens_in + self.tokens_out} tokens"
        flags = "--budget-tokens"
        if self._most_money is not None:
            spent += f" for {self.cost:.4g}"
            flags = "--budget-tokens or --budget-money" if self._most_tokens is not None else "--budget-money"
        return (
            f"The budget is spent ({spent}) and the next request does not fit; answers are stored, so raise "
            f"{flags} and run the command again."
        )


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

    def with_request(self, request: Request) -> RequestEstimate:
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
        found = replace(found, kept=found.kept + 1) if kept else found.with_request(request)
    return found


def bytes_of(request: Request) -> int:
    """Bytes of the request in transit. Base64 turns three bytes of an image into four."""
    letters = sum(len(p.encode(errors="replace")) for m in request.messages for p in m.parts if isinstance(p, str))
    return letters + sum(_on_the_wire(image) for image in request.images)


def _on_the_wire(image: Image) -> int:
    return 4 * math.ceil(len(image.data) / 3)


def _thousands(count: int) -> str:
    return f"{count:,}"
