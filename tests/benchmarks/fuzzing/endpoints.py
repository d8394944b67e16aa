"""Answers of models at endpoints, the stored answers, and the prompts that the models receive."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, content, each, files_in
from nvsim.endpoint.asking import UnusableAnswer, json_object
from nvsim.endpoint.budget import Budget, Prices
from nvsim.endpoint.client import Client
from nvsim.endpoint.options import AskingOptions, Endpoint
from nvsim.endpoint.prompt import FOLDER
from nvsim.endpoint.request import Answer, Message, Request, StoredAnswers


def readers() -> list[Reader]:
    return [
        Reader("endpoint response", _responses, _asked, share=3),
        Reader("endpoint body", _bodies, _asked_for_body, share=3),
        Reader("words of a model", _words, _object, refusals=(UnusableAnswer,), share=2),
        Reader("kept answers", _kept, _answers),
        Reader("prompt of judges", lambda: _prompts("judge.txt"), _judges),
        Reader("prompt of instructions", lambda: _prompts("instructions.txt"), _instructions),
        Reader("prompt of mapgpt", lambda: _prompts("mapgpt.txt"), _mapgpt),
    ]


_TEXT = 'Here it is:\n```json\n{"instructions": ["go left", "turn right"], "choice": "first"}\n```'
_BODY = {
    "id": "x",
    "object": "chat.completion",
    "model": "m",
    "choices": [{"index": 0, "message": {"role": "assistant", "content": _TEXT}, "finish_reason": "stop"}],
    "usage": {"prompt_tokens": 100, "completion_tokens": 10, "total_tokens": 110},
}


def _response(body: bytes, *headers: str) -> bytes:
    head = ["HTTP/1.1 200 OK", "Content-Type: application/json", f"Content-Length: {len(body)}", *headers, "", ""]
    return "\r\n".join(head).encode() + body


def _bodies() -> list[Seed]:
    whole = json.dumps(_BODY).encode()
    parts = json.dumps({**_BODY, "choices": [{"message": {"content": [{"type": "text", "text": _TEXT}]}}]}).encode()
    return [Seed({"a.json": data}, "a.json", "a.json", "json") for data in (whole, parts)]


def _responses() -> list[Seed]:
    """The bytes of HTTP responses: plain, in chunks, and one with status 429."""
    body = json.dumps(_BODY).encode()
    chunks = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
    chunks += b"%x\r\n" % len(body) + body + b"\r\n0\r\n\r\n"
    wrong = b'{"error": {"message": "wait", "type": "error", "code": "busy"}}'
    later = _response(wrong, "Retry-After: 1").replace(b"200 OK", b"429 Too Many Requests")
    plain = [_response(body), chunks]
    seeds = [Seed({"a.http": data}, "a.http", "a.http", "text") for data in plain]
    return [*seeds, Seed({"a.http": later}, "a.http", "a.http", "text", readable=False)]


def _asked(path: Path) -> object:
    return _answer_to(content(path))


def _asked_for_body(path: Path) -> object:
    return _answer_to(_response(content(path)))


def _answer_to(response: bytes) -> object:
    """The result of the client for the bytes of a response, which a server on loopback sends."""
    with workshop() as folder, _serving(response) as url:
        options = AskingOptions(attempts=1, timeout=1.8)
        client = Client(Endpoint.of(url, "m"), StoredAnswers(folder), Budget(Prices()), options)
        client.may_send = True
        try:
            return client.ask(Request((Message("user", ("where?",)),)))
        finally:
            client.close()


@contextmanager
def _serving(response: bytes) -> Iterator[str]:
    """A server that answers every connection with these bytes and closes it. Yields its address."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            try:
                while True:
                    connection, _ = server.accept()
                    with connection:
                        connection.settimeout(1.0)
                        connection.recv(1 << 16)
                        connection.sendall(response)
                        connection.shutdown(socket.SHUT_WR)
                        while connection.recv(1 << 16):
                            pass
            except OSError:
                return  # the server was closed, or no client connected

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.getsockname()[1]}/v1"
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join(2.0)


def _words() -> list[Seed]:
    return [Seed({"a.txt": _TEXT.encode()}, "a.txt", "a.txt", "text")]


def _object(path: Path) -> object:
    return json_object(content(path).decode("utf-8", "surrogateescape"))


_URL = "http://127.0.0.1/v1"


def _kept() -> list[Seed]:
    with workshop() as folder:
        StoredAnswers(folder).store(
            "ab" * 16, _URL, "m", Request((Message("user", ("where?",)),)), Answer("there", "", False, 9, 2)
        )
        files = files_in(folder)
    return each(files, "", {name: "json" for name in files})


def _answers(path: Path) -> object:
    kept = StoredAnswers(path)
    return kept.get("ab" * 16), kept.tokens_spent(_URL, "m")


def _prompts(name: str) -> list[Seed]:
    return [Seed({name: (FOLDER / name).read_bytes()}, name, name, "text")]


def _judges(path: Path) -> object:
    from nvsim.evaluation.judging.judges import read_prompt

    return read_prompt(path).sha256


def _instructions(path: Path) -> object:
    from nvsim.r2r.prompted.instructions import read_prompt

    return read_prompt(path).sha256


def _mapgpt(path: Path) -> object:
    from nvsim.r2r.prompted.mapgpt_episode import read_prompt

    return read_prompt(path).sha256
