"""Tables of measurements: what is read is what was written, and a bad table is one clear line."""

from __future__ import annotations

import math
import sys
import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.errors import BozziniError, FileFormatError, InputError, MissingExtraError, UnitError
from bozzini.muscle.data import Measurements
from bozzini.muscle.design import preset
from bozzini.muscle.table import read_measurements, write_measurements

MUSCLE = preset("thesis-45")
STRAND = 45.0 / math.cos(math.radians(36.0))


def write(tmp_path, text, name="data.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def make_rows():
    numbers = st.floats(-20.0, 20.0, allow_nan=False)
    return st.lists(
        st.tuples(
            st.floats(0.0, 20.0),
            numbers,
            st.floats(0.0, 20.0),
            st.sampled_from(["inflating", "deflating", ""]),
            st.one_of(
                st.text("abc, 12;\"'#é\u2028\x85 ", max_size=5),
                st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=5),
            ).map(lambda text: "".join(c for c in text if unicodedata.category(c) != "Cc")),
        ),
        min_size=1,
        max_size=20,
    )


def make_data(rows):
    names = ("pressure", "contraction", "load", "direction", "specimen")
    columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    return Measurements(**columns)


@given(make_rows())
def test_a_file_gives_back_what_was_written(tmp_path_factory, rows):
    data = make_data(rows)
    path = write_measurements(tmp_path_factory.mktemp("data") / "data.csv", data)
    again = read_measurements(path)
    for name in ("pressure", "contraction", "load", "direction", "specimen"):
        assert getattr(again, name).tolist() == getattr(data, name).tolist()


@pytest.mark.parametrize("mark", [",", ";", "\t"])
@pytest.mark.parametrize(
    "titles",
    [
        ("pressure [kPa]", "length [mm]", "load [N]", "direction"),
        ("Pressure (psi)", "Length (cm)", "force_gf", "branch"),
        ("pressure_bar", "length_m", "LOAD[mN]", "Direction"),
    ],
)
def test_units_stand_in_the_header(tmp_path, titles, mark):
    scale = {"kPa": 1e-3, "psi": 0.006894757293168, "bar": 0.1}
    unit = next(unit for unit in scale if unit in titles[0])
    long = {"[mm]": 1.0, "(cm)": 10.0, "_m": 1000.0}
    length = next(factor for text, factor in long.items() if titles[1].endswith(text))
    force = {"load [N]": 1.0, "force_gf": 0.00980665, "LOAD[mN]": 1e-3}[titles[2]]
    text = mark.join(titles) + f"\n# a remark\n\n2{mark}{40 / length!r}{mark}3{mark}Up\n"
    data = read_measurements(write(tmp_path, text), muscle=MUSCLE)
    assert data.pressure[0] == pytest.approx(2.0 * scale[unit], rel=1e-12)
    assert data.contraction[0] == pytest.approx(5.0, rel=1e-12)
    assert data.load[0] == pytest.approx(3.0 * force, rel=1e-12)
    assert data.direction.tolist() == ["inflating"]


def test_units_may_be_given_instead(tmp_path):
    path = write(tmp_path, "pressure,contraction_mm,note\n100,1,a\n")
    data = read_measurements(path, units={"pressure": "kPa"})
    assert data.pressure.tolist() == [0.1]
    assert data.load.tolist() == [0.0]
    assert data.ignored == ("note",)
    agreed = write(tmp_path, "pressure_kPa,contraction_mm\n100,1\n")
    assert read_measurements(agreed, units={"pressure": "kPa"}).pressure.tolist() == [0.1]


GOOD = "pressure [kPa],length [mm],load [N],direction\n100,44,0,up\n"
BAD = {
    "missing column": ("pressure [kPa],load [N]\n1,2\n", "no column contraction or length"),
    "missing pressure": ("length [mm],load [N]\n1,2\n", "no column pressure"),
    "one free length twice": (
        "pressure [kPa],length [mm],length at 620 kPa [mm],length at 0.62 MPa [mm]\n1,2,3,4\n",
        "are both length at 620 kPa",
    ),
    "mixed units": (GOOD + "100 psi,43,0,up\n", "row 3: pressure is '100 psi'"),
    "two units": ("pressure_kPa,pressure_psi,length_mm\n1,2,3\n", "are both pressure"),
    "no unit": ("pressure,length [mm]\n1,2\n", "'pressure' has no unit"),
    "wrong unit": ("pressure [mm],length [mm]\n1,2\n", "wrong kind of unit"),
    "unknown unit": ("pressure [foo],length [mm]\n1,2\n", "unknown unit 'foo'"),
    "only negative loads": (GOOD + "\n5,43,-1,up\n", "no load is positive in 'load [N]'"),
    "other digits": (GOOD + "５,43,0,up\n", "row 3: pressure is '５'"),
    "open quote": (GOOD + '5,43,0,"up\n5,43,0,up\n', "row 3 is not CSV"),
    "two lines in a cell": (
        'pressure_kPa,length_mm,specimen\n1,44,a\n1,44,"a\nb"\n1,44,c\n',
        "row 3: specimen is 'a\\nb': it must be text without control characters",
    ),
    "endless unit": ("pressure [kPa**9**9**9],length [mm]\n1,2\n", "power that is not one digit"),
    "negative pressure": (GOOD + "-2.1,43,0,up\n", "row 3: pressure is -2.1 kPa"),
    "pressure in Pa": (GOOD + "689000,43,0,up\n", "row 3: pressure is 689000 in 'pressure [kPa]'"),
    "longer than the strand": (GOOD + "5,56,0,up\n", "row 3: length is 56 mm, longer than the str"),
    "no length": (GOOD + "5,0,0,up\n", "row 3: length is 0 mm"),
    "text in a number": (GOOD + "\n5,long,0,up\n", "row 4: length is 'long'"),
    "decimal comma": (GOOD + '5,"43,5",0,up\n', "'43,5': it must be a finite number with a dec"),
    "comma and point": (GOOD.replace(",", ";") + "5,1;43.5;0;up\n", "with a decimal comma, as in"),
    "nan": (GOOD + "5,nan,0,up\n", "row 3: length is 'nan'"),
    "empty cell": (GOOD + "5,,0,up\n", "row 3: length is ''"),
    "cells missing": (GOOD + "5,43\n", "row 3: it has 2 cell(s): the header has 4"),
    "direction": (GOOD + "5,43,0,sideways\n", "row 3: direction is 'sideways'"),
    "no row": (GOOD.splitlines()[0], "a header and no rows"),
    "empty file": ("", "is empty"),
    "only remarks": ("# nothing\n\n", "is empty"),
    "slip of the pen": ("pressure [kPa],length [mm],laod [N]\n1,2,3\n", "'laod [N]' is not known"),
    "both": ("pressure_kPa,length_mm,contraction_mm\n1,44,1\n", "give one of them"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_table_is_one_clear_line(tmp_path, name):
    text, said = BAD[name]
    with pytest.raises((FileFormatError, UnitError, InputError)) as caught:
        read_measurements(write(tmp_path, text), muscle=MUSCLE)
    line = str(caught.value)
    assert said in line
    assert "data.csv" in line
    assert "\n" not in line


def test_files_that_are_no_tables(tmp_path):
    for name in ("nowhere.csv", "nowhere.parquet"):
        if name.endswith("parquet"):
            pytest.importorskip("pyarrow", reason="the extra 'tables' is not installed")
        with pytest.raises(FileFormatError, match=r"cannot read .*: No such file") as caught:
            read_measurements(tmp_path / name)
        assert str(caught.value).count("nowhere") == 1
        (tmp_path / f"folder_{name}").mkdir()
        with pytest.raises(FileFormatError, match=r"cannot read .*: Is a directory$"):
            read_measurements(tmp_path / f"folder_{name}")
    with pytest.raises(FileFormatError, match="xlsx"):
        read_measurements(write(tmp_path, GOOD, "data.xlsx"))
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00p")
    with pytest.raises(FileFormatError, match="UTF-8"):
        read_measurements(tmp_path / "binary.csv")
    with pytest.raises(InputError, match="needs the muscle"):
        read_measurements(write(tmp_path, GOOD))
    with pytest.raises(UnitError, match="'speed'"):
        read_measurements(write(tmp_path, GOOD), muscle=MUSCLE, units={"speed": "m/s"})
    with pytest.raises(UnitError, match="another unit"):
        read_measurements(write(tmp_path, GOOD), muscle=MUSCLE, units={"pressure": "psi"})


@given(st.text("pressure,length[]kPam;\t\n 0123.-_\"'#", max_size=120))
def test_whatever_the_file_it_is_a_table_or_a_typed_error(tmp_path_factory, text):
    path = write(tmp_path_factory.mktemp("data"), text)
    try:
        data = read_measurements(path, muscle=MUSCLE)
    except BozziniError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(data.contraction).all()


def test_a_strand_bounds_the_length(tmp_path):
    header = "pressure_MPa,length_mm\n"
    for length, good in ((STRAND - 1e-6, True), (STRAND + 1e-6, False)):
        path = write(tmp_path, f"{header}0,{length!r}\n")
        if good:
            assert read_measurements(path, muscle=MUSCLE).contraction[0] < 0.0
        else:
            with pytest.raises(InputError, match="longer than the strand"):
                read_measurements(path, muscle=MUSCLE)
    data = Measurements(pressure=[0.0], contraction=[45.0 - STRAND - 1e-6])
    with pytest.raises(InputError, match="row 1: length"):
        data.check_lengths(MUSCLE)


def test_parquet_without_pyarrow_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"bozzini\[tables\]"):
        read_measurements(tmp_path / "data.parquet")


def test_parquet_reads_as_csv_does(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="the extra 'tables' is not installed")
    from pyarrow import parquet

    table = {"pressure [kPa]": [0.0, 500.0], "length [mm]": [45.0, 40.0], "specimen": ["a", None]}
    parquet.write_table(pyarrow.table(table), tmp_path / "data.parquet")
    data = read_measurements(tmp_path / "data.parquet", muscle=MUSCLE)
    assert data.contraction.tolist() == [0.0, 5.0]
    assert data.pressure.tolist() == [0.0, 0.5]
    assert data.specimen.tolist() == ["a", ""]
    table["length [mm]"] = [45.0, 99.0]
    parquet.write_table(pyarrow.table(table), tmp_path / "data.parquet")
    with pytest.raises(InputError, match="row 2: length is 99"):
        read_measurements(tmp_path / "data.parquet", muscle=MUSCLE)
    write(tmp_path, "no", "bad.parquet")
    with pytest.raises(FileFormatError, match="not a Parquet file"):
        read_measurements(tmp_path / "bad.parquet")


def test_rows_are_selected_by_mask_or_index():
    data = Measurements(pressure=[0.1, 0.2, 0.3], contraction=[1.0, 2.0, 3.0], numbers=[2, 5, 9])
    assert data.select([2, 0]).pressure.tolist() == [0.3, 0.1]
    assert data.select(data.pressure > 0.15).numbers.tolist() == [5, 9]
    assert data.select(-1).contraction.tolist() == [3.0]
    for rows, said in (
        ([99], r"row index is 99: it must lie in \[-3, 2\]"),
        ("a", "must be a mask or whole numbers"),
        ([0.5], "must be a mask or whole numbers"),
        ([True, False], "the mask of rows has 2 entries: it must have 3"),
        ([], "0 rows"),
        ([False] * 3, "0 rows"),
    ):
        with pytest.raises(InputError, match=said):
            data.select(rows)


def test_rows_keep_the_name_of_their_line(tmp_path):
    data = read_measurements(write(tmp_path, f"# a remark\n{GOOD}\n200,43,0,up\n"), muscle=MUSCLE)
    assert data.numbers.tolist() == [3, 5]
    assert data.select([1]).name_row(0) == "data.csv: row 5"
    longer = MUSCLE.replace(length=100.0, end_length=0.0)
    moved = Measurements(
        pressure=data.pressure, contraction=[0.0, 101.0], numbers=data.numbers, source="data.csv"
    )
    with pytest.raises(InputError, match="^data.csv: row 5: length is -1 mm"):
        moved.check_lengths(longer)


def test_ends_of_lines_within_quotes_belong_to_the_cell(tmp_path):
    text = 'pressure_kPa,length_mm,"a\n# note"\n1,44,"x\n\n# y"\n# z\n2,43,\n'
    data = read_measurements(write(tmp_path, text), muscle=MUSCLE)
    assert data.pressure.tolist() == [0.001, 0.002]
    assert data.numbers.tolist() == [3, 7]
    assert data.ignored == ("a # note",)


def test_arrays_are_copies_and_read_only():
    pressure = np.array([0.1, 0.2])
    data = Measurements(pressure=pressure, contraction=[1.0, 2.0])
    pressure[0] = 5.0
    assert data.pressure[0] == 0.1
    with pytest.raises(ValueError, match="read-only"):
        data.pressure[0] = 1.0


@given(
    st.lists(st.floats(0.01, 1.0), min_size=2, max_size=8, unique=True),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 2.0),
    st.randoms(),
)
def test_mean_of_directions_of_a_shifted_line_is_the_line(pressures, slope, width, random):
    # two straight branches, apart by a constant, sampled at different pressures
    up = sorted(pressures)
    down = [up[0] - 0.005, *(0.5 * (a + b) for a, b in zip(up, up[1:], strict=False)), up[-1] + 1.0]
    rows = [(p, slope * p - width, 0.5, "inflating", "a") for p in up]
    rows += [(p, slope * p + width, 0.5, "deflating", "a") for p in down]
    random.shuffle(rows)
    mean = make_data(rows).mean_of_directions()
    assert mean.pressure.tolist() == up
    assert mean.contraction == pytest.approx(slope * np.array(up), abs=1e-9)
    assert set(mean.direction.tolist()) == {""}
    assert set(mean.load.tolist()) == {0.5}


def test_mean_of_directions_keeps_specimens_and_loads_apart():
    rows = [
        (p, x, load, direction, specimen)
        for p in (0.1, 0.2)
        for direction, shift in (("inflating", -1.0), ("deflating", 1.0))
        for load, specimen, x in ((0.0, "a", 5.0 + shift), (1.0, "a", 3.0), (0.0, "b", 4.0))
    ]
    rows.append((0.3, 9.0, 0.0, "", "c"))
    mean = make_data(rows).mean_of_directions()
    found = {
        (s, f): x
        for s, f, x in zip(
            mean.specimen.tolist(), mean.load.tolist(), mean.contraction.tolist(), strict=True
        )
    }
    assert found == {("a", 0.0): 5.0, ("a", 1.0): 3.0, ("b", 0.0): 4.0, ("c", 0.0): 9.0}
    assert len(mean) == 7


def test_mean_of_directions_keeps_free_lengths():
    data = Measurements(
        pressure=[0.1, 0.2, 0.2, 0.1],
        contraction=[1.0, 2.0, 2.0, 1.0],
        direction=["inflating"] * 2 + ["deflating"] * 2,
        free_lengths={0.62: 40.0},
    )
    kept = data.mean_of_directions().free_lengths
    assert list(kept) == [0.62] and np.all(kept[0.62] == 40.0)


def test_mean_of_directions_says_what_it_leaves_out():
    up = [(p, p, 0.0, "inflating", "a") for p in (0.1, 0.2, 0.3)]
    down = [(p, p, 0.0, "deflating", "a") for p in (0.25, 0.1)]
    mean = make_data([*up, *down]).mean_of_directions()
    assert mean.pressure.tolist() == [0.1, 0.2]
    (note,) = mean.notes
    assert "specimen 'a' at 0 N: inflation at 0.3 MPa left out" in note
    assert (
        make_data([*up, *down, (0.3, 1.0, 0.0, "deflating", "a")]).mean_of_directions().notes == ()
    )


def test_mean_of_directions_needs_both():
    with pytest.raises(InputError, match="no deflating row"):
        make_data([(0.1, 1.0, 0.0, "inflating", "a")]).mean_of_directions()
    apart = [(0.1, 1.0, 0.0, "inflating", "a"), (0.2, 1.0, 0.0, "deflating", "a")]
    with pytest.raises(InputError, match="share none"):
        make_data(apart).mean_of_directions()


def test_repeats_by_numpy_itself():
    random = np.random.default_rng(1)
    pressure = np.repeat([0.1, 0.2, 0.4], [5, 3, 1])
    contraction = random.normal(size=9)
    order = random.permutation(9)
    data = Measurements(pressure=pressure[order], contraction=contraction[order])
    found = data.repeat_statistics()
    assert found.count.tolist() == [5, 3, 1]
    assert found.pressure == pytest.approx([0.1, 0.2, 0.4])
    groups = np.split(contraction, [5, 8])
    assert found.mean == pytest.approx([group.mean() for group in groups])
    assert found.deviation[:2] == pytest.approx([group.std(ddof=1) for group in groups[:2]])
    assert found.deviation[2] == 0.0
    assert found.degrees_of_freedom == 6
    variance = (4 * groups[0].var(ddof=1) + 2 * groups[1].var(ddof=1)) / 6
    assert found.pooled_deviation == pytest.approx(math.sqrt(variance))


def test_repeats_are_of_one_load_and_direction():
    rows = [(0.1, 1.0, load, d, "") for load in (0.0, 1.0) for d in ("inflating", "deflating")]
    assert make_data(rows).repeat_statistics().count.tolist() == [1, 1, 1, 1]
    near = Measurements(pressure=[0.1, 0.1004, 0.2], contraction=[1.0, 1.0, 2.0])
    assert near.repeat_statistics().count.tolist() == [1, 1, 1]
    assert near.repeat_statistics(tolerance=0.001).count.tolist() == [2, 1]
    with pytest.raises(InputError, match="tolerance"):
        near.repeat_statistics(tolerance=-1.0)
