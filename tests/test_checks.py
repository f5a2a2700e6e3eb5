"""Checks: legal values pass unchanged, others raise one line with the value and the range."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bozzini.checks import (
    broadcast,
    check_array,
    check_fields,
    check_integer,
    check_number,
    check_path,
    check_points,
    check_range,
    choose,
    describe_fields,
    legal_range,
    list_quantities,
    quantity,
    refuse_first,
    restate_typed,
    show_apart,
    show_beside,
)
from bozzini.errors import InputError
from bozzini.results import take_axes

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
        assert f"gap is {value:zg} mm" in str(caught.value)
        assert f"[{low:zg}, {high:zg}] mm" in str(caught.value)


def test_open_end_is_illegal_and_shown_as_open() -> None:
    assert check_number("radius", 1e-300, low=0.0, low_open=True) == 1e-300
    with pytest.raises(InputError, match=r"radius is 0: it must lie in \(0, inf\)"):
        check_number("radius", 0.0, low=0.0, low_open=True)


# fmt: off
REFUSALS: list[tuple[Callable[[object], object], str, str, tuple[object, ...]]] = [
    (lambda value: check_number("gap", value), "gap is ", "(-inf, inf)", (
        math.nan, math.inf, -math.inf, 10**400, 10**5000, 1j, np.complex64(1.0),
        "wide", "1.5", b"1.5", np.str_("1.5"), np.array("1.5"), True, np.True_, None,
        [1.0, 2.0], np.array([1.0]), np.ones((20, 20)),
    )),
    (lambda value: check_array("load", value), "load is ", "a number or an array of numbers", (
        "0.5", ["0.5"], [["a", "b"], ["c", "d"]], b"1", [None], None, object(), [[1.0], [1, 2]],
        True, [True, False], 1j, [1j], np.array([1j]), [10**400], np.array("2020", "M8[D]"),
        {"a": 1}, np.ma.masked_greater([1.0, 3.0], 2.0),
    )),
    (lambda value: check_integer("steps", value, low=0), "steps is ", "whole number in [0, inf]", (
        2.5, math.nan, math.inf, "many", "3", None, True, [1],
    )),
    (lambda value: choose("model", value, {"arc": 1, "rod": 2}), "there is no model ", "arc, rod", (
        "pcc", "", None, math.nan, 0, [], {}, ["arc"], {"arc"}, np.zeros(3), object(),
    )),
    (lambda value: check_path("path", value), "path is ", "the path of a file", (
        None, math.nan, 1, True, [], ["a.stl"], {}, object(), b"a.stl",
    )),
    (lambda value: take_axes(value, x="x", y="y"), "ax is ", "axes of matplotlib", (
        "x", 1.0, [], {}, object(),
    )),
    (lambda value: check_points("start", value), "start ", "(..., 3)", (
        1.0, [1.0, 2.0], np.zeros((3, 4)), "abc", [[1, 2, 3], [4, 5]],
        np.zeros(3, dtype=complex), ["1", "2", "3"], [True, False, True],
    )),
]
# fmt: on
"""Which check, the field that the message names, what it states as legal, and what is given."""


@pytest.mark.parametrize(
    ("check", "field", "legal", "value"),
    [(*row[:3], value) for row in REFUSALS for value in row[3]],
    ids=lambda part: type(part).__name__,
)
def test_refused(check: Callable[[object], object], field: str, legal: str, value: object) -> None:
    with pytest.raises(InputError) as caught:
        check(value)
    line = str(caught.value)
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 200


@pytest.mark.parametrize("value", [2, np.int8(2), np.float32(2.0), np.array(2.0), np.uint64(2)])
def test_numbers_of_any_kind_become_floats(value: float) -> None:
    result = check_number("gap", value)
    assert type(result) is float
    assert result == 2.0


@pytest.mark.parametrize("values", [2.5, [1, 2], (1.0, 2.0), np.arange(6).reshape(2, 3), [], [[]]])
def test_arrays_of_numbers_pass(values: object) -> None:
    result = check_array("load", values)  # type: ignore[arg-type]
    assert result.dtype == np.float64
    assert np.array_equal(result, np.asarray(values))


@given(
    values=hnp.arrays(np.float64, st.tuples(st.integers(0, 3), st.integers(1, 3))),
    low=st.floats(-10.0, 10.0),
    width=st.floats(0.0, 10.0),
)
def test_a_range_names_the_first_outside(values: np.ndarray, low: float, width: float) -> None:
    outside = np.argwhere(~((values >= low) & (values <= low + width)))
    if len(outside):
        place = ", ".join(str(index) for index in outside[0])
        with pytest.raises(InputError) as caught:
            check_range("load", values, low, low + width, "N")
        name, _, told = str(caught.value).partition(" is ")
        assert name == f"load[{place}]"
        # As many digits as tell it from the range.
        assert float(told.split()[0]) == pytest.approx(
            values[tuple(outside[0])], rel=1e-5, nan_ok=True
        )
    else:
        check_range("load", values, low, low + width, "N")


def test_shapes_go_together_or_are_named() -> None:
    first, second = broadcast(("a", np.ones((3, 1))), ("b", np.ones(2)))
    assert first.shape == second.shape == (3, 2)
    assert first.flags.c_contiguous
    assert broadcast(("a", np.asarray(1.0)))[0].shape == ()
    with pytest.raises(InputError, match=r"do not go together: a \(3,\), b \(2,\)"):
        broadcast(("a", np.ones(3)), ("b", np.ones(2)))


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


@dataclass(frozen=True)
class Box:
    width: float = quantity("length", "How wide.", low=0.0, low_open=True, high=10.0)
    height: float = quantity("length", default=1.0, low=0.0, high=lambda box: 2.0 * box.width)
    count: int = quantity(default=3, low=1, high=9, whole=True)
    name: str = "box"

    def __post_init__(self) -> None:
        check_fields(self, "box ")


def test_a_field_states_its_unit_range_and_help_once() -> None:
    box = Box(np.float32(2.0), height=4)  # type: ignore[arg-type]
    assert describe_fields(box) == {"width_mm": 2.0, "height_mm": 4.0, "count": 3}
    assert [type(value) for value in describe_fields(box).values()] == [float, float, int]
    assert legal_range(box, "height") == (0.0, 4.0)
    assert list_quantities(Box)["width"].help == "How wide."
    assert set(list_quantities(Box)) == {"width", "height", "count"}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"width": 0.0}, r"^box width is 0 mm: it must lie in \(0, 10\] mm$"),
        ({"width": "2"}, "^box width is '2': it must be a number"),
        ({"height": 4.1}, r"^box height is 4.1 mm: it must lie in \[0, 4\] mm$"),
        ({"count": 2.5}, r"^box count is 2.5: it must be a whole number in \[1, 9\]$"),
    ],
)
def test_a_field_outside_its_range_is_refused(given: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Box(**{"width": 2.0, **given})  # type: ignore[arg-type]


def test_the_first_wrong_value_is_named() -> None:
    values = np.array([[1.0, 2.0], [3.0, -4.0]])
    refuse_first(values > 9.0, "load", values, "it must be less")
    with pytest.raises(InputError, match=r"^load\[1, 1\] of it is -4 N: it must be above 3$"):
        refuse_first(
            values < 0.0, "load{} of it", values, lambda i: f"it must be above {i}", unit="N"
        )


@given(value=st.floats(-1e9, 1e9), off=st.floats(1e-12, 1e-2))
def test_a_value_beyond_a_limit_never_reads_like_it(value: float, off: float) -> None:
    limit = value - off * max(abs(value), 1e-6)
    for digits, form in ((6, "g"), (0, "f")):
        one, two = show_apart(value, limit, digits=digits, form=form)
        assert one != two
        assert float(one) == pytest.approx(value, rel=1e-5 if form == "g" else 1e-9, abs=0.5)
    with pytest.raises(InputError) as caught:
        check_number("size", value, low=-math.inf, high=limit)
    shown, legal = str(caught.value).removeprefix("size is ").split(": it must lie in (-inf, ")
    assert shown != legal.removesuffix("]")
    with pytest.raises(InputError) as caught:
        check_range("size", np.array([value]), -2e9, limit)
    shown, legal = str(caught.value).removeprefix("size[0] is ").split(": it must lie in ")
    assert shown != legal.split(", ")[1].removesuffix("]")


def test_what_reads_apart_keeps_its_digits() -> None:
    assert show_apart(14.98, 15.0, digits=0, form="f") == ["14.98", "15.00"]
    assert show_apart(12.0, 15.0, digits=0, form="f") == ["12", "15"]
    assert show_apart(6.0 + 1e-9, 6.0) == ["6.000000001", "6"]
    assert show_apart(6.0, 6.0 - 1e-9) == ["6", "5.999999999"]
    assert show_apart(6.0, 6.0) == ["6", "6"]
    assert show_apart(math.inf, 6.0) == ["inf", "6"]
    assert show_apart(-0.001, 0.0, digits=2, form="f") == ["-0.001", "0.000"]
    assert show_apart(-0.0, 6.0, digits=2, form="f") == ["0.00", "6.00"]
    assert show_beside(6.0 + 1e-9, "it must lie in (0, 6] mm") == "6.000000001"
    with pytest.raises(InputError, match=r"^a\[1\] is 2\.0000001 mm: it must lie in \[0, 2\] mm$"):
        values = np.array([1.0, 2.0000001])
        refuse_first(values > 2.0, "a", values, "it must lie in [0, 2] mm", unit="mm")


def test_a_value_in_another_unit_reads_apart_from_its_limit_there_too() -> None:
    with pytest.raises(InputError) as caught:
        check_number("length", 25.4 * 1.00000001, high=25.4, low=0.0, unit="mm")
    line = restate_typed(str(caught.value), "1.00000001in", "length")
    assert line.endswith("(1.00000001in was given, [0, 1] in is legal)")
