"""The numbers of the files of a frame, after a capture with other frames was imported."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsim.files.frame_numbers import NAME, number_in, write_frame_names
from nvsim.project.layout import Layout
from nvsim_app.frames.frame_data import read_frame_data


def test_a_file_follows_its_frame(tmp_path: Path) -> None:
    assert number_in(tmp_path, "b.jpg", 1) == 1, "folders of earlier versions have no names"
    write_frame_names(tmp_path, ["a.jpg", "b.jpg", "c.jpg"])
    assert [number_in(tmp_path, name, 0) for name in ("c.jpg", "a.jpg", "new.jpg")] == [2, 0, -1]
    write_frame_names(tmp_path, ["c.jpg"])
    assert number_in(tmp_path, "c.jpg", 0) == 0
    (tmp_path / NAME).write_text("{damaged")
    assert number_in(tmp_path, "c.jpg", 2) == 2


def test_a_frame_shows_its_own_mask_and_depth(tmp_path: Path) -> None:
    import cv2

    from nvsim.capture.types import Frame
    from nvsim.depth.files import write_depth
    from nvsim.geometry.lens import Lens

    layout = Layout(tmp_path)
    for folder in (layout.masks, layout.depth):
        folder.mkdir(parents=True)
        write_frame_names(folder, ["a.png", "b.png"])
    image = tmp_path / "b.png"
    cv2.imwrite(str(image), np.zeros((4, 4, 3), np.uint8))
    for number, floor in enumerate((0, 255)):
        cv2.imwrite(str(layout.mask(number)), np.full((4, 4), floor, np.uint8))
        write_depth(layout.depth, number, np.full((4, 4), 1.0 / (1 + number), np.float32), np.ones((4, 4), np.uint8))
    frame = Frame("b.png", image, Lens("PINHOLE", 4, 4, (4.0, 4.0, 2.0, 2.0)), np.eye(4))
    found = read_frame_data(layout, frame, 0)  # a.png was left out
    assert found.mask is not None and found.mask.all() and found.machine is not None and found.machine.all()
    assert found.depth is not None and (found.depth == 2.0).all()
    other = read_frame_data(layout, Frame("new.png", image, frame.lens, np.eye(4)), 0)
    assert other.mask is None and other.machine is None and other.depth is None
