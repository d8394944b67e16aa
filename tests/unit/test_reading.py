"""The boundary of every reader."""

from pathlib import Path

import pytest

from nvsim.errors import InputError
from nvsim.files.reading import reading

HERE = Path("map.yaml")


@pytest.mark.parametrize(
    "raised", [ValueError("bad"), KeyError("x"), RecursionError(), MemoryError(), OSError(13, "no")]
)
def test_what_a_library_raises_becomes_one_sentence_with_the_file(raised: Exception) -> None:
    with pytest.raises(InputError, match=r"map\.yaml.*\.$") as caught, reading(HERE, "a ROS map"):
        raise raised
    assert "\n" not in str(caught.value)


def test_a_sentence_that_knows_more_passes_unchanged() -> None:
    with pytest.raises(InputError, match="^line 3 lacks a number$"), reading(HERE, "a ROS map"):
        raise InputError("line 3 lacks a number")


def test_what_ends_the_process_is_not_swallowed() -> None:
    with pytest.raises(KeyboardInterrupt), reading(HERE, "a ROS map"):
        raise KeyboardInterrupt


def test_a_path_without_end_is_shortened_in_its_sentence() -> None:
    from nvsim.files.opening import read_bytes

    with pytest.raises(InputError, match="its name is too long") as refusal:
        read_bytes(Path("/tmp/" + "x" * 4000))
    assert len(str(refusal.value)) < 600
