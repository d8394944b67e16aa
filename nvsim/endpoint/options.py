"""The endpoint of a command: its address, model and API key, and the options of every command that sends requests."""

from __future__ import annotations

import ipaddress
import os
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from nvsim.endpoint.budget import Budget, Prices
from nvsim.endpoint.request import Detail
from nvsim.errors import InputError

KEYS = {"api.openai.com": "OPENAI_API_KEY", "generativelanguage.googleapis.com": "GEMINI_API_KEY"}
"""Host -> the environment variable with its key, used unless the user names another variable."""
OTHER_KEY = "NVSIM_ENDPOINT_KEY"


@dataclass(frozen=True)
class Endpoint:
    """An endpoint, a model, and a key.

    url        address of the interface, without /chat/completions
    model      model name, as the endpoint calls it
    variable   environment variable that the key is read from
    key        "" if the variable is not set
    """

    url: str
    model: str
    variable: str
    key: str = field(repr=False)

    @staticmethod
    def of(url: str, model: str, variable: str = "") -> Endpoint:
        """Reads the key from the environment. Raises InputError if the address is invalid, no model is named, the key
        is invalid, or a required variable is not set."""
        url = url.rstrip("/").removesuffix("/chat/completions")
        try:
            parts = urlsplit(url)
            host = parts.hostname or ""
            parts.port  # noqa: B018  raises ValueError if the port is invalid
        except ValueError:
            host = ""
        if not host or parts.scheme not in ("http", "https") or parts.query or parts.fragment:
            raise InputError(f"{url!r} is not an endpoint address; give one such as https://api.openai.com/v1.")
        if parts.username is not None or parts.password is not None:
            raise InputError("The endpoint address must not contain a key; store the key in an environment variable.")
        if not model or not model.isprintable():
            raise InputError(f"No model is named for {url}; give --model NAME, as the endpoint calls it.")
        name = variable or KEYS.get(host, OTHER_KEY)
        key = os.environ.get(name, "").strip()
        if (variable or host in KEYS) and not key:
            raise InputError(f"The key for {url} is missing; set the environment variable {name} to it.")
        if not key.isascii() or not key.isprintable():
            raise InputError(f"{name} contains characters that a key cannot have; set it again.")
        return Endpoint(url, model, name, key)

    @property
    def words(self) -> str:
        """The model, the address, and whether a key is sent, as text for the user. Unencrypted addresses are marked."""
        how = f"with the key in {self.variable}" if self.key else "without a key"
        open_ = urlsplit(self.url).scheme == "http" and not self._is_local
        return f"{self.model} at {self.url} ({how}{', UNENCRYPTED' if open_ else ''})"

    @property
    def _is_local(self) -> bool:
        host = urlsplit(self.url).hostname or ""
        try:
            return ipaddress.ip_address(host).is_loopback
        except ValueError:
            return host == "localhost"


@dataclass(frozen=True)
class AskingOptions:
    """How requests are sent to an endpoint. Nothing is sent unless an endpoint is named. Raises InputError if a value
    is out of range."""

    parallel: int = 4
    """Number of parallel requests."""
    timeout: float = 120.0
    """Seconds to wait for an answer."""
    attempts: int = 6
    """Number of times a request is sent before NVSim gives up, for example after rate limits, server errors, or lost
    connections."""
    first_wait: float = 1.0
    """Seconds before the second attempt, doubled each time up to a minute. A wait that the endpoint asks for takes
    precedence."""
    answer_tokens: int = 1500
    """Largest number of tokens of an answer. Reasoning models need some thousands."""
    detail: Detail = "auto"
    """Image detail that the model is asked to use."""
    budget_tokens: int | None = None
    """Largest number of tokens of the whole command, including earlier spending on it."""
    budget_money: float | None = None
    """Largest amount of money of the whole command, including earlier spending on it. Needs both prices."""
    yes: bool = False
    """Send without asking for confirmation."""

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
    """The endpoint and the model of a command that asks one model."""

    endpoint: str | None = None
    """Address of an OpenAI-compatible endpoint, such as https://api.openai.com/v1. Without it nothing is sent."""
    model: str = ""
    """Model name, as the endpoint calls it."""
    key_variable: str = ""
    """Environment variable with the key. Default: OPENAI_API_KEY or GEMINI_API_KEY for the endpoints of these two
    companies, else NVSIM_ENDPOINT_KEY, which may be unset."""
    price_in: float | None = None
    """Price of a million input tokens, for the estimate and the budget in money."""
    price_out: float | None = None
    """Price of a million output tokens."""
    answers: Path | None = None
    """Folder that stores answers, so that no request is paid twice. Default: next to the result."""

    def address(self) -> Endpoint:
        """Raises InputError if no endpoint is named, its address is invalid, or a package for requests is missing."""
        if self.endpoint is None:
            raise InputError("No endpoint is named, so no model can be asked; give --endpoint URL and --model NAME.")
        from nvsim.endpoint.connection import http_package

        http_package()
        return Endpoint.of(self.endpoint, self.model, self.key_variable)

    def budget(self, asking: AskingOptions) -> Budget:
        """Raises InputError if the budget or a price is invalid."""
        return Budget(Prices(self.price_in, self.price_out), asking.budget_tokens, asking.budget_money)
