"""The judges: vision-language models, and image metrics, so that the table is never empty.

A model is shown each pair of images twice, once in each order. The names of metrics say that they are no models.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsim.capture.images import decode
from nvsim.endpoint.asking import MissingAnswer, UnusableAnswer, ask_until_clear, json_object, run_in_parallel
from nvsim.endpoint.budget import RequestEstimate, estimate_requests
from nvsim.endpoint.client import Client
from nvsim.endpoint.prompt import FOLDER, Prompt
from nvsim.endpoint.request import Image as SentImage
from nvsim.endpoint.request import Message, Part, Request
from nvsim.errors import InputError
from nvsim.evaluation.judging.compared_images import STAGE, ContestantImages, read_shown
from nvsim.evaluation.judging.verdicts import JudgeVerdicts, Preference, Reason, Verdict, consistent_winner, pairs_of
from nvsim.evaluation.scores import Distance, Image
from nvsim.events import Listener, Progress, Warning, ignore_event

SAME_DISTANCE = 0.01
"""LPIPS: two images are equal if their distances from the photograph differ by less."""
SAME_SHARPNESS = 0.05
"""Two images are equally sharp if their sharpness differs by less than this share of the larger one."""
_BLUR = 1.0  # pixels; finer structures are noise of single pixels
PROMPT = FOLDER / "judge.txt"
OTHER = "other"
"""The category of reasons whose category is not in the prompt."""
_QUALITY = 95
_MOST_REASONS = 12
_NEEDS = {
    "system": ((), ("categories",)),
    "user": (("first", "second"), ("categories",)),
    "again": ((), ("wrong", "categories")),
    "categories": ((), ()),
}


def by_lpips(shown: Sequence[ContestantImages], distance: Distance | None, why: str) -> JudgeVerdicts:
    """Prefers the image with the smaller LPIPS distance to the photograph. Views without a photograph are skipped."""
    what = "prefers the image nearer to the photograph; a metric, only for views with a photograph"
    photographed = [view for view in shown if view.photo is not None]
    if distance is None or not photographed:
        return JudgeVerdicts("LPIPS (offline)", what, why=why or "no view has a photograph")
    found = []
    for view in photographed:
        assert view.photo is not None
        photo = view.photo()
        far = {who: distance(_resize_like(read_shown(path), photo), photo) for who, path in view.images.items()}
        found += _verdicts(view, far, lambda x, y: abs(x - y) < SAME_DISTANCE, lower=True)
    return JudgeVerdicts("LPIPS (offline)", what, found)


def by_sharpness(shown: Sequence[ContestantImages]) -> JudgeVerdicts:
    """Prefers the sharper image. It uses no photograph, and counts floaters and noise as detail."""
    what = "prefers finer detail, which can be noise or floaters; a metric"
    found = []
    for view in shown:
        sharp = {who: sharpness(read_shown(path)) for who, path in view.images.items()}
        found += _verdicts(view, sharp, lambda x, y: abs(x - y) < SAME_SHARPNESS * max(x, y, 1e-9), lower=False)
    return JudgeVerdicts("sharpness (offline, no reference)", what, found)


def sharpness(image: Image) -> float:
    """The mean gradient magnitude of the brightness of an RGB image (H, W, 3) float32, after a blur that removes
    single-pixel noise.

    Source: the measure of Tenengrad, Krotkov 1988, Focusing, section 2, without its threshold."""
    gray = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), _BLUR)
    across, down = cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1)
    return float(np.hypot(across, down).mean())


def _verdicts(
    view: ContestantImages, figures: dict[str, float], same: Callable[[float, float], bool], lower: bool
) -> list[Verdict]:
    found = []
    for a, b in pairs_of(list(view.images)):
        x, y = figures[a], figures[b]
        won = "" if same(x, y) else a if (x < y) == lower else b
        found.append(Verdict(view.name, view.kind, a, b, won, said=(f"{a} {x:.4f}", f"{b} {y:.4f}")))
    return found


def _resize_like(image: Image, other: Image) -> Image:
    height, width = other.shape[:2]
    if image.shape == other.shape:
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def read_prompt(path: Path | None) -> Prompt:
    """The prompt in a file, or the built-in one. Raises InputError if it is invalid."""
    prompt = Prompt.read(path or PROMPT, _NEEDS)
    if not _categories(prompt):
        raise InputError(f"{prompt.path}: [categories] is empty; write one category per line.")
    return prompt


@dataclass(frozen=True)
class _JudgeAnswer:
    preference: Preference
    reasons: tuple[tuple[bool, bool, str, str], ...]  # about the first image, positive, category, words


class JudgeRequester:
    """Asks one judge about all pairs in all views. longest: longest side of the sent images in pixels."""

    def __init__(self, prompt: Prompt, longest: int) -> None:
        self._prompt, self._longest = prompt, longest
        self._known = _categories(prompt)
        self._image = lru_cache(256)(self._read)

    def estimate(self, client: Client, shown: Sequence[ContestantImages]) -> RequestEstimate:
        """The number, size, and tokens of the requests that would be sent."""
        requests = (
            self._request(client, view, *order)
            for view in shown
            for a, b in pairs_of(list(view.images))
            for order in ((a, b), (b, a))
        )
        return estimate_requests((request, client.has_stored_answer(request)) for request in requests)

    def judge(
        self, client: Client, name: str, shown: Sequence[ContestantImages], listen: Listener = ignore_event
    ) -> JudgeVerdicts:
        """The verdicts of one model. Raises InputError as `Client.ask` does."""
        pairs = [(view, a, b) for view in shown for a, b in pairs_of(list(view.images))]
        found: dict[tuple[str, str, str], Verdict] = {}
        for (view, a, b), verdict in run_in_parallel(
            lambda pair: self._verdict(client, *pair), pairs, client.options.parallel
        ):
            found[view.name, a, b] = verdict
            if verdict.won is None:
                listen(Warning(f"{name} gives no verdict on {a} and {b} in {view.name}: {verdict.why}.", STAGE))
            listen(Progress(STAGE, len(found), len(pairs), name))
        ordered = [found[view.name, a, b] for view, a, b in pairs]
        return JudgeVerdicts(name, f"{client.endpoint.model}, asked at {client.endpoint.url}", ordered)

    def _verdict(self, client: Client, view: ContestantImages, a: str, b: str) -> Verdict:
        said: list[_JudgeAnswer] = []
        for order in ((a, b), (b, a)):
            answer = ask_until_clear(
                client, self._request(client, view, *order), self._understood, self._repeat_question
            )
            if isinstance(answer, MissingAnswer):
                return Verdict(view.name, view.kind, a, b, None, answer.why)
            said.append(answer.value)
        won = consistent_winner(a, b, said[0].preference, said[1].preference)
        reasons = [
            Reason(order[0] if of_first else order[1], good, category, words)
            for order, one in zip(((a, b), (b, a)), said, strict=True)
            for of_first, good, category, words in one.reasons
        ]
        preferences = tuple(one.preference for one in said)
        return Verdict(view.name, view.kind, a, b, won, "", preferences, tuple(reasons))

    def _request(self, client: Client, view: ContestantImages, first: str, second: str) -> Request:
        values: dict[str, str | Sequence[Part]] = {
            "categories": ", ".join(self._known),
            "first": [self._image(view.images[first], f"{view.name}, {first}")],
            "second": [self._image(view.images[second], f"{view.name}, {second}")],
        }
        system = Message("system", self._prompt.fill("system", values))
        user = Message("user", self._prompt.fill("user", values))
        return Request((system, user), client.options.answer_tokens, client.options.detail)

    def _repeat_question(self, wrong: str) -> str:
        return self._prompt.text("again", {"wrong": wrong, "categories": ", ".join(self._known)})

    def _read(self, path: Path, name: str) -> SentImage:
        """The image as a JPEG without chroma subsampling, scaled down to the longest side."""
        image = decode(path)
        height, width = image.shape[:2]
        scale = min(1.0, self._longest / max(width, height))
        if scale < 1:
            width, height = max(1, round(width * scale)), max(1, round(height * scale))
            image = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        sampling = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
        data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY, *sampling])[1]
        return SentImage(name, data.tobytes(), width, height)

    def _understood(self, text: str) -> _JudgeAnswer:
        said = json_object(text)
        choice = said.get("choice")
        preference = choice.strip().lower() if isinstance(choice, str) else ""
        if preference not in ("first", "second", "tie"):
            raise UnusableAnswer('"choice" must be "first", "second" or "tie"')
        given = said.get("reasons")
        reasons = [self._reason(one) for one in given[:_MOST_REASONS]] if isinstance(given, list) else []
        return _JudgeAnswer(preference, tuple(one for one in reasons if one is not None))  # type: ignore[arg-type]

    def _reason(self, given: Any) -> tuple[bool, bool, str, str] | None:
        """A reason, or None if it is invalid. The choice counts without it."""
        if not isinstance(given, Mapping) or given.get("image") not in ("first", "second"):
            return None
        if not isinstance(given.get("good"), bool):
            return None
        category = str(given.get("category", "")).strip().lower()
        words = " ".join(str(given.get("words", "")).encode("utf-8", "ignore").decode().split())[:200]
        return given["image"] == "first", given["good"], category if category in self._known else OTHER, words


def _categories(prompt: Prompt) -> list[str]:
    lines = (" ".join(line.lower().split()) for line in prompt.sections["categories"].splitlines())
    return [*dict.fromkeys(line for line in lines if line)]
