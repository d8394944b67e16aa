"""A server on loopback that answers as services with language models do, well and badly."""

from __future__ import annotations

import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Reply:
    """status, body and headers; after seconds; reset: the connection is broken off instead; short: the body ends before
    its length does."""

    body: Any
    status: int = 200
    headers: dict[str, str] = field(default_factory=dict)
    after: float = 0.0
    reset: bool = False
    short: bool = False


@dataclass
class Asked:
    """A request as it came: parsed body, headers in lower case, path, and when."""

    body: dict[str, Any]
    headers: dict[str, str]
    path: str
    at: float
    answered: bool = False

    @property
    def words(self) -> str:
        """All text of the last message."""
        return words_of(self.body["messages"][-1])

    @property
    def images(self) -> list[str]:
        contents = [m["content"] for m in self.body["messages"] if isinstance(m["content"], list)]
        return [p["image_url"]["url"] for content in contents for p in content if p["type"] == "image_url"]


def words_of(message: dict[str, Any]) -> str:
    content = message["content"]
    return content if isinstance(content, str) else "\n".join(p["text"] for p in content if p["type"] == "text")


def said(text: str | None, into: int = 100, out: int = 10, finish: str = "stop", **message: Any) -> Reply:
    """A chat completion."""
    choice = {"index": 0, "message": {"role": "assistant", "content": text, **message}, "finish_reason": finish}
    usage = {"prompt_tokens": into, "completion_tokens": out, "total_tokens": into + out}
    return Reply({"id": "x", "object": "chat.completion", "model": "m", "choices": [choice], "usage": usage})


def wrong(status: int, message: str, headers: dict[str, str] | None = None, **error: Any) -> Reply:
    return Reply({"error": {"message": message, "type": "error", **error}}, status, headers or {})


Behavior = Callable[[int, Asked], Reply]
"""How a request is answered: its number from 0, and the request."""


class Service:
    """url; asked: the requests in the order in which they came."""

    def __init__(self, behave: Behavior) -> None:
        self.behave = behave
        self.asked: list[Asked] = []
        self._lock = threading.Lock()
        service = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                content = self.rfile.read(int(self.headers["content-length"]))
                names = {name.lower(): value for name, value in self.headers.items()}
                asked = Asked(json.loads(content), names, self.path, time.monotonic())
                with service._lock:
                    number = len(service.asked)
                    service.asked.append(asked)
                reply = service.behave(number, asked)
                time.sleep(reply.after)
                if reply.reset:
                    self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    self.close_connection = True
                    self.connection.close()
                    return
                data = reply.body.encode() if isinstance(reply.body, str) else json.dumps(reply.body).encode()
                try:
                    self.send_response(reply.status)
                    self.send_header("content-type", "application/json")
                    self.send_header("content-length", str(len(data) + 50 * reply.short))
                    for name, value in reply.headers.items():
                        self.send_header(name, value)
                    self.end_headers()
                    self.wfile.write(data)
                    self.wfile.flush()
                    asked.answered = True
                except OSError:
                    pass
                self.close_connection = self.close_connection or reply.short

            def log_message(self, *_: object) -> None:
                pass

        class Server(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *_: object) -> None:
                pass  # who was killed says no goodbye

        self._server = Server(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/v1"

    def start(self) -> None:
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()

    def stop(self) -> None:
        self._server.shutdown()
        self._server.server_close()


@contextmanager
def serving(behave: Behavior) -> Iterator[Service]:
    service = Service(behave)
    service.start()
    try:
        yield service
    finally:
        service.stop()
