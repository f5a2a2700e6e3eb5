"""Checks: legal values pass unchanged, others raise one line with the value and the range."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bozzini.checks import check_integer, check_number, check_points
from bozzini.errors import InputError

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(value=finite, low=finite, high=finite)
def test_number_passes_exactly_when_it_is_in_the_range(
    value: float, low: float, high: float
) -> None:
    if low <= value <= high:
        assert check_number("gap", value, low=low, high=high) == value
    else:
        with pytest.raises(InputError) as caught:
            check_number("gap", value, low=low, high=high, unit="mm")
        assert f"gap is {value:g} mm" in str(caught.value)
        assert f"[{low:g}, {high:g}] mm" in str(caught.value)


def test_open_end_is_illegal_and_shown_as_open() -> None:
    assert check_number("radius", 1e-300, low=0.0, low_open=True) == 1e-300
    with pytest.raises(InputError, match=r"radius is 0: it must lie in \(0, inf\)"):
        check_number("radius", 0.0, low=0.0, low_open=True)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "wide", None, [1.0, 2.0], 1j])
def test_what_is_no_finite_number_is_refused(value: object) -> None:
    with pytest.raises(InputError, match="^gap is "):
        check_number("gap", value)  # type: ignore[arg-type]


@given(value=st.integers(-100, 100), low=st.integers(-100, 100), high=st.integers(-100, 100))
def test_integer_passes_exactly_when_it_is_in_the_range(value: int, low: int, high: int) -> None:
    if low <= value <= high:
        assert check_integer("steps", value, low=low, high=high) == value
    else:
        with pytest.raises(InputError, match=rf"steps is {value}: it must lie in \[{low}, {high}"):
            check_integer("steps", value, low=low, high=high)


def test_whole_numbers_of_other_types_pass() -> None:
    for value in (3.0, np.int32(3), np.float64(3.0)):
        result = check_integer("steps", value, low=0)  # type: ignore[arg-type]
        assert type(result) is int
        assert result == 3


@pytest.mark.parametrize("value", [2.5, math.nan, math.inf, "many", "3", None, True, [1]])
def test_what_is_no_whole_number_is_refused(value: object) -> None:
    with pytest.raises(InputError, match="whole number in \\[0, inf\\]"):
        check_integer("steps", value, low=0)  # type: ignore[arg-type]


points = hnp.arrays(
    np.float64,
    st.tuples(st.integers(0, 5), st.just(3)),
    elements=st.floats(-1e6, 1e6),
)


@given(array=points)
def test_points_pass_unchanged_whatever_they_come_as(array: np.ndarray) -> None:
    result = check_points("start", array)
    assert result.dtype == np.float64
    assert np.array_equal(result, array)
    if len(array):
        assert np.array_equal(check_points("start", array.tolist()), array)


@given(array=points.filter(len), data=st.data())
def test_one_bad_point_is_counted(array: np.ndarray, data: st.DataObject) -> None:
    row = data.draw(st.integers(0, len(array) - 1))
    array = array.copy()
    array[row, data.draw(st.integers(0, 2))] = data.draw(st.sampled_from([np.nan, np.inf]))
    with pytest.raises(InputError, match=r"start has 1 point\(s\) that are not finite"):
        check_points("start", array)


@pytest.mark.parametrize("value", [1.0, [1.0, 2.0], np.zeros((3, 4)), "abc", [[1, 2, 3], [4, 5]]])
def test_points_of_a_wrong_shape_are_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"^start .*\(\.\.\., 3\)"):
        check_points("start", value)  # type: ignore[arg-type]
