"""Answers that have no end, take for ever or unpack to gigabytes, from a real server on loopback."""

from __future__ import annotations

import contextlib
import gzip
import json
import socket
import threading
import time
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from endpoint_server import Reply, said, serving

from nvsim.endpoint.budget import Budget, Prices
from nvsim.endpoint.client import Client, Unreachable
from nvsim.endpoint.connection import LARGEST
from nvsim.endpoint.options import AskingOptions, Endpoint
from nvsim.endpoint.request import Message, Request, StoredAnswers
from nvsim.errors import InputError

QUESTION = Request((Message("user", ("What is this?",)),), 50)
HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
ZEROS = 1 << 20


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


@contextlib.contextmanager
def raw(answer: Callable[[socket.socket], None]) -> Iterator[tuple[str, threading.Event]]:
    """The address of a server that reads a request and then sends bytes as `answer` does, and whether a client has
    closed the connection."""
    listener = socket.create_server(("127.0.0.1", 0))
    closed = threading.Event()

    def serve() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            with connection:
                try:
                    connection.recv(1 << 16)
                    answer(connection)
                except OSError:
                    closed.set()

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}/v1", closed
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()


def ask(url: str, folder: Path, seconds: float = 20.0, attempts: int = 1) -> str:
    options = AskingOptions(timeout=seconds, attempts=attempts, first_wait=0)
    client = Client(Endpoint.of(url, "m"), StoredAnswers(folder), Budget(Prices()), options)
    client.may_send = True
    try:
        return client.ask(QUESTION).text
    finally:
        client.close()


def endless_body(connection: socket.socket) -> None:
    connection.sendall(HEAD + b"\r\n")
    while True:
        connection.sendall(b"x" * ZEROS)


def endless_chunks(connection: socket.socket) -> None:
    connection.sendall(HEAD + b"Transfer-Encoding: chunked\r\n\r\n")
    while True:
        connection.sendall(b"%x\r\n" % ZEROS + b"x" * ZEROS + b"\r\n")


def gzip_bomb(connection: socket.socket) -> None:
    body = gzip.compress(bytes(1 << 26), 9)  # 64 MB in 65 kB
    connection.sendall(HEAD + b"Content-Encoding: gzip\r\nContent-Length: %d\r\n\r\n" % len(body) + body)


def deflate_bomb(connection: socket.socket) -> None:
    body = zlib.compress(bytes(1 << 26), 9)
    connection.sendall(HEAD + b"Content-Encoding: deflate\r\nContent-Length: %d\r\n\r\n" % len(body) + body)


@pytest.mark.parametrize("answer", [endless_body, endless_chunks, gzip_bomb, deflate_bomb])
def test_an_answer_without_end_is_refused_at_the_limit(tmp_path: Path, answer: Callable[[socket.socket], None]) -> None:
    with raw(answer) as (url, _):
        tracemalloc.start()
        try:
            with pytest.raises(InputError, match="more than 16 MB"):
                ask(url, tmp_path)
            server_side = 70 << 20 if "bomb" in answer.__name__ else 0  # the bomb itself is made in this process
            assert tracemalloc.get_traced_memory()[1] < 4 * LARGEST + server_side
        finally:
            tracemalloc.stop()


def drip(connection: socket.socket) -> None:
    connection.sendall(HEAD + b"Content-Length: 1000\r\n\r\n")
    while True:
        connection.sendall(b" ")
        time.sleep(0.02)


def dripping_headers(connection: socket.socket) -> None:
    connection.sendall(HEAD)
    while True:
        connection.sendall(b"X")
        time.sleep(0.02)


def silence(connection: socket.socket) -> None:
    connection.settimeout(5)
    while connection.recv(1 << 16):
        pass
    raise OSError("the client is gone")


@pytest.mark.parametrize("answer", [drip, dripping_headers, silence])
def test_one_deadline_holds_for_the_whole_answer(tmp_path: Path, answer: Callable[[socket.socket], None]) -> None:
    with raw(answer) as (url, closed):
        began = time.monotonic()
        with pytest.raises(Unreachable, match=r"no complete answer within 0\.3 seconds"):
            ask(url, tmp_path, 0.3, attempts=2)
        assert 0.55 < time.monotonic() - began < 3
        assert closed.wait(5)  # the connection is closed too, and not left to a thread


def test_a_header_without_end_is_no_answer(tmp_path: Path) -> None:
    def answer(connection: socket.socket) -> None:
        connection.sendall(HEAD + b"X-Long: ")
        while True:
            connection.sendall(b"x" * ZEROS)

    with raw(answer) as (url, _), pytest.raises(Unreachable, match="the connection failed"):
        ask(url, tmp_path)


def test_a_large_error_page_is_refused_too(tmp_path: Path) -> None:
    def answer(connection: socket.socket) -> None:
        connection.sendall(b"HTTP/1.1 500 Oops\r\n\r\n")
        while True:
            connection.sendall(b"x" * ZEROS)

    with raw(answer) as (url, _), pytest.raises(InputError, match="more than 16 MB"):
        ask(url, tmp_path)


def raw_deflate(data: bytes) -> bytes:
    packer = zlib.compressobj(wbits=-15)
    return packer.compress(data) + packer.flush()


@pytest.mark.parametrize(
    ("coding", "pack"),
    [("gzip", gzip.compress), ("x-gzip", gzip.compress), ("deflate", zlib.compress), ("deflate", raw_deflate)],
)
def test_a_packed_answer_is_unpacked(tmp_path: Path, coding: str, pack: Callable[[bytes], bytes]) -> None:
    body = pack(json.dumps(said("A door.").body).encode())

    def answer(connection: socket.socket) -> None:
        head = HEAD + f"Content-Encoding: {coding}\r\nContent-Length: {len(body)}\r\n\r\n".encode()
        connection.sendall(head + body)

    with raw(answer) as (url, _):
        assert ask(url, tmp_path) == "A door."


@pytest.mark.parametrize("coding", ["br", "zstd", "gzip, gzip"])
def test_an_answer_packed_in_another_way_is_not_unpacked(tmp_path: Path, coding: str) -> None:
    with (
        serving(lambda n, asked: Reply(said("A door.").body, headers={"content-encoding": coding})) as service,
        pytest.raises(Unreachable, match=f"compressed as {coding}, which was not requested"),
    ):
        ask(service.url, tmp_path)


def test_questions_are_not_sent_elsewhere(tmp_path: Path) -> None:
    with (
        serving(lambda n, asked: said("stolen")) as other,
        serving(lambda n, asked: Reply("", 307, {"location": other.url + "/chat/completions"})) as service,
        pytest.raises(InputError, match="it redirects to"),
    ):
        ask(service.url, tmp_path)
    assert len(service.asked) == 1 and not other.asked


@pytest.mark.parametrize(
    "usage",
    [
        {"prompt_tokens": 10**400, "completion_tokens": 5},
        {"prompt_tokens": -1, "completion_tokens": True},
        {"prompt_tokens": 1e300, "completion_tokens": "many"},
    ],
)
def test_a_senseless_count_of_tokens_is_an_estimate(tmp_path: Path, usage: dict[str, object]) -> None:
    body = {**said("A door.").body, "usage": usage}
    with serving(lambda n, asked: Reply(body)) as service:
        client = Client(
            Endpoint.of(service.url, "m"), StoredAnswers(tmp_path), Budget(Prices(1.0, 1.0), money=1.0), AskingOptions()
        )
        client.may_send = True
        answer = client.ask(QUESTION)
    assert answer.text == "A door." and answer.tokens_in < 100 and not answer.counted


@pytest.mark.parametrize(
    "body",
    ["[" * 200_000, "[{}" + ",{}" * 4_000_000 + "]", '{"choices": 1' + "0" * 5000 + "}"],
    ids=["deep", "wide", "digits"],
)
def test_json_that_fills_the_memory_is_no_answer(tmp_path: Path, body: str) -> None:
    with serving(lambda n, asked: Reply(body)) as service, pytest.raises(Unreachable, match="not a chat completion"):
        ask(service.url, tmp_path)
