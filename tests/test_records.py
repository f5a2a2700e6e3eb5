"""Records: what is written is read again, and a wrong field is one line with its path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.checks import quantity
from bozzini.errors import FileFormatError, InputError
from bozzini.io.records import load_record, read_record, save_record, write_record


@dataclass(frozen=True, kw_only=True)
class Part:
    length: float = quantity("length", "Length.", low=0.0, low_open=True, high=10.0)
    count: int = quantity(help="How many.", low=1, high=9, whole=True, default=0)
    places: tuple[float, ...] = quantity("length", "Places.", default=())
    limit: tuple[float | None, float | None] | None = quantity("angle", "Limits.", default=None)
    kind: Literal["soft", "stiff"] = "soft"


@dataclass(frozen=True, kw_only=True)
class Whole:
    parts: tuple[Part, ...]
    name: str = ""
    weight: float = math.inf
    done: bool = False


lengths = st.floats(1e-6, 10.0)
parts = st.builds(
    Part,
    length=lengths,
    count=st.integers(1, 9),
    places=st.lists(lengths, max_size=3).map(tuple),
    limit=st.none() | st.tuples(st.none() | lengths, st.none() | lengths),
    kind=st.sampled_from(["soft", "stiff"]),
)
wholes = st.builds(
    Whole,
    parts=st.lists(parts, max_size=3).map(tuple),
    name=st.text(max_size=3),
    weight=st.just(math.inf) | lengths,
    done=st.booleans(),
)


@given(whole=wholes)
def test_what_is_written_is_read_again(whole: Whole) -> None:
    assert read_record(write_record(whole), Whole) == whole


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_files_hold_the_same(tmp_path: Path, suffix: str) -> None:
    whole = Whole(parts=(Part(length=2.0, places=(1.0, 1.5), limit=(None, 0.5)),), name="é")
    assert load_record(save_record(whole, tmp_path / f"a{suffix}", note="mm"), Whole) == whole


def test_units_are_those_of_the_field() -> None:
    data = {"parts": [{"length": "1 cm", "places": ["1 um", 2], "limit": ["90 deg", None]}]}
    part = read_record(data, Whole).parts[0]
    assert (part.length, part.places) == (10.0, (pytest.approx(1e-3), 2.0))
    assert part.limit == (pytest.approx(math.pi / 2.0), None)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (3, "the plan is 3: it must hold the fields parts, name"),
        ({}, "the plan has no 'parts': it needs parts"),
        ({"part": []}, "the plan has an unknown field 'part': did you mean 'parts'?"),
        ({"parts": {}}, r"parts is \{\}: it must be a list"),
        ({"parts": [3]}, r"parts\[0\] is 3: it must hold"),
        ({"parts": [{"length": 11}]}, r"parts\[0\]\.length is 11 mm: it must lie in \(0, 10\] mm"),
        ({"parts": [{"length": "2 cm"}]}, r"20 mm: .* \(2 cm was given, \(0, 1\] cm is legal\)$"),
        ({"parts": [{"length": "5e14 km"}]}, r"parts\[0\]\.length: '5e14 km' is 5e\+20 mm"),
        ({"parts": [{"length": True}]}, r"parts\[0\]\.length is True: it must be a length"),
        ({"parts": [{"length": 1, "count": 0}]}, r"count is 0: it must lie in \[1, 9\], or leave"),
        ({"parts": [{"length": 1, "count": 1.5}]}, "count is 1.5: it must be a whole number"),
        ({"parts": [{"length": 1, "places": [1, "x"]}]}, r"parts\[0\]\.places\[1\]: 'x' is not"),
        ({"parts": [{"length": 1, "limit": [1]}]}, r"limit is \[1\]: it must be a list of 2"),
        ({"parts": [{"length": 1, "kind": "odd"}]}, "kind is 'odd': choose one of soft, stiff"),
        ({"parts": [], "name": 3}, "name is 3: it must be text"),
        ({"parts": [], "done": 1}, "done is 1: it must be true or false"),
    ],
)
def test_a_wrong_field_is_one_line_with_its_path(data: object, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read_record(data, Whole, name="the plan")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.json", '{"parts": [], "parts": []}', "the field 'parts' is given twice"),
        ("a.yaml", "parts: []\nparts: []\n", "line 2: the field 'parts' is given twice"),
        ("a.yaml", "parts: &p [*p]\n", "line 1 refers to '&p': write it out"),
        ("a.yaml", "parts: [", "not YAML in line 1"),
        ("a.json", "{", "not JSON"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_line(
    tmp_path: Path, name: str, text: str, words: str
) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=words) as caught:
        load_record(path, Whole)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
