"""Titles and units as tables of testing machines have them: read as meant, or asked for."""

from __future__ import annotations

import math

import pandas
import pytest

from bozzini.cli.main import main
from bozzini.errors import BozziniError, FileFormatError, UnitError
from bozzini.muscle import MODELS, Muscle, calibrate, read_measurements, take_measurements
from bozzini.muscle.loops import read_loop

MUSCLE = Muscle(length=100.0, outer_radius=5.0, braid_angle=math.radians(25.0))
PRESSURES_KPA = (100, 200, 300, 400)
PERCENTS = (0, 4, 8, 12, 16, 20)


def pull(pressure_kpa: float, strain: float) -> float:
    """The ideal law (Chou and Hannaford): a cylinder of inextensible strands."""
    a, b = 3.0 / math.tan(MUSCLE.braid_angle) ** 2, 1.0 / math.sin(MUSCLE.braid_angle) ** 2
    return math.pi * 25.0 * 1e-3 * pressure_kpa * (a * (1.0 - strain) ** 2 - b)


def write(tmp_path, titles, *, units="", scale=1.0, gap="", force=1.0):
    """Write states of the ideal law; contractions are in so many mm."""
    lines = [titles, *([units] if units else [])]
    lines += [
        f"{p}{gap},{percent * scale:g},{force * pull(p, 0.01 * percent):.6g}"
        for p in PRESSURES_KPA
        for percent in PERCENTS
    ]
    path = tmp_path / "data.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


# Titles, the row below them, and how many there are of a contraction of 1 mm, or 1 % of the length.
READ = [
    ("pressure [kPa],contraction (in %),force [N]", "", 1.0),
    ("pressure [kPa],strain (in mm/mm),force [N]", "", 0.01),
    ("pressure [kPa],strain (in/in),force [N]", "", 0.01),
    ("Pressure (in kPa),Contraction (in %),Force (in N)", "", 1.0),
    ("pressure [kPa],contraction (in),force [N]", "", 1.0 / 25.4),
    ("pressure [kPa],contraction (in inches),force [N]", "", 1.0 / 25.4),
    ("Pressure,Contraction,Force", "(kPa),(mm),(N)", 1.0),
    ("Pressure,Contraction,Force", "kPa,in %,Newtons", 1.0),
    ("Pressure [kPa],Contraction,Force", ",[mm],[N]", 1.0),
    ("Pressure (kPa gauge),Contraction [mm],Force [N]", "", 1.0),
    ("Pressure [KPA],Contraction [MM],Force [newtons]", "", 1.0),
    ("P [kPa],Stroke [mm],Force [N]", "", 1.0),
    ("p_kPa,displacement_mm,force_N", "", 1.0),
]


@pytest.mark.parametrize(("titles", "units", "scale"), READ)
def test_a_title_means_its_unit(tmp_path, titles, units, scale) -> None:
    path = write(tmp_path, titles, units=units, scale=scale)
    data = read_measurements(path, muscle=MUSCLE)
    assert data.pressure == pytest.approx([1e-3 * p for p in PRESSURES_KPA for _ in PERCENTS])
    assert data.contraction == pytest.approx([x for _ in PRESSURES_KPA for x in PERCENTS], rel=1e-5)


def test_titles_of_the_user_s_own_are_mapped(tmp_path) -> None:
    path = write(tmp_path, "channel 3,LVDT (mm),cell")
    columns = {"channel 3": "pressure [kPa]", "lvdt": "contraction [mm]", "cell": "load [N]"}
    data = read_measurements(path, muscle=MUSCLE, columns=columns)
    plain = read_measurements(write(tmp_path, READ[-2][0]), muscle=MUSCLE)
    for name in ("pressure", "contraction", "load"):
        assert getattr(data, name).tolist() == getattr(plain, name).tolist()
    with pytest.raises(FileFormatError, match=r"data\.csv: there is no column 'cell 2'"):
        read_measurements(path, columns={"cell 2": "load [N]"})


def test_the_commands_map_titles(tmp_path, capsys) -> None:
    path = write(tmp_path, "channel 3,LVDT,cell")
    maps = ("pressure [kPa]=channel 3", "contraction [mm]=LVDT", "load [N]=cell")
    given = [word for text in maps for word in ("--column", text)]
    muscle = ["--length", "100mm", "--outer-radius", "5mm", "--braid-angle", "25deg"]
    fit = ["muscle", "fit", str(path), *muscle, "--model", "tondu-lopez", "--free", "kappa1,kappa2"]
    assert main([*fit, *given, "--out", str(tmp_path / "fit.yaml")]) in (0, 1)
    predict = ["muscle", "predict", str(tmp_path / "fit.yaml")]
    assert main([*predict, str(path), *given]) == 0
    assert main([*predict, "--pressure", "0.3", "--contraction", "5", *given]) == 2
    assert "--column has no effect without a table" in capsys.readouterr().err
    assert main([*fit, "--column", "cell"]) == 2


@pytest.mark.parametrize(("titles", "units", "scale"), READ[:4] + READ[6:7])
def test_a_fit_finds_the_law_of_the_data(tmp_path, titles, units, scale) -> None:
    data = read_measurements(write(tmp_path, titles, units=units, scale=scale), muscle=MUSCLE)
    found = calibrate(MODELS["tondu-lopez"], MUSCLE, data=data, free=("kappa1", "kappa2"))
    assert found.estimates["kappa2"] == pytest.approx(1.0, abs=1e-4)
    assert found.residual < 1e-3


@pytest.mark.parametrize(
    ("unit", "kpa"),
    [
        ("psig", 6.894757), ("PSI", 6.894757), ("Bar", 100.0), ("barg", 100.0),
        ("N/mm2", 1000.0), ("kg/cm2", 98.0665), ("bar (gauge)", 100.0), ("kpa", 1.0),
        ("cmH2O", 0.0980665), ("mbar", 0.1),
    ],
)  # fmt: skip
def test_units_of_pressure_in_use(unit, kpa) -> None:
    table = pandas.DataFrame({f"pressure [{unit}]": [1.0, 2.0], "contraction [mm]": [0.0, 1.0]})
    assert 1e3 * take_measurements(table).pressure[0] == pytest.approx(kpa, rel=1e-6)


@pytest.mark.parametrize(
    ("unit", "newtons"), [("lbs", 4.448222), ("kg", 9.80665), ("Newtons", 1.0), ("lbf", 4.448222)]
)
def test_units_of_load_in_use(unit, newtons) -> None:
    table = pandas.DataFrame(
        {"pressure [kPa]": [1, 2], "contraction [mm]": [0, 1], f"load [{unit}]": [1, 1]}
    )
    data = take_measurements(table)
    assert data.load[0] == pytest.approx(newtons, rel=1e-6)
    assert ("taken as weight" in "".join(data.notes)) == (unit in ("lbs", "kg"))


@pytest.mark.parametrize(
    ("titles", "words"),
    [
        ("pressure (at valve),contraction [mm],load [N]", "unknown unit 'at valve'.* 689 kPa"),
        ("pressure (at),contraction [mm],load [N]", "unknown unit 'at'"),
        ("pressure (a),contraction [mm],load [N]", "unknown unit 'a'"),
        ("pressure (in),contraction [mm],load [N]", "'in' has the wrong kind.* 689 kPa"),
        ("pressure [mPa],contraction [mm],load [N]", "'mPa' .*write MPa or kPa"),
        ("pressure [mpa],contraction [mm],load [N]", "unknown unit 'mpa'.*MPa"),
        ("pressure [psia],contraction [mm],load [N]", "absolute pressure: pressures are gauge"),
        ("pressure [kPa abs],contraction [mm],load [N]", "absolute pressure"),
        ("pressure [kPa],contraction (in mm at end),load [N]", "unknown unit 'mm at end'"),
        ("pressure [kPa],contraction [mm mm/mm],load [N]", "wrong kind of unit"),
        ("pressure [kPa],contraction [mm deg],load [N]", "wrong kind of unit"),
        ("pressure [kPa],contraction [mm],load (in mm)", "wrong kind of unit"),
    ],
)
def test_a_word_is_no_factor(tmp_path, titles, words) -> None:
    with pytest.raises(UnitError, match=words) as caught:
        read_measurements(write(tmp_path, titles), muscle=MUSCLE)
    assert "\n" not in str(caught.value)


def test_a_row_of_units_may_not_contradict_the_titles(tmp_path) -> None:
    path = write(tmp_path, "pressure [kPa],contraction [mm],load [N]", units="(bar),(mm),(N)")
    with pytest.raises(FileFormatError, match=r"row 2: 'bar' is another unit .*'pressure \[kPa\]'"):
        read_measurements(path)


def test_a_recorded_loop_may_have_a_row_of_units(tmp_path) -> None:
    rows = [f"{t},{100 + 10 * t},{0.1 * t}" for t in range(20)]
    path = tmp_path / "loop.csv"
    path.write_text("\n".join(["Time,Pressure,Contraction", "s,kPa,mm", *rows]) + "\n")
    assert read_loop(path).pressure[0] == pytest.approx(0.1)


@pytest.mark.parametrize("title", ["", " ", '""'])
def test_numbers_without_a_title_are_refused(tmp_path, title) -> None:
    path = write(tmp_path, f"pressure [kPa],contraction [mm],{title}")
    with pytest.raises(FileFormatError, match=r"^data\.csv: column 3 has no title and the number"):
        read_measurements(path)
    frame = pandas.read_csv(path)
    with pytest.raises(BozziniError, match="column 3 has no title and the number"):
        take_measurements(frame)


@pytest.mark.parametrize(
    ("title", "cell"),
    [
        ("", "7 N"),
        ("", '"1,234.5"'),
        ("[N]", "7"),
        ("(N)", "7"),
        ("nan", "7"),
        ("Unnamed: 3.1", "7"),
    ],
)
def test_neither_a_unit_in_the_cell_nor_one_alone_makes_a_title(tmp_path, title, cell) -> None:
    path = tmp_path / "data.csv"
    path.write_text(f"pressure [kPa],contraction [mm],{title}\n100,1,{cell}\n200,2,{cell}\n")
    with pytest.raises(FileFormatError, match="column 3 has no title and the number"):
        read_measurements(path)


def test_an_empty_column_without_a_title_is_none(tmp_path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("pressure [kPa],,contraction [mm],\n100,,1,\n200,,2,\n")
    data = read_measurements(path)
    assert data.contraction.tolist() == [1.0, 2.0]
    assert data.ignored == ()


def test_words_without_a_title_are_ignored_by_number(tmp_path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("pressure [kPa],contraction [mm],\n100,1,first\n200,2,\n")
    assert read_measurements(path).ignored == ("column 3 without a title",)
