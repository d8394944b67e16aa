"""The address of an endpoint, the model to use there, and the API key from the environment."""

from __future__ import annotations

import ipaddress
import os
from dataclasses import dataclass, field
from urllib.parse import urlsplit

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
        open_ = urlsplit(self.url).scheme == "http" and not self._near
        return f"{self.model} at {self.url} ({how}{', UNENCRYPTED' if open_ else ''})"

    @property
    def _near(self) -> bool:
        host = urlsplit(self.url).hostname or ""
        try:
            return ipaddress.ip_address(host).is_loopback
        except ValueError:
            return host == "localhost"
