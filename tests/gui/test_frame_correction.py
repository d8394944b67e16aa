"""Painting, growing and undoing a mask, without any widget."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim_app.frames.correction import Box, Correction, Prompt, changed_box, paint, surfaces

SHAPE = (60, 80)


def empty() -> np.ndarray:
    return np.zeros(SHAPE, bool)


@settings(max_examples=60, deadline=None)
@given(*[st.floats(-20, 100) for _ in range(4)], st.floats(0.5, 30))
def test_a_step_of_the_brush_covers_what_lies_within_its_radius_of_the_segment(
    x0: float, y0: float, x1: float, y1: float, radius: float
) -> None:
    mask = empty()
    box = paint(mask, (x0, y0), (x1, y1), radius, True)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    along = np.linspace(0, 1, 400)[:, None, None]
    slow = np.hypot(x - (x0 + along * (x1 - x0)), y - (y0 + along * (y1 - y0))).min(axis=0)
    reach = max(radius, 0.71)
    assert mask[slow < reach - 0.3].all() and not mask[slow > reach + 0.03].any()
    if box is None:
        assert not mask.any()
    else:
        outside = mask.copy()
        outside[box.slices] = False
        assert not outside.any()


def test_the_smallest_brush_paints_the_pixel_it_is_in() -> None:
    mask = empty()
    paint(mask, (10.5, 7.5), (10.5, 7.5), 0.5, True)
    assert list(zip(*np.nonzero(mask), strict=True)) == [(7, 10)]


def test_changed_is_the_smallest_box() -> None:
    a, b = empty(), empty()
    assert changed_box(a, b) is None
    b[5, 10] = b[9, 3] = True
    assert changed_box(a, b) == Box(3, 5, 11, 10)


def stroke(correction: Correction, y: float, floor: bool = True) -> None:
    correction.begin()
    correction.paint((10, y), (30, y), 4, floor)
    correction.paint((30, y), (60, y), 4, floor)
    correction.end("Paint floor")


def test_a_stroke_is_one_step_and_is_undone_to_the_pixel() -> None:
    correction = Correction(empty(), empty())
    stroke(correction, 20)
    first = correction.mask.copy()
    stroke(correction, 24, floor=False)
    second = correction.mask.copy()
    assert correction.is_corrected and correction.undo_text == "Paint floor"
    correction.undo()
    assert np.array_equal(correction.mask, first)
    correction.undo()
    assert not correction.mask.any() and not correction.is_corrected and correction.undo() is None
    correction.redo()
    correction.redo()
    assert np.array_equal(correction.mask, second) and correction.redo() is None


def test_a_stroke_that_changes_nothing_is_no_step() -> None:
    correction = Correction(np.ones(SHAPE, bool), empty())
    stroke(correction, 20)
    assert correction.undo_text == ""
    correction.begin()
    correction.paint((-50, -50), (-40, -40), 3, False)
    assert not correction.end("Erase floor")


def test_a_new_step_forgets_what_was_undone() -> None:
    correction = Correction(empty(), empty())
    stroke(correction, 20)
    correction.undo()
    stroke(correction, 40)
    assert correction.redo_text == ""


def test_reverting_gives_the_machines_mask_and_can_be_undone() -> None:
    machine = empty()
    machine[40:] = True
    correction = Correction(machine, machine)
    stroke(correction, 10)
    painted = correction.mask.copy()
    correction.revert()
    assert not correction.is_corrected
    correction.undo()
    assert np.array_equal(correction.mask, painted)


def normals_and_image() -> tuple[np.ndarray, np.ndarray]:
    """At half the size of the mask: floor below, a wall above, a desk in it."""
    normals = np.zeros((30, 40, 3), np.float32)
    normals[...] = (0, -1, 0)
    normals[20:] = normals[5:10, 25:35] = (0, 0, 1)
    return normals, np.full((30, 40, 3), 128, np.uint8)


def click(correction: Correction, prompt: Prompt, normals: np.ndarray, image: np.ndarray) -> None:
    correction.prompt(prompt, *surfaces((*correction.prompts, prompt), normals, image))


FLOOR, DESK = Prompt(0.2, 0.9, True), Prompt(0.75, 0.25, True)


def test_prompts_add_and_take_away_whole_surfaces() -> None:
    normals, image = normals_and_image()
    correction = Correction(empty(), empty())
    click(correction, FLOOR, normals, image)
    assert correction.mask[42:].all() and not correction.mask[:38].any()
    click(correction, DESK, normals, image)
    assert correction.mask[12:18, 54:66].all()
    click(correction, Prompt(0.75, 0.2, False), normals, image)  # on the desk too: they share it
    correction.undo()
    correction.undo()
    assert correction.prompts == (FLOOR,) and not correction.mask[:38].any()


def test_a_negative_prompt_alone_takes_its_surface_out_of_the_machines_mask() -> None:
    normals, image = normals_and_image()
    machine = empty()
    machine[40:] = machine[10:20, 50:70] = True
    correction = Correction(machine, machine)
    click(correction, Prompt(0.75, 0.25, False), normals, image)
    assert not correction.mask[:20].any() and correction.mask[42:].all()


def test_prompts_after_undoing_a_stroke_go_on_from_their_own_base() -> None:
    normals, image = normals_and_image()
    correction = Correction(empty(), empty())
    click(correction, FLOOR, normals, image)
    stroke(correction, 30)
    click(correction, DESK, normals, image)
    correction.undo()
    correction.undo()  # the stroke
    assert correction.prompts == (FLOOR,)
    click(correction, DESK, normals, image)
    assert not correction.mask[22:38].any() and correction.mask[42:].all() and correction.mask[14, 60]


def test_masks_of_different_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="differ"):
        Correction(empty(), np.zeros((3, 3), bool))


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 80), st.floats(0, 60), st.booleans()), min_size=1, max_size=8), st.data())
def test_any_walk_through_the_history_ends_where_it_began(steps: list, data: st.DataObject) -> None:
    correction = Correction(empty(), empty())
    masks = [correction.mask.copy()]
    for x, y, floor in steps:
        correction.begin()
        correction.paint((x, y), (x + 9, y - 4), 5, floor)
        if correction.end("Paint"):
            masks.append(correction.mask.copy())
    place = len(masks) - 1
    for back in data.draw(st.lists(st.booleans(), max_size=12)):
        moved = correction.undo() if back else correction.redo()
        place += (0 if moved is None else 1) * (-1 if back else 1)
        assert np.array_equal(correction.mask, masks[place])
