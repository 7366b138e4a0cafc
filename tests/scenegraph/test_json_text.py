"""JSON that strict parsers read, and numbers that come back."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph.json_text import json_text
from strict_json import parsed

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda below: st.lists(below) | st.dictionaries(st.text(), below),
)


@given(PLAIN)
def test_what_is_finite_is_written_as_ever(value: object) -> None:
    assert json_text(value, indent=2, sort_keys=True) == json.dumps(value, indent=2, sort_keys=True)


@given(st.lists(st.floats(allow_nan=False)))
def test_float_gives_infinite_numbers_back(values: list[float]) -> None:
    assert [float(v) for v in parsed(json_text(values))] == values


def test_what_is_not_finite_has_one_spelling_at_any_depth() -> None:
    value = {"a": [math.inf, (-math.inf, np.float64(math.nan), np.float64(math.inf))], math.inf: {"b": {"c": math.nan}}}
    expected = {"a": ["Infinity", ["-Infinity", None, "Infinity"]], "Infinity": {"b": {"c": None}}}
    assert parsed(json_text(value)) == expected
    assert value["a"][0] == math.inf, "the value itself stays as it is"


@pytest.mark.parametrize("value", [{1, 2}, np.float32(1), object()])
def test_other_things_are_refused(value: object) -> None:
    with pytest.raises(TypeError):
        json_text([value])
