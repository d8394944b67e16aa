"""Events survive their way through a pipe."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsim.events import Done, Failed, Log, Metric, Preview, Progress, Warning, Worker, from_json, to_json

TEXT = st.text(max_size=30)
EVENTS = st.one_of(
    st.builds(Progress, TEXT, st.integers(), st.integers(), TEXT),
    st.builds(Metric, TEXT, TEXT, st.floats(allow_nan=False, allow_infinity=False), st.integers(), st.integers()),
    st.builds(Preview, TEXT, TEXT, TEXT),
    st.builds(Log, TEXT, TEXT),
    st.builds(Warning, TEXT, TEXT),
    st.builds(Worker, TEXT, TEXT, st.integers(), TEXT, TEXT),
    st.builds(Done, TEXT, TEXT, st.dictionaries(TEXT, st.integers(), max_size=3)),
    st.builds(Failed, TEXT, TEXT, st.integers(0, 2)),
)


@given(EVENTS)
def test_every_event_is_one_line_and_comes_back_equal(event):
    line = to_json(event)
    assert "\n" not in line
    assert from_json(line) == event


@pytest.mark.parametrize("line", ["[]", '{"event": "nothing"}', '{"event": "log"}', "3", '{"event": "log", "x": 1}'])
def test_a_line_that_is_no_event_is_refused(line):
    with pytest.raises(ValueError):
        from_json(line)


@given(st.text(max_size=40))
def test_arbitrary_text_is_an_event_or_refused(line):
    try:
        from_json(line)
    except ValueError:
        return


def test_a_line_that_is_nested_without_end_is_no_event():
    for line in ("[" * 100_000 + "]" * 100_000, '{"event": ' + "[" * 100_000 + "]" * 100_000 + "}"):
        with pytest.raises(ValueError, match="nested too deeply"):
            from_json(line)
