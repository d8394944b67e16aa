"""The flags of every command that asks an endpoint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.endpoint.address import Endpoint
from nvsim.endpoint.budget import Budget, Prices
from nvsim.endpoint.request import Detail
from nvsim.errors import InputError


@dataclass(frozen=True)
class AskingOptions:
    """How an endpoint is asked. Nothing is sent unless one is named."""

    parallel: int = 4
    """Requests at once."""
    timeout: float = 120.0
    """Seconds that an answer may take."""
    attempts: int = 6
    """How often a request is sent before the endpoint counts as down: rate limits, errors of the server, broken
    connections."""
    first_wait: float = 1.0
    """Seconds before the second attempt, doubled each time, up to a minute; where the endpoint says how long, that."""
    answer_tokens: int = 1500
    """Most tokens of an answer; models that think before they answer need some thousands."""
    detail: Detail = "auto"
    """How finely the model is asked to look at images."""
    budget_tokens: int | None = None
    """Most tokens of the whole work, what earlier calls paid for it included."""
    budget_money: float | None = None
    """The same in money; needs the prices."""
    yes: bool = False
    """Send without asking first."""

    def __post_init__(self) -> None:
        for flag, value, least, most in (
            ("--parallel", self.parallel, 1, 64),
            ("--timeout", self.timeout, 0.01, 3600),
            ("--attempts", self.attempts, 1, 100),
            ("--first-wait", self.first_wait, 0, 60),
            ("--answer-tokens", self.answer_tokens, 1, 1_000_000),
        ):
            if not least <= value <= most:
                raise InputError(f"{flag} {value} is out of range; give {least:g} to {most:g}.")


@dataclass(frozen=True)
class OneEndpoint:
    """Whom a command with one model asks."""

    endpoint: str | None = None
    """Address of an OpenAI-compatible endpoint, such as https://api.openai.com/v1. Without it nothing is sent."""
    model: str = ""
    """The model, as the endpoint calls it."""
    key_variable: str = ""
    """The variable of the environment that holds the key; OPENAI_API_KEY or GEMINI_API_KEY at those two, elsewhere
    NVSIM_ENDPOINT_KEY, and none is needed there."""
    price_in: float | None = None
    """Price of a million tokens of questions, for the estimate and the budget in money."""
    price_out: float | None = None
    """Price of a million tokens of answers."""
    answers: Path | None = None
    """Folder in which answers are kept, so that no question is paid twice; beside the result when left out."""

    def address(self) -> Endpoint:
        """Raises InputError where none was named, or it makes no sense."""
        if self.endpoint is None:
            raise InputError("No model is asked without an endpoint; give --endpoint URL and --model NAME.")
        return Endpoint.of(self.endpoint, self.model, self.key_variable)

    def budget(self, asking: AskingOptions) -> Budget:
        """Raises InputError for one that makes no sense."""
        return Budget(Prices(self.price_in, self.price_out), asking.budget_tokens, asking.budget_money)
