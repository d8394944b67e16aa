"""HTTP requests to an endpoint, with one deadline for the whole answer and a limit on its size.

Read timeouts are not enough. A server can send data without end, send one byte per second, or send a few megabytes that
decompress to gigabytes. The requests run in their own event loop. Cancelling a task ends it in any state: name lookup,
TLS handshake, headers, or body.
"""

from __future__ import annotations

import asyncio
import threading
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nvsim.errors import InputError, value_text

LARGEST = 16 << 20
"""Largest answer in bytes, as sent and after decompression. A million tokens take about 6 MB."""
_PACKED = ("gzip", "x-gzip", "deflate")


class NoReply(Exception):
    """No answer came. The message gives the reason."""


class TooLarge(Exception):
    """The answer exceeds LARGEST bytes."""


@dataclass(frozen=True)
class Reply:
    """An HTTP response: the status, the headers with names in lower case, and the decompressed body."""

    status: int
    headers: Mapping[str, str]
    content: bytes


class Connection:
    """Sends requests to one endpoint. Several threads may use it. Redirects are not followed, and proxies come from the
    environment. Raises InputError if the package `httpx2` is not installed."""

    def __init__(self, key: str, seconds: float) -> None:
        """key: sent as a bearer token, "" for none; seconds: the deadline of each request."""
        self._http, self._seconds = http_package(), seconds
        headers = {"Content-Type": "application/json", "Accept-Encoding": "gzip, deflate"}
        if key:
            headers["Authorization"] = f"Bearer {key}"
        # The deadline below covers the whole request, so the HTTP client needs no timeouts.
        self._client = self._http.AsyncClient(headers=headers, timeout=None, follow_redirects=False)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="endpoint", daemon=True)
        self._thread.start()

    def post(self, url: str, content: bytes) -> Reply:
        """The response to a POST request. Raises NoReply if the connection fails or the deadline passes, TooLarge if
        the response exceeds LARGEST, and InputError if HTTP cannot use the address."""
        task = asyncio.run_coroutine_threadsafe(self._post(url, content), self._loop)
        try:
            return task.result()
        except BaseException:
            task.cancel()  # a stopped command does not wait for the answer
            raise

    async def _post(self, url: str, content: bytes) -> Reply:
        try:
            async with (
                asyncio.timeout(self._seconds),
                self._client.stream("POST", url, content=content) as response,
            ):
                body = await _body(response)
                return Reply(response.status_code, {k.lower(): v for k, v in response.headers.items()}, body)
        except TimeoutError as error:
            raise NoReply(f"no complete answer within {self._seconds:g} seconds") from error
        except self._http.HTTPError as error:
            raise NoReply(f"the connection failed: {value_text(error) or type(error).__name__}") from error
        except (self._http.InvalidURL, UnicodeError) as error:
            raise InputError(f"{url} is not a valid address ({value_text(error)}); check --endpoint.") from error

    def close(self) -> None:
        """Closes open connections and ends the event loop."""
        asyncio.run_coroutine_threadsafe(self._client.aclose(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _body(response: Any) -> bytes:
    """The decompressed body of a streamed response. Raises NoReply if it is damaged, and TooLarge."""
    coding = response.headers.get("content-encoding", "identity").strip().lower()
    if coding not in ("", "identity", *_PACKED):
        raise NoReply(f"the answer is compressed as {value_text(coding)}, which was not requested")
    unpack = zlib.decompressobj(wbits=47) if coding in _PACKED else None  # 47: detect a gzip or zlib header
    sent, found = 0, bytearray()
    async for part in response.aiter_raw():
        sent += len(part)
        if unpack is not None:
            try:
                part = unpack.decompress(part, LARGEST + 1 - len(found))
            except zlib.error as error:
                if coding != "deflate" or found or sent > len(part):
                    raise NoReply(f"the answer is damaged: {value_text(error)}") from error
                unpack = zlib.decompressobj(wbits=-15)  # some servers send deflate without a header
                part = unpack.decompress(part, LARGEST + 1)
        found += part
        if max(sent, len(found)) > LARGEST:
            raise TooLarge
    return bytes(found)


def http_package() -> Any:
    """The package `httpx2`. Raises InputError if it is not installed. Commands call this before any other work."""
    try:
        import httpx2
    except ImportError as error:
        raise InputError(
            "NVSim needs the package httpx2 to send requests to an endpoint; install it with "
            "pip install 'nvsim[endpoint]'."
        ) from error
    return httpx2
