"""The files of a project except its database, as the window and its frame process read them."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from multiprocessing import Pipe
from pathlib import Path

import cv2
import numpy as np

from fuzzing.graphs import row
from fuzzing.models import model_files
from fuzzing.places import workshop
from fuzzing.projects import project_with_walk
from fuzzing.reader import Files, Reader, Seed, each
from nvsim.capture.images import read_image
from nvsim.capture.types import Alignment
from nvsim.evaluation.frame_truth import frame_truth
from nvsim.evaluation.validity import StoredMap
from nvsim.evaluation.views import read_novel_views
from nvsim.graph.store import encode_graph
from nvsim.perception.failures import NAME, read_failures
from nvsim.project.floor_heights import floor_of
from nvsim.project.jobs.files import JobCommand, encode_order, order_path, read_order
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim.splats import files
from nvsim_app.frames.frame_data import read_frame_data
from nvsim_app.frames.worker import FailedRequest, Worker
from nvsim_app.processes.serving import Requests
from nvsim_app.state.loading import ProjectReader
from nvsim_app.state.side_work import LAST_VIEW, look_at


def readers() -> list[Reader]:
    return [
        Reader("project files", _files, _everything, share=3),
        Reader("frame of a project", _frames, _frame, share=2),
        Reader("thumbnails and coverage", _frames, _thumbnails),
        Reader("novel views", _novel, _novel_views),
        Reader("failures of masks", _failures, _failed),
        Reader("order of a job", _orders, _order, refusals=(OSError, ValueError)),
        Reader("map of a table", _cells, _cell),
        Reader("true masks", _truth, _true),
        Reader("recent project", _recent, _recently),
    ]


@cache
def _whole() -> Files:
    """A project with masks, floors, and models of two submaps. Its images are inside the project."""
    files = project_with_walk()
    mask = np.zeros((48, 64), np.uint8)
    mask[24:] = 255
    png = cv2.imencode(".png", mask)[1].tobytes()
    files |= {f"masks/{i:06d}.png": png for i in range(12)} | {"corrections/images%2F001.png.png": png}
    for k in range(2):
        files |= {f"models/submap_{k:03d}/{n}": d for n, d in model_files("linear").items()}
    return files


def _files() -> list[Seed]:
    files = _whole()
    forms = {".json": "json", ".npz": "zip", ".ply": "headed", ".safetensors": "tensors"}
    names = [n for n in files if n.startswith(("imported/", "floor/", "cuts/", "models/submap_000"))]
    return each(files, "", {n: forms[Path(n).suffix] for n in names})


def _everything(path: Path) -> object:
    """Reads everything that the window shows of a project, in one process."""
    files._verified.clear()
    with Project.open(path) as project:
        scene, found = project.scene(), (project.capture(), project.support(), project.surface(0))
        floor_of(project).height_at(np.zeros((2, 2)))
        if scene is not None:
            scene.model_at(np.zeros(3))
    reader = ProjectReader(path)
    try:
        return found, reader._models(), reader._model_info()
    finally:
        reader.close()


def _frames() -> list[Seed]:
    files = {**_whole(), "cache/coverage.json": json.dumps({"masks/000000.png": [1, 0.5]}).encode()}
    forms = {
        "masks/000001.png": "picture",
        "corrections/images%2F001.png.png": "picture",
        "cache/coverage.json": "json",
    }
    return each(files, "", {**forms, "images/001.png": "picture", "images/002.png": "picture"})


def _frame(path: Path) -> object:
    """Reads the page of a frame. The images moved together with the project."""
    with Project.open(path) as project:
        capture = project.need_capture()
        for index in (1, 2):
            frame = replace(capture.frames[index], image_path=path / "images" / capture.frames[index].image_path.name)
            read_image(frame, frame.intrinsics.limited_to(32))
            read_frame_data(Layout(path), frame, index)
        return capture


def _thumbnails(path: Path) -> object:
    """The answers of the frame process. It handles every error itself; an unexpected one is a fault."""
    said: list[object] = []
    requests = Requests(Pipe()[0])
    requests.answer = lambda number, value, more=False: said.append(value)  # type: ignore[method-assign]
    worker = Worker(path, requests)
    capture = worker._project.need_capture()
    frames = tuple(replace(f, image_path=path / "images" / f.image_path.name) for f in capture.frames)
    worker._project.need_capture = lambda: replace(capture, frames=frames)  # type: ignore[method-assign]
    worker._thumbnails = [2, 1]
    worker._coverage = worker._read_coverage(0)
    while worker._thumbnails or worker._coverage is not None:
        worker._step()
    worker._project.close()
    for answer in said:
        if isinstance(answer, FailedRequest) and "unexpected error (" in answer.sentence:
            raise RuntimeError(answer.sentence)
    return said


def _novel() -> list[Seed]:
    pose = " ".join(map(str, np.eye(4).ravel()))
    head = "# PINHOLE 64 48 fx 40 fy 40 cx 32 cy 24\n# name and pose\n"
    text = head + "".join(f"holdout/{k}.png {pose}\n" for k in range(3))
    return [Seed({"holdout_frames.txt": text.encode()}, "holdout_frames.txt", "", "text")]


def _novel_views(path: Path) -> object:
    return read_novel_views(path, Alignment(np.eye(3), 1.0, True))


def _failures() -> list[Seed]:
    return [Seed({NAME: b'{"0": "provider", "7": "empty", "12": "prompt"}'}, NAME, "", "json")]


def _failed(path: Path) -> object:
    return read_failures(path)


def _orders() -> list[Seed]:
    with workshop() as folder:
        text = encode_order(folder, 1, JobCommand("map", ("--project", "x"), "A map"))
    name = order_path(Path()).name
    return [Seed({name: text.encode()}, name, "", "json")]


def _order(path: Path) -> object:
    return read_order(path, 1, path)


def _cells() -> list[Seed]:
    files = {"cell.json": b'{"models": ["a"], "report": {"seconds": 3.5}}', "graph.zip": encode_graph(row())}
    return each(files, "", {"cell.json": "json", "graph.zip": "zip"})


def _cell(path: Path) -> object:
    return StoredMap(path).read()


def _truth() -> list[Seed]:
    floor = cv2.imencode(".png", np.full((24, 32), 255, np.uint8))[1].tobytes()
    normals = cv2.imencode(".png", np.full((24, 32, 3), (255, 127, 127), np.uint8))[1].tobytes()
    truth = {"truth/floor/000.png": floor, "truth/normals/000.png": normals}
    return each({**project_with_walk(), **truth}, "", {name: "picture" for name in truth})


def _true(path: Path) -> object:
    """Reads ground truth as `nvsim evaluate floor --truth` does."""
    with Project.open(path) as project:
        truth = frame_truth(project, path / "truth", False)
        return truth.size(0), truth.floor(0, 32, 24)[0].mean(), truth.normal_map(0, 32, 24).mean()


def _recent() -> list[Seed]:
    picture = cv2.imencode(".png", np.full((24, 32, 3), 99, np.uint8))[1].tobytes()
    files = {**project_with_walk(), f"cache/{LAST_VIEW}": picture, "cache/thumbnails/000001.jpg": picture}
    return each(files, "", {f"cache/{LAST_VIEW}": "picture", "imported/capture.json": "json"})


def _recently(path: Path) -> object:
    return look_at(path)
