"""Files of the window: saved views, command options, results of child processes, and opened paths."""

from __future__ import annotations

from pathlib import Path
from threading import Event

import cv2
import numpy as np
from PySide6.QtCore import QSettings

from fuzzing.captures import cloud_samples
from fuzzing.graphs import row
from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, content, each, files_in
from nvsim.events import Metric, Progress, from_json, to_json
from nvsim.graph.connectivity import write_connectivity
from nvsim.project.path_kind import check_openable, path_kind, sentence_about
from nvsim_app.forms.fields import FILE, Settings
from nvsim_app.jobs.queries import result_of
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.panels.comparison import ComparedGraphs, read_graph
from nvsim_app.panels.preferences import PREFERENCES, Preferences, memory_budget
from nvsim_app.panels.training_images import read_picture
from nvsim_app.start.application import check_settings
from nvsim_app.state.document import Selection
from nvsim_app.state.folder_listing import list_folder
from nvsim_app.state.view_state_store import StoredViewState, decode, encode


def readers() -> list[Reader]:
    return [
        Reader("view kept", _views, _decode_view),
        Reader("options kept", _options, _options_of),
        Reader("check result", _results, _result, refusals=(ValueError,)),
        Reader("preferences", _settings, _preferences),
        Reader("image of a job", _previews, _preview),
        Reader("compared graph", _graphs, _compared),
        Reader("opened path", _paths, _kinds, share=3),
        Reader("events of a command", _lines, _event, refusals=(ValueError,)),
    ]


def _views() -> list[Seed]:
    pose = ViewPose((1.0, 2.0, 1.5))
    text = encode(
        StoredViewState(pose, "rgb", Selection(viewpoint="v1"), 3, (0, 0, 5, 5), (0.1, 0.2, 1.0), (pose, pose))
    )
    return [Seed({"v.json": text.encode()}, "v.json", "v.json", "json")]


def _decode_view(path: Path) -> object:
    left = decode(content(path).decode("utf-8", "replace"))
    return left and encode(left)


def _options() -> list[Seed]:
    text = b'{"train": {"steps": 100, "preset": "paper", "seed": 3}, "map": {"config.tau_dist": 0.5, "x": [1]}}'
    return [Seed({FILE: text}, FILE, "", "json")]


def _options_of(path: Path) -> object:
    settings = Settings(path)
    return [settings.arguments(verb) for verb in ("train", "map")]


def _results() -> list[Seed]:
    finding = '{"severity": "error", "message": "m", "where": "w", "consequence": "c"}'
    text = f'{{"refused": true, "findings": [{finding}, {finding}]}}'
    return [Seed({"r.json": text.encode()}, "r.json", "r.json", "json")]


def _result(path: Path) -> object:
    return result_of(content(path).decode("utf-8", "replace")).sentence


def _settings() -> list[Seed]:
    text = "[General]\ntheme=dark\nmemory_gib=4\nunits=feet\n[mouse]\nleft=turn\nupside_down=true\n"
    text += "[window]\ngeometry=@ByteArray(\\x1\\xd9)\nrecent=/a/b.nvsim, /c\n"
    return [Seed({"s.ini": text.encode()}, "s.ini", "s.ini", "text")]


def _preferences(path: Path) -> object:
    check_settings(path)
    preferences = Preferences(QSettings(str(path), QSettings.Format.IniFormat))
    return [preferences[p.key] for p in PREFERENCES], memory_budget(preferences)


def _previews() -> list[Seed]:
    image = cv2.imencode(".jpg", np.full((24, 32, 3), 99, np.uint8))[1].tobytes()
    return [Seed({"p.jpg": image}, "p.jpg", "p.jpg", "picture")]


def _preview(path: Path) -> object:
    return read_picture(path).size()


def _graphs() -> list[Seed]:
    with workshop() as folder:
        write_connectivity(row(), folder)
        files = files_in(folder)
    return each(files, "row_connectivity.json", {"row_connectivity.json": "json"})


def _compared(path: Path) -> object:
    return ComparedGraphs.of("other", row(), read_graph(path)).comparison.deviations


_NAMES = ("a.ply", "a.splat", "a.json", "a_connectivity.json", "a.yaml", "a.bt", "a", "meta.json", "transforms.json")


def _paths() -> list[Seed]:
    """The given contents under every file name that implies a format."""
    contents = [next(iter(cloud_samples().values())), b'{"frames": []}', b'[{"image_id": "a"}]', b"image: m.pgm\n"]
    return [Seed({name: data}, name, name, "headed", readable=False) for name in _NAMES for data in contents]


def _kinds(path: Path) -> object:
    """Examines a path as the window does before it opens it."""
    sentence_about(path, path_kind(path))
    list_folder(path.parent, Event())
    return check_openable(path)


def _lines() -> list[Seed]:
    lines = [to_json(Progress("map", 1, 3, "step")), to_json(Metric("train", "psnr", 20.5, 3))]
    return [Seed({"e.json": line.encode()}, "e.json", "e.json", "json") for line in lines]


def _event(path: Path) -> object:
    """Reads the output of a command with --json as the window does."""
    return to_json(from_json(content(path).decode("utf-8", "replace")))
