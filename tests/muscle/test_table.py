"""Tables as testing machines write them: units, zeros, signs, commas, geometry, errors."""

from __future__ import annotations

import math

import numpy as np
import pandas
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.checks import list_quantities
from bozzini.errors import FileFormatError, InputError, UnitError
from bozzini.muscle import (
    Measurements,
    Muscle,
    read_measurements,
    take_measurements,
    write_measurements,
)

GRAVITY = 9.80665
REST = 83.0
MUSCLE = Muscle(length=REST, outer_radius=5.0)
HEAD = "pressure [kPa],contraction [mm],"


def read(folder, text, **options):
    path = folder / "data.csv"
    path.write_text(text, encoding="utf-8")
    return read_measurements(path, **options)


def table(**columns):
    """Read a table of pandas; titles are in the names of the arguments."""
    return take_measurements(pandas.DataFrame(columns))


def assert_equal(one, other):
    for name in ("pressure", "contraction", "load"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-14)
    for name in ("direction", "specimen", "numbers"):
        assert getattr(one, name).tolist() == getattr(other, name).tolist()
    for name in ("geometry", "errors"):
        kept, again = getattr(one, name), getattr(other, name)
        assert set(kept) == set(again)
        assert all(kept[key] == pytest.approx(again[key], rel=1e-14) for key in kept)


@pytest.mark.parametrize(
    ("title", "newton"),
    [
        ("mass [kg]", GRAVITY),
        ("load [kg]", GRAVITY),
        ("Force (g)", 1e-3 * GRAVITY),
        ("weight_lb", 0.45359237 * GRAVITY),
        ("tension [N]", 1.0),
        ("weight [kgf]", GRAVITY),
    ],
)
def test_a_load_in_a_unit_of_mass_is_its_weight(tmp_path, title, newton):
    data = read(tmp_path, f"{HEAD}{title}\n100,1,2\n")
    assert data.load[0] == pytest.approx(2.0 * newton, rel=1e-12)
    said = [note for note in data.notes if "taken as weight" in note]
    assert bool(said) == (title.rpartition("[")[2].strip("]") not in ("N", "kgf"))


@pytest.mark.parametrize(
    ("title", "value"),
    [
        ("contraction [mm]", 8.3),
        ("contraction [%]", 10.0),
        ("contraction_%", 10.0),
        ("contraction ratio", 0.1),
        ("strain", 0.1),
        ("strain [%]", 10.0),
        ("displacement [cm]", 0.83),
        ("length [mm]", 74.7),
    ],
)
def test_contractions_are_of_the_rest_length_of_muscle_or_row(tmp_path, title, value):
    of_muscle = read(tmp_path, f"pressure_MPa,{title}\n0.1,{value}\n", muscle=MUSCLE)
    own = f"pressure_MPa,{title},rest length [cm]\n0.1,{value},8.3\n"
    of_row = read(tmp_path, own)
    other = read(tmp_path, own, muscle=MUSCLE.replace(length=500.0))
    for data in (of_muscle, of_row, other):
        assert data.contraction[0] == pytest.approx(8.3, rel=1e-12)
    assert of_row.muscle_of("", MUSCLE.replace(length=1.0)) == MUSCLE
    taken = title.startswith(("strain", "displacement"))
    assert any("positive where the muscle is shorter" in note for note in of_row.notes) == taken
    if title not in ("contraction [mm]", "displacement [cm]"):
        with pytest.raises(InputError, match="needs the muscle: its free length, or a column"):
            read(tmp_path, f"pressure_MPa,{title}\n0.1,{value}\n")


def test_small_negative_pressures_are_the_zero_of_a_sensor(tmp_path):
    rows = "".join(f"{p},1,5\n" for p in (-12.0, 600.0, -3.5, 0.0))
    data = read(tmp_path, f"{HEAD}load [N]\n{rows}")
    assert data.pressure.tolist() == [0.0, 0.6, 0.0, 0.0]
    (note,) = data.notes
    assert "2 row(s) have a negative pressure, down to -12 kPa: taken as 0" in note
    with pytest.raises(InputError, match=r"row 2: pressure is -12\.1 kPa .* -2 % of the largest"):
        read(tmp_path, f"{HEAD}load [N]\n{rows.replace('-12.0', '-12.1')}")


def test_negative_loads_are_kept_and_counted(tmp_path):
    data = read(tmp_path, f"{HEAD}load [N]\n100,1,-4\n100,0,9\n200,0,-0.5\n")
    assert data.load.tolist() == [-4.0, 9.0, -0.5]
    assert "2 row(s) have a negative load, down to -4 N" in data.notes[0]
    with pytest.raises(InputError, match=r"no load is positive in 'load \[N\]', and one is -4 N"):
        read(tmp_path, f"{HEAD}load [N]\n100,1,-4\n100,0,0\n")


@given(
    st.lists(
        st.tuples(st.floats(0.0, 900.0), st.floats(-5.0, 20.0), st.floats(0.0, 400.0)),
        min_size=1,
        max_size=6,
    ),
    st.sampled_from([";", "\t"]),
)
def test_a_decimal_comma_is_a_point(tmp_path_factory, rows, mark):
    folder = tmp_path_factory.mktemp("comma")
    titles = mark.join(["pressure [kPa]", "contraction [mm]", "load [N]"])
    lines = [mark.join(map(repr, row)) for row in rows]
    point = read(folder, "\n".join([titles, *lines]))
    comma = read(folder, "\n".join([titles, *(line.replace(".", ",") for line in lines)]))
    assert_equal(point, comma)
    told = any("decimal comma" in note for note in comma.notes)
    assert told == any("." in line for line in lines)


def test_a_comma_beside_a_point_is_refused(tmp_path):
    text = "pressure [kPa];contraction [mm]\n100,5;1\n200.5;2\n"
    with pytest.raises(FileFormatError, match="row 3: pressure is '200.5'.* a decimal comma"):
        read(tmp_path, text)


SPECIMENS = {
    "pressure [kPa]": [0.0, 100.0, 300.0, 100.0],
    "contraction [%]": [0.0, 5.0, 9.0, 4.0],
    "mass [kg]": [1.0, 2.0, 3.0, 2.0],
    "direction": ["up", "up", "down", ""],
    "specimen": ["short", "short", "long", "long"],
    "rest length [mm]": [83.0, 83.0, 132.0, 132.0],
    "outer diameter [mm]": [10.0, 10.0, 12.0, 12.0],
    "braid angle [deg]": [23.0, 23.0, 24.0, 24.0],
    "strands": [96, 96, 100, 100],
    "load error [N]": [0.5, 0.6, 0.7, 0.8],
    "pressure error [kPa]": [1.0] * 4,
    "contraction error [%]": [0.1] * 4,
}


def test_frame_file_and_arrays_are_one_table(tmp_path):
    frame = pandas.DataFrame(SPECIMENS)
    frame.to_csv(tmp_path / "table.csv", index=False)
    data, filed = take_measurements(frame), read_measurements(tmp_path / "table.csv")
    assert data.numbers.tolist() == [1, 2, 3, 4] and filed.numbers.tolist() == [2, 3, 4, 5]
    assert_equal(data, Measurements(**{**vars(filed), "numbers": data.numbers}))
    again = read_measurements(write_measurements(tmp_path / "again.csv", data))
    assert_equal(data, Measurements(**{**vars(again), "numbers": data.numbers}))
    assert_equal(data, take_measurements(data.to_frame()))
    assert data.contraction == pytest.approx([0.0, 4.15, 11.88, 5.28])
    assert data.errors["contraction"] == pytest.approx([0.083, 0.083, 0.132, 0.132])
    assert data.load == pytest.approx(GRAVITY * frame["mass [kg]"].to_numpy())


def test_every_field_of_a_muscle_is_a_column(tmp_path):
    full = MUSCLE.fill()
    for name, known in list_quantities(Muscle).items():
        title = "rest length" if name == "length" else name.replace("_", " ")
        value, unit = getattr(full, name), f" [{known.unit}]" if known.unit else ""
        data = read(tmp_path, f"{HEAD}{title}{unit}\n100,1,{value}\n")
        assert data.geometry[name].tolist() == [value]
        assert data.muscle_of("", full) == full


def test_a_specimen_has_its_own_muscle():
    data = take_measurements(pandas.DataFrame(SPECIMENS))
    assert data.list_specimens() == ("short", "long")
    for specimen, length, radius, angle in (("short", 83.0, 5.0, 23), ("long", 132.0, 6.0, 24)):
        muscle = data.muscle_of(specimen, MUSCLE.fill())
        assert (muscle.length, muscle.outer_radius) == (length, radius)
        assert muscle.braid_angle == pytest.approx(math.radians(angle))
        part = data.select(data.specimen == specimen)
        assert part.list_specimens() == (specimen,)
        assert part.muscle_of(specimen, MUSCLE.fill()) == muscle
    with pytest.raises(InputError, match="specimen is 'middle': it must be one of short, long"):
        data.muscle_of("middle", MUSCLE)
    thick = MUSCLE.replace(inner_radius=4.9, gap=2.4)
    short = Measurements(
        pressure=[0.1], contraction=[1.0], specimen="s", geometry={"inner_radius": 4.0}
    )
    with pytest.raises(InputError, match="specimen 's': muscle gap is 2.4 mm"):
        short.muscle_of("s", thick)


def test_lengths_are_checked_against_the_specimens_own_strand():
    frame = pandas.DataFrame(SPECIMENS)
    data = take_measurements(frame, muscle=MUSCLE)
    frame.loc[3, "contraction [%]"] = -9.6
    with pytest.raises(InputError, match="row 4: length is 144.672 mm, longer than the strand"):
        take_measurements(frame, muscle=MUSCLE)
    data.check_lengths(MUSCLE)  # without columns the angle is unset: nothing to check against
    bare = Measurements(pressure=[0.1], contraction=[-500.0])
    bare.check_lengths(MUSCLE)
    with pytest.raises(InputError, match="row 1: length is -1 mm"):
        Measurements(pressure=[0.1], contraction=[84.0]).check_lengths(MUSCLE)


def test_the_mean_of_directions_keeps_geometry_and_errors():
    both = Measurements(
        pressure=[0.1, 0.2, 0.2, 0.1],
        contraction=[1.0, 2.0, 3.0, 2.0],
        direction=["inflating"] * 2 + ["deflating"] * 2,
        specimen="a",
        geometry={"length": REST},
        errors={"contraction": [0.3, 0.3, 0.4, 0.4]},
    )
    mean = both.mean_of_directions()
    assert mean.contraction.tolist() == [1.5, 2.5]
    assert mean.geometry["length"].tolist() == [REST] * 2
    assert mean.errors["contraction"] == pytest.approx([0.25, 0.25])  # half the root of the sum


PRESSURES = np.linspace(0.1, 0.6, 12)
LEVELS = [0.0, 5.0, 10.0, 15.0]


def test_what_was_held_decides_what_answers():
    """Values that a rig holds wobble by less than a hundredth."""
    wobble = 1.0 + 0.002 * np.sin(np.arange(48.0))
    held = np.repeat(LEVELS, 12) * wobble
    pressure = np.tile(PRESSURES, 4)
    answer = 100.0 * pressure**1.5 * (1.0 + 0.01 * held)
    isometric = Measurements(pressure=pressure, contraction=held, load=answer)
    isotonic = Measurements(pressure=pressure, contraction=0.2 * answer, load=held)
    ramp = np.linspace(0.0, 15.0, 48)
    steps = np.repeat([0.2, 0.4, 0.6], 16)
    isobaric = Measurements(pressure=steps, contraction=ramp, load=200.0 * steps - 5.0 * ramp)
    free = Measurements(pressure=PRESSURES, contraction=20.0 * PRESSURES)
    blocked = Measurements(pressure=PRESSURES, contraction=np.zeros(12), load=300.0 * PRESSURES)
    assert isometric.response == isobaric.response == blocked.response == "force"
    assert isotonic.response == free.response == "contraction"
    parts = Measurements(  # levels differ between specimens, which each hold few
        pressure=np.tile(pressure, 8),
        contraction=np.concatenate([held * (1.0 + 0.1 * k) for k in range(8)]),
        load=np.concatenate([answer * (1.0 + 0.01 * k) for k in range(8)]),
        specimen=np.repeat(list("abcdefgh"), 48),
    )
    assert parts.response == "force"


@pytest.mark.parametrize(
    ("title", "said"),
    [
        ("loads [N]", "is it load"),
        ("blocked force [N]", "looks like a load and is not understood"),
        ("z1 [N]", "looks like a load and is not understood"),
        ("hanging mass", "looks like a load and is not understood"),
        ("mass [N]", "has the unit 'N': write 'mass \\[kg\\]', or 'load \\[N\\]' for a force"),
        ("mass", "has no unit: write 'mass \\[kg\\]'"),
        ("load", "has no unit: write 'load \\[N\\]'"),
        ("load [mm]", "wrong kind of unit"),
        ("load error", "has no unit"),
        ("rest length", "has no unit"),
        ("braid angle [mm]", "wrong kind of unit"),
        ("contraction error [N]", "wrong kind of unit"),
        ("rest lenght [mm]", "is it rest length"),
        ("outer diamter [mm]", "is it outer diameter"),
    ],
)
def test_a_column_that_matters_is_never_dropped(tmp_path, title, said):
    with pytest.raises((FileFormatError, UnitError), match=said):
        read(tmp_path, f"{HEAD}{title}\n100,1,2\n")


def test_scatter_within_a_reading_is_no_error_of_it(tmp_path):
    data = read(tmp_path, f"# a remark, first\n{HEAD}load [N],load noise [N],test\n100,1,2,0.4,8\n")
    assert data.ignored == ("load noise [N]", "test")
    assert data.errors == {}
    assert "scatter within a reading is not its error" in data.notes[0]


def test_values_that_cannot_be_are_refused(tmp_path):
    for title, value, said in (
        ("load error [N]", 0, r"load error is 0 N: it must lie in \(0, inf\) N"),
        ("rest length [mm]", "nan", "row 2: rest length is 'nan'"),
    ):
        with pytest.raises(InputError, match=said):
            read(tmp_path, f"{HEAD}{title}\n100,1,{value}\n")
    with pytest.raises(InputError, match=r"row 3: rest length is 84 mm: it must be 83 mm, as in .*"
                                         r"row 2 .* name the specimens"):  # fmt: skip
        read(tmp_path, f"{HEAD}rest length [mm]\n100,1,83\n200,1,84\n")


def test_a_pressure_in_the_wrong_unit_is_asked_about(tmp_path):
    with pytest.raises(InputError, match=r"row 1: pressure is 300 MPa: .* is it in kPa\?"):
        Measurements(pressure=[300.0], contraction=[1.0])
    with pytest.raises(InputError, match=r"row 2: pressure is 300 in 'pressure_MPa'.* in kPa\?"):
        read(tmp_path, "pressure_MPa,contraction_mm\n300,1\n")
