"""What the window keeps: how a project was left, the options of commands, what a child process said."""

from __future__ import annotations

from pathlib import Path

from fuzzing.reader import Reader, Seed, content


def readers() -> list[Reader]:
    return [
        Reader("view kept", _views, _decode_view),
        Reader("options kept", _options, _options_of),
        Reader("check result", _results, _result, refusals=(ValueError,)),
    ]


def _views() -> list[Seed]:
    from app.painting.cameras import ViewPose
    from app.state.document import Selection
    from app.state.view_state_store import Left, encode

    pose = ViewPose((1.0, 2.0, 1.5))
    text = encode(Left(pose, "rgb", Selection(viewpoint="v1"), 3, (0, 0, 5, 5), (0.1, 0.2, 1.0), (pose, pose)))
    return [Seed({"v.json": text.encode()}, "v.json", "v.json", "json")]


def _decode_view(path: Path) -> object:
    from app.state.view_state_store import decode, encode

    left = decode(content(path).decode("utf-8", "replace"))
    return left and encode(left)


def _options() -> list[Seed]:
    from app.forms.arguments import FILE

    text = b'{"train": {"steps": 100, "preset": "paper", "seed": 3}, "map": {"config.tau_dist": 0.5, "x": [1]}}'
    return [Seed({FILE: text}, FILE, "", "json")]


def _options_of(path: Path) -> object:
    from app.forms.arguments import Settings

    settings = Settings(path)
    return [settings.arguments(verb) for verb in ("train", "map")]


def _results() -> list[Seed]:
    finding = '{"severity": "error", "message": "m", "where": "w", "consequence": "c"}'
    text = f'{{"refused": true, "findings": [{finding}, {finding}]}}'
    return [Seed({"r.json": text.encode()}, "r.json", "r.json", "json")]


def _result(path: Path) -> object:
    from app.jobs.check import result_of

    return result_of(content(path).decode("utf-8", "replace")).sentence
