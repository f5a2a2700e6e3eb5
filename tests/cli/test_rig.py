"""``bozzini rig``: what it prints is what the library has; a bad input is one line."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.rig import Orifice, identify_fill, read_curve

ORIFICE = Orifice(area=0.5, critical_ratio=0.4)


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    head = {"delimiter": ",", "comments": ""}
    level = np.linspace(0.01, 0.615, 300)
    for name, volume in (("slow", 2e4), ("quick", 1e4)):
        clock = ORIFICE.fill_time(volume, 0.62, end=level, start=0.01)
        time = np.linspace(0.0, clock[-1], 120)
        rows = np.column_stack([time, 1e3 * np.interp(time, clock, level)])
        np.savetxt(
            f"{name}.csv", rows, delimiter=",", header="time [s],pressure [kPa]", comments=""
        )
    np.savetxt("leak.csv", rows[::-1] * [-1, 1], header="time,pressure", **head)

    def call(*arguments):
        capsys.readouterr()
        code = main(["rig", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


def test_json_is_what_the_library_has(run) -> None:
    code, out, err = run("identify", "slow.csv", "--check", "quick.csv", "--json")
    assert (code, err) == (0, "")
    answer = json.loads(out)
    found = identify_fill([read_curve("slow.csv")]).check([read_curve("quick.csv")])
    assert (answer["kind"], answer["converged"]) == ("fill", True)
    assert answer["residual_MPa"] == pytest.approx(found.residual)
    for entry, fit in zip(
        (answer["fits"][0], answer["checks"][0]), (found.fits[0], found.checks[0]), strict=True
    ):
        assert entry["law"] == fit.law == "orifice"
        assert entry["time_constant_s"] == pytest.approx(fit.constants["time constant"])
    assert answer["fits"][0]["time_constant_s"] == pytest.approx(
        ORIFICE.time_constant(2e4), rel=0.02
    )


def test_table_picture_and_text(run, tmp_path) -> None:
    code, out, err = run("identify", "slow.csv", "quick.csv", "--out", "a.csv")
    assert (code, err) == (0, "")
    assert "slow.csv" in out
    rows = list(csv.DictReader((tmp_path / "a.csv").open()))
    assert [row["curve"] for row in rows] == ["slow.csv", "quick.csv"]
    ratio = float(rows[0]["time_constant_s"]) / float(rows[1]["time_constant_s"])
    assert ratio == pytest.approx(2.0, rel=0.02)
    assert run("identify", "slow.csv", "--out", "a.png")[0] == 0
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


def test_curve_without_a_law_is_a_negative_answer(run, tmp_path) -> None:
    time = np.linspace(0.0, 3.0, 200)
    stairs = np.select([time < 1.0, time < 2.0], [100.0, 300.0], 600.0) + time
    rows = np.column_stack([time, stairs])
    np.savetxt("stairs.csv", rows, delimiter=",", header="time,pressure", comments="")
    code, out, err = run("identify", "stairs.csv")
    assert (code, err) == (1, "")
    assert "warning: stairs.csv: no law fits" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.csv",), "there is no such file"),
        (("slow.csv", "leak.csv"), "leak.csv is a leak, slow.csv a fill"),
        (("slow.csv", "--share", "0.5"), "--share has no effect without --check"),
        (("slow.csv", "--check", "quick.csv", "--share", "2"), "share is 2"),
        (("slow.csv", "--unit", "mm"), "wrong kind"),
        (("slow.csv", "--supply", "1mm"), "wrong kind"),
        (("slow.csv", "--out", "a.txt"), "must end in"),
        ((), "Missing argument"),
    ],
)
def test_bad_input_is_one_line(run, tmp_path, arguments, words) -> None:
    if "--unit" in arguments:
        (tmp_path / "slow.csv").write_text("time,pressure\n" + "1,2\n" * 20)
    code, out, err = run("identify", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("bozzini: error: ") and err.count("\n") == 1
    assert words in err
