"""Where questions go: the address of an endpoint, the model there, and the key from the environment."""

from __future__ import annotations

import ipaddress
import os
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from nvsim.errors import InputError

KEYS = {"api.openai.com": "OPENAI_API_KEY", "generativelanguage.googleapis.com": "GEMINI_API_KEY"}
"""Host -> the variable of the environment that holds its key, where none is named."""
OTHER_KEY = "NVSIM_ENDPOINT_KEY"


@dataclass(frozen=True)
class Endpoint:
    """url        of the interface, without /chat/completions
    model      name that the endpoint knows
    variable   of the environment, from which the key is
    key        "" where the variable is not set
    """

    url: str
    model: str
    variable: str
    key: str = field(repr=False)

    @staticmethod
    def of(url: str, model: str, variable: str = "") -> Endpoint:
        """Reads the key. Raises InputError for an address that is none, or without a model, or where a variable is
        named that is not set."""
        url = url.rstrip("/").removesuffix("/chat/completions")
        try:
            parts = urlsplit(url)
            host = parts.hostname or ""
            parts.port  # noqa: B018  raises for what is no port
        except ValueError:
            host = ""
        if not host or parts.scheme not in ("http", "https") or parts.query or parts.fragment:
            raise InputError(f"{url!r} is no address of an endpoint; give one such as https://api.openai.com/v1.")
        if parts.username is not None or parts.password is not None:
            raise InputError("The address of an endpoint must not hold a key; put the key into the environment.")
        if not model or not model.isprintable():
            raise InputError(f"No model is named for {url}; give --model NAME, as the endpoint calls it.")
        name = variable or KEYS.get(host, OTHER_KEY)
        key = os.environ.get(name, "").strip()
        if (variable or host in KEYS) and not key:
            raise InputError(f"The key for {url} is missing; put it into the environment as {name}.")
        if not key.isascii() or not key.isprintable():
            raise InputError(f"{name} holds what cannot be a key; set it again.")
        return Endpoint(url, model, name, key)

    @property
    def words(self) -> str:
        """Who is asked, and how the key travels."""
        how = f"with the key in {self.variable}" if self.key else "without a key"
        open_ = urlsplit(self.url).scheme == "http" and not self._near
        return f"{self.model} at {self.url} ({how}{', UNENCRYPTED' if open_ else ''})"

    @property
    def _near(self) -> bool:
        host = urlsplit(self.url).hostname or ""
        try:
            return ipaddress.ip_address(host).is_loopback
        except ValueError:
            return host == "localhost"
