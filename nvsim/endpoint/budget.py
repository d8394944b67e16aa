"""What may be spent on one piece of work, in tokens and in money, by however many questions at once.

What earlier calls paid counts too: all answers of the same model that are kept in the same folder.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from nvsim.endpoint.answer import Answer
from nvsim.errors import InputError


@dataclass(frozen=True)
class Prices:
    """Money for a million tokens, in any currency; None where it was not given."""

    into: float | None = None
    out: float | None = None

    @property
    def known(self) -> bool:
        return self.into is not None and self.out is not None

    def of(self, tokens_in: float, tokens_out: float) -> float | None:
        """What so many tokens cost, None where a price is missing."""
        if self.into is None or self.out is None:
            return None
        return (tokens_in * self.into + tokens_out * self.out) / 1e6


class BudgetSpent(InputError):
    """The next question would cost more than is left."""


class Budget:
    """tokens, money: the most, None for no limit. Raises InputError for money without prices."""

    def __init__(self, prices: Prices, tokens: int | None = None, money: float | None = None) -> None:
        if money is not None and not prices.known:
            raise InputError("A budget in money needs prices; give --price-in and --price-out, for a million tokens.")
        for flag, value in (("--budget-tokens", tokens), ("--budget-money", money)):
            if value is not None and not value > 0:
                raise InputError(f"{flag} {value} is no budget; give a positive number.")
        self.prices, self._most_tokens, self._most_money = prices, tokens, money
        self.tokens_in = self.tokens_out = 0
        self.asked = self.used_again = 0
        self._held_in = self._held_out = 0
        self._counted = 1.0  # the most that an endpoint counted for one token of an estimate
        self._changed = threading.Condition()

    @contextmanager
    def holding(self, estimate: int, tokens_out: int) -> Iterator[None]:
        """Puts aside what a question may cost while it is asked; waits where others hold what is left. Raises
        BudgetSpent when there is not enough though nobody holds any."""
        with self._changed:
            while not self._enough(tokens_in := math.ceil(estimate * self._counted), tokens_out):
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

    def paid_before(self, tokens_in: int, tokens_out: int) -> None:
        """Adds what earlier calls paid."""
        with self._changed:
            self.tokens_in += tokens_in
            self.tokens_out += tokens_out

    def count(self, answer: Answer, estimate: int) -> None:
        """Adds what an answer cost. estimate: tokens that its question was thought to have; where the endpoint counted
        more, questions from now on are thought to have more."""
        with self._changed:
            self._counted = max(self._counted, answer.tokens_in / max(estimate, 1))
            self.tokens_in += answer.tokens_in
            self.tokens_out += answer.tokens_out
            self.asked += 1

    def count_again(self) -> None:
        """Counts an answer that earlier calls paid for."""
        with self._changed:
            self.used_again += 1

    @property
    def money(self) -> float | None:
        return self.prices.of(self.tokens_in, self.tokens_out)

    def _enough(self, tokens_in: int, tokens_out: int) -> bool:
        into, out = self.tokens_in + self._held_in + tokens_in, self.tokens_out + self._held_out + tokens_out
        money = self.prices.of(into, out)
        if self._most_money is not None and money is not None and money > self._most_money:
            return False
        return self._most_tokens is None or into + out <= self._most_tokens

    def _words(self) -> str:
        spent = f"{self.tokens_in + self.tokens_out} tokens"
        flags = "--budget-tokens"
        if self._most_money is not None:
            spent += f" for {self.money:.4g}"
            flags = "--budget-tokens or --budget-money" if self._most_tokens is not None else "--budget-money"
        return (
            f"The budget is spent: {spent}, and the next question does not fit in it; answers are kept, so give a "
            f"larger {flags} and go on."
        )
