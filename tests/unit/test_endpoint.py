"""The client of endpoints against a real server on loopback that answers as such services do."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from email.utils import formatdate
from pathlib import Path
from typing import Any

import pytest
from endpoint_server import Asked, Reply, Service, said, serving, wrong

from nvsim.endpoint.asking import (
    MissingAnswer,
    ParsedAnswer,
    UnusableAnswer,
    ask_until_clear,
    json_object,
    run_in_parallel,
)
from nvsim.endpoint.budget import Budget, BudgetSpent, Prices, estimate_requests, image_tokens, tokens_in
from nvsim.endpoint.client import Client, Unreachable
from nvsim.endpoint.options import AskingOptions, Endpoint, OneEndpoint
from nvsim.endpoint.prompt import Prompt
from nvsim.endpoint.request import Image, Message, Request, StoredAnswers
from nvsim.errors import InputError

PIXEL = Image("a pixel", b"\xff\xd8\xff\xe0 not looked at", 640, 480)


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("NVSIM_ENDPOINT_KEY", "secret-word")


def question(words: str = "What is this?", tokens: int = 50) -> Request:
    return Request((Message("system", ("You look.",)), Message("user", (words, PIXEL))), tokens)


def client(service: Service, folder: Path, budget: Budget | None = None, **options: Any) -> Client:
    quick = {"first_wait": 0.001, "timeout": 5.0, "attempts": 4, **options}
    address = Endpoint.of(service.url, "seer")
    made = Client(address, StoredAnswers(folder), budget or Budget(Prices()), AskingOptions(**quick))
    made.may_send = True
    return made


def test_a_question_is_sent_as_services_take_it_and_kept(tmp_path: Path) -> None:
    with serving(lambda n, asked: said("A door.", 120, 7)) as service:
        budget = Budget(Prices(2.0, 10.0))
        first = client(service, tmp_path, budget).ask(question())
        later = Budget(Prices())
        again = client(service, tmp_path, later).ask(question())
    assert first.text == "A door." and again == first
    (asked,) = service.asked
    assert asked.path == "/v1/chat/completions" and asked.headers["authorization"] == "Bearer secret-word"
    body = asked.body
    assert body["model"] == "seer" and body["max_tokens"] == 50 and not body.get("stream")
    assert body["messages"][0] == {"role": "system", "content": "You look."}
    assert body["messages"][1]["content"][0] == {"type": "text", "text": "What is this?"}
    assert body["messages"][1]["content"][1]["image_url"]["url"].startswith("data:image/jpeg;base64,/9j/")
    assert (budget.asked, budget.used_again, budget.tokens_in, budget.tokens_out) == (1, 0, 120, 7)
    assert budget.cost == pytest.approx((120 * 2 + 7 * 10) / 1e6)
    assert (later.asked, later.used_again, later.tokens_in, later.tokens_out) == (0, 1, 120, 7)
    (kept,) = tmp_path.rglob("*.json")
    assert "secret-word" not in kept.read_text() and json.loads(kept.read_text())["answer"]["text"] == "A door."


def test_another_word_image_model_or_address_is_another_question(tmp_path: Path) -> None:
    other = Image("a pixel", b"\xff\xd8\xff\xe0 other", 640, 480)
    with serving(lambda n, asked: said(str(n))) as service:
        asking = client(service, tmp_path)
        texts = [
            asking.ask(request).text
            for request in (
                question(),
                question("What else?"),
                Request((Message("user", ("What is this?", other)),), 50),
                question(tokens=51),
                question(),
            )
        ]
    assert texts == ["0", "1", "2", "3", "0"]
    keys = {question().key(url, model) for url in ("a", "b") for model in ("c", "d")}
    assert len(keys) == 4
    renamed = Image("another name", PIXEL.data, 640, 480)
    assert Request((Message("user", (renamed,)),)).key("a", "b") == Request((Message("user", (PIXEL,)),)).key("a", "b")


@pytest.mark.parametrize(
    "bad",
    [
        wrong(500, "oops"),
        wrong(503, "overloaded"),
        wrong(429, "slow down", {"retry-after": "0"}),
        Reply("<html>gateway</html>", 502),
        Reply("{broken", 200),
        Reply('{"choices": []}', 200),
        Reply('["no"]', 200),
        said(None),
        said(""),
        Reply("{}", reset=True),
        Reply('{"a": 1}', short=True),
    ],
    ids=lambda r: f"{r.status}-{str(r.body)[:18]}{'-reset' * r.reset}{'-short' * r.short}",
)
def test_what_fails_for_a_while_is_sent_again(tmp_path: Path, bad: Reply) -> None:
    with serving(lambda n, asked: bad if n < 3 else said("At last.")) as service:
        assert client(service, tmp_path).ask(question()).text == "At last."
    assert len(service.asked) == 4 and all(a.body == service.asked[0].body for a in service.asked)


def test_a_slow_answer_is_given_up_and_asked_for_again(tmp_path: Path) -> None:
    with serving(lambda n, asked: said("Late.") if n else Reply("{}", after=0.6)) as service:
        assert client(service, tmp_path, timeout=0.2).ask(question()).text == "Late."
    assert len(service.asked) == 2


@pytest.mark.parametrize("how", ["seconds", "date"])
def test_all_wait_as_long_as_the_endpoint_asks(tmp_path: Path, how: str) -> None:
    # A date has whole seconds: the next but one is 1 to 2 seconds away.
    after = "0.4" if how == "seconds" else formatdate(time.time() + 2, usegmt=True)

    def behave(n: int, asked: Asked) -> Reply:
        return wrong(429, "slow down", {"retry-after": after}) if n == 0 else said("Good.")

    with serving(behave) as service:
        asking = client(service, tmp_path)
        assert [r.text for _, r in run_in_parallel(asking.ask, [question(str(i)) for i in range(3)], 1)] == [
            "Good."
        ] * 3
    waited = service.asked[1].at - service.asked[0].at
    assert 0.39 <= waited <= 2.5 and service.asked[2].at - service.asked[1].at < 0.3


def test_an_endpoint_that_asks_for_an_hour_is_left_alone(tmp_path: Path) -> None:
    with (
        serving(lambda n, asked: wrong(429, "come back", {"retry-after": "3600"})) as service,
        pytest.raises(Unreachable, match="wait 60 minutes"),
    ):
        client(service, tmp_path).ask(question())
    assert len(service.asked) == 1


def test_an_endpoint_that_stays_down_is_said(tmp_path: Path) -> None:
    with (
        serving(lambda n, asked: wrong(500, "oops")) as service,
        pytest.raises(Unreachable, match=r"no answer in 4 attempts \(status 500: oops\)"),
    ):
        client(service, tmp_path).ask(question())
    assert len(service.asked) == 4 and not list(tmp_path.rglob("*.json"))
    service_gone = Endpoint.of(service.url, "seer")
    gone = Client(
        service_gone, StoredAnswers(tmp_path), Budget(Prices()), AskingOptions(first_wait=0, attempts=1, timeout=2)
    )
    gone.may_send = True
    with pytest.raises(Unreachable, match=r"in 1 attempt \(the connection failed"):
        gone.ask(question())


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (wrong(401, "bad key"), "the key in NVSIM_ENDPOINT_KEY is not accepted"),
        (wrong(403, "not yours"), "is not accepted"),
        (wrong(404, "no such model"), "it has no model seer"),
        (wrong(400, "image too large"), "rejects this request: image too large"),
        (wrong(429, "quota", code="insufficient_quota"), "no credit left"),
        (Reply("", 307, {"location": "http://127.0.0.1:9/elsewhere"}), "it redirects to http://127.0.0.1:9/elsewhere"),
    ],
)
def test_what_will_never_do_is_asked_once(tmp_path: Path, reply: Reply, words: str) -> None:
    with serving(lambda n, asked: reply) as service, pytest.raises(InputError, match=words) as caught:
        client(service, tmp_path).ask(question())
    assert len(service.asked) == 1 and "secret-word" not in str(caught.value)


def test_the_endpoints_own_words_are_learnt_and_kept(tmp_path: Path) -> None:
    def strict(n: int, asked: Asked) -> Reply:
        if "max_tokens" in asked.body:
            return wrong(400, "Unsupported parameter: 'max_tokens'. Use 'max_completion_tokens'.", param="max_tokens")
        if "temperature" in asked.body:
            return wrong(400, "Only the default (1) value is supported.", param="temperature")
        return said("Fine.")

    with serving(strict) as service:
        asking = client(service, tmp_path, attempts=1)
        assert [asking.ask(question(str(i))).text for i in range(3)] == ["Fine."] * 3
    assert len(service.asked) == 5 and service.asked[-1].body["max_completion_tokens"] == 50


def test_refusals_are_answers_and_kept(tmp_path: Path) -> None:
    filtered = wrong(400, "The response was filtered", code="content_filter")
    replies = [said(None, refusal="I would rather not."), said("", finish="content_filter"), filtered]
    with serving(lambda n, asked: replies[n]) as service:
        asking = client(service, tmp_path)
        found = [asking.ask(question(str(i))) for i in range(3)]
        assert [asking.ask(question(str(i))) for i in range(3)] == found
    assert [f.refusal for f in found] == ["I would rather not.", "a content filter", "The response was filtered"]
    assert len(service.asked) == 3


def test_senseless_answers_are_asked_for_again_with_what_was_wrong(tmp_path: Path) -> None:
    replies = ["Well, a door.", '```json\n{"place": 3}\n```', 'Sure: {"place": "a door"} I hope.']

    def understand(text: str) -> str:
        place = json_object(text).get("place")
        if not isinstance(place, str):
            raise UnusableAnswer("place must be a text")
        return place

    def again(wrong: str) -> str:
        return f"Not so: {wrong}."

    with serving(lambda n, asked: said(replies[n])) as service:
        for _ in range(2):  # the second time nothing is sent
            found = ask_until_clear(client(service, tmp_path), question(), understand, again)
            assert found == ParsedAnswer("a door", (300, 30))
    assert len(service.asked) == 3
    last = service.asked[-1].body["messages"]
    assert [m["role"] for m in last] == ["system", "user", "assistant", "user", "assistant", "user"]
    assert last[3]["content"] == "Not so: there was no JSON object in the answer."
    assert last[5]["content"] == "Not so: place must be a text."
    with serving(lambda n, asked: said("never")) as stubborn:
        gave_up = ask_until_clear(client(stubborn, tmp_path / "2"), question(), understand, again)
    assert gave_up == MissingAnswer("there was no JSON object in the answer", False, (300, 30))
    with serving(lambda n, asked: said(None, refusal="No.")) as shy:
        refused = ask_until_clear(client(shy, tmp_path / "3"), question(), understand, again)
    assert refused == MissingAnswer("it refused (No.)", True, (100, 10)) and len(shy.asked) == 1
    with serving(lambda n, asked: said("", finish="length")) as thinking:
        spent = ask_until_clear(client(thinking, tmp_path / "4"), question(), understand, again)
    assert isinstance(spent, MissingAnswer) and "--answer-tokens" in spent.why and len(thinking.asked) == 1


def test_json_is_found_among_words() -> None:
    assert json_object('a {x} {"a": {"b": 1}} {"c": 2}') == {"a": {"b": 1}}
    for text in ("", "{", "[1]", "{" * 300, '{"a": ' * 100_000):
        with pytest.raises(UnusableAnswer):
            json_object(text)


def test_a_budget_is_never_overspent(tmp_path: Path) -> None:
    # Every question is at most 100 in and 50 out by its estimate and in truth.
    requests = [Request((Message("user", ("x" * 360 + f"{i:04}",)),), 50) for i in range(20)]
    assert {tokens_in(r) for r in requests} == {99}
    with serving(lambda n, asked: Reply(said("Yes.", 99, 50).body, after=0.005)) as service:
        budget = Budget(Prices(), tokens=1000)
        asking = client(service, tmp_path, budget)
        with pytest.raises(BudgetSpent, match="raise --budget-tokens"):
            list(run_in_parallel(asking.ask, requests, 8))
        assert len(service.asked) == 6 and budget.tokens_in + budget.tokens_out == 894
        # What was paid is used again and counts; a larger budget goes on.
        more = Budget(Prices(1.0, 1.0), tokens=2000, money=0.0018)
        with pytest.raises(BudgetSpent, match="--budget-tokens or --budget-money"):
            list(run_in_parallel(client(service, tmp_path, more).ask, requests, 8))
        assert len(service.asked) == 12 and more.used_again == 6 and more.asked == 6


def test_a_budget_learns_how_the_endpoint_counts(tmp_path: Path) -> None:
    """An endpoint that counts three times the estimate exceeds a budget by its first answers at most."""
    requests = [Request((Message("user", ("x" * 360 + f"{i:04}",)),), 50) for i in range(20)]
    with serving(lambda n, asked: said("Yes.", 297, 50)) as service:
        budget = Budget(Prices(), tokens=2000)
        with pytest.raises(BudgetSpent):
            list(run_in_parallel(client(service, tmp_path, budget).ask, requests, 1))
    assert len(service.asked) == 5 and 2000 - 347 < budget.tokens_in + budget.tokens_out <= 2000


def test_a_budget_in_money_needs_prices() -> None:
    with pytest.raises(InputError, match="--price-in and --price-out"):
        Budget(Prices(1.0), money=1.0)
    with pytest.raises(InputError, match="--budget-tokens 0"):
        Budget(Prices(), tokens=0)


@pytest.mark.parametrize("price", [-1.0, math.nan, math.inf])
def test_a_price_is_a_finite_number_of_at_least_zero(price: float) -> None:
    for into, out in ((price, 1.0), (1.0, price)):
        with pytest.raises(InputError, match="not a valid price"):
            OneEndpoint(price_in=into, price_out=out).budget(AskingOptions())
    assert OneEndpoint(price_in=0.0, price_out=0.0).budget(AskingOptions()).cost == 0


def test_an_endpoint_that_counts_no_tokens_is_counted_for(tmp_path: Path) -> None:
    body = said("Eight letters or so").body
    del body["usage"]
    with serving(lambda n, asked: Reply(body)) as service:
        found = client(service, tmp_path).ask(question())
    assert not found.counted and found.tokens_in == tokens_in(question()) and found.tokens_out == 4


def test_nothing_is_sent_before_somebody_agreed(tmp_path: Path) -> None:
    with serving(lambda n, asked: said("Yes.")) as service:
        client(service, tmp_path).ask(question())
        asking = client(service, tmp_path)
        asking.may_send = False
        assert asking.ask(question()).text == "Yes."
        with pytest.raises(InputError, match="give --yes"):
            asking.ask(question("Another?"))
    assert len(service.asked) == 1


def test_without_the_package_a_sentence_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "httpx2", None)
    with pytest.raises(InputError, match=r"pip install 'nvsim\[endpoint\]'"):
        Client(Endpoint.of("http://localhost/v1", "m"), StoredAnswers(tmp_path), Budget(Prices()), AskingOptions())


def test_a_damaged_answer_is_asked_for_again(tmp_path: Path) -> None:
    with serving(lambda n, asked: said(f"{n}")) as service:
        asking = client(service, tmp_path)
        asking.ask(question())
        (file,) = tmp_path.rglob("*.json")
        whole = file.read_text()
        for i, damage in enumerate(("", "{", "[]", whole.replace('"tokens_in": 100', '"tokens_in": "x"')), 1):
            file.write_text(damage)
            assert asking.ask(question()).text == str(i)
        assert asking.ask(question()).text == "4"


def test_work_at_once_ends_with_the_first_failure_and_keeps_what_was_answered(tmp_path: Path) -> None:
    barrier = threading.Barrier(4, timeout=5)

    def behave(n: int, asked: Asked) -> Reply:
        if n < 4:
            barrier.wait()  # four are on their way at once
        return wrong(401, "no more") if n == 3 else Reply(said("Good.").body, after=0.05)

    with serving(behave) as service:
        asking = client(service, tmp_path)
        with pytest.raises(InputError, match="not accepted"):
            list(run_in_parallel(asking.ask, [question(str(i)) for i in range(50)], 4))
    assert len(service.asked) <= 7
    assert len(list(tmp_path.rglob("*.json"))) == len(service.asked) - 1


def test_after_a_kill_no_question_is_sent_twice(tmp_path: Path) -> None:
    program = textwrap.dedent("""
        import sys
        from pathlib import Path
        from nvsim.endpoint.options import Endpoint
        from nvsim.endpoint.request import StoredAnswers
        from nvsim.endpoint.budget import Budget, Prices
        from nvsim.endpoint.client import Client
        from nvsim.endpoint.options import AskingOptions
        from nvsim.endpoint.request import Message, Request
        kept = StoredAnswers(Path(sys.argv[2]))
        client = Client(Endpoint.of(sys.argv[1], "seer"), kept, Budget(Prices()), AskingOptions(parallel=1))
        client.may_send = True
        for i in range(12):
            print(client.ask(Request((Message("user", (f"Question {i}",)),), 50)).text, flush=True)
    """)
    command = [sys.executable, "-c", program]

    def behave(n: int, asked: Asked) -> Reply:
        return said(asked.words, finish="stop") if n != 5 else Reply("{}", after=30)  # the sixth hangs

    with serving(behave) as service:
        process = subprocess.Popen([*command, service.url, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            heard = [process.stdout.readline().strip() for _ in range(5)]
            until = time.monotonic() + 20
            while len(service.asked) < 6 and time.monotonic() < until:
                time.sleep(0.005)
            os.kill(process.pid, signal.SIGKILL)
        finally:
            process.kill()
            process.wait()
        done = subprocess.run([*command, service.url, str(tmp_path)], capture_output=True, text=True, timeout=60)
    assert heard == [f"Question {i}" for i in range(5)]
    assert done.stdout.split("\n")[:12] == [f"Question {i}" for i in range(12)]
    answered = [asked.words for asked in service.asked if asked.answered]
    assert len(answered) == len(set(answered)) == 12 and len(service.asked) == 13


def test_addresses_and_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "GEMINI_API_KEY", "NVSIM_ENDPOINT_KEY"):
        monkeypatch.delenv(name, raising=False)
    here = Endpoint.of("http://localhost:8000/v1/chat/completions", "m")
    assert here.url == "http://localhost:8000/v1" and here.key == "" and "without a key" in here.words
    assert "UNENCRYPTED" in Endpoint.of("http://example.org/v1", "m").words
    with pytest.raises(InputError, match="variable OPENAI_API_KEY"):
        Endpoint.of("https://api.openai.com/v1", "m")
    monkeypatch.setenv("OPENAI_API_KEY", "for-openai")
    gemini = "https://generativelanguage.googleapis.com/v1beta/openai/"
    with pytest.raises(InputError, match="variable GEMINI_API_KEY"):
        Endpoint.of(gemini, "m")  # a key goes to its own service alone
    assert Endpoint.of("https://api.openai.com/v1", "m").key == "for-openai"
    assert "for-openai" not in repr(Endpoint.of("https://api.openai.com/v1", "m"))
    assert Endpoint.of("https://example.org/v1", "m").key == ""
    with pytest.raises(InputError, match="variable MINE"):
        Endpoint.of("https://example.org/v1", "m", "MINE")
    for url in ("", "example.org", "ftp://x/y", "http://", "http://a:b/", "http://u:p@x/v1", "http://x/v1?key=1"):
        with pytest.raises(InputError):
            Endpoint.of(url, "m")
    with pytest.raises(InputError, match="--model"):
        Endpoint.of("http://localhost/v1", "")


def test_estimates_by_hand() -> None:
    assert image_tokens(640, 480, "low") == 85
    assert image_tokens(640, 480, "auto") == 85 + 170 * 2
    assert image_tokens(1024, 1024, "high") == 85 + 170 * 4  # OpenAI's own example: 765
    assert image_tokens(2048, 4096, "high") == 85 + 170 * 6  # and 1105
    estimate = estimate_requests([(question(), False), (question("Other"), True)])
    assert (estimate.requests, estimate.images, estimate.kept, estimate.tokens_out) == (1, 1, 1, 50)
    assert estimate.sent == len("You look.What is this?") + 4 * -(-len(PIXEL.data) // 3)
    words = estimate.words(Prices(1e6, 1e6))
    assert f"price at most {estimate.tokens_in + 50:.2f}" in words and "1 more have stored answers" in words
    assert "price unknown" in estimate.words(Prices())


def test_a_prompt_is_filled_and_checked(tmp_path: Path) -> None:
    path = tmp_path / "p.txt"
    needs = {"system": ((), ()), "user": (("views",), ("name",))}
    path.write_text("# a remark\n[system]\nBe $$ brief.\n[user]\n$name sees\n$views\nWhat?\n")
    prompt = Prompt.read(path, needs)
    assert prompt.fill("system", {}) == ("Be $ brief.",)
    filled = prompt.fill("user", {"name": "Ann $name", "views": ["first:", PIXEL]})
    assert filled == ("Ann $name sees\n", "first:", PIXEL, "\nWhat?")
    for text, words in [
        ("[system]\nx\n[user]\nnothing", r"\$views is missing"),
        ("[system]\nx\n[user]\n$views $wiews", r"\$wiews is not known"),
        ("[system]\nx", r"no section \[user\]"),
        ("hello\n[system]\n", "line 1"),
        ("[system]\n[system]\n", "appears twice"),
    ]:
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            Prompt.read(path, needs)
