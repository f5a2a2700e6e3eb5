"""Tables of loops of any quantity: titles, runs, formats; the commands; files that predict."""

from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from bozzini.cli.main import main
from bozzini.errors import FileFormatError, InputError, UnitError
from bozzini.hysteresis import (
    LoopRuns,
    LoopTitles,
    compare_laws,
    predict_loops,
    read_law,
    read_loops,
    write_law,
)
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from bozzini.results import Json
from tests.hysteresis.plants import make_record

RECORD = make_record("plays", count=300, windows=2)
NAMED = LoopTitles(input="wheel", output="probe")


def write_table(path: Path, runs: LoopRuns, titles: str = "time [s],wheel [deg],probe [counts],run",
                *, rows: slice = slice(None)) -> Path:  # fmt: skip
    labels = runs.list_labels()
    lines = [
        f"{runs.time[k]:.6g},{runs.input[k]:.9g},{runs.output[k]:.9g},{labels[k]}"
        for k in range(len(runs))[rows]
    ]
    text = "\n".join([titles, *lines]) + "\n"
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


def test_a_table_is_read_by_titles(tmp_path: Path) -> None:
    runs = read_loops(write_table(tmp_path / "a.csv.gz", RECORD.runs), LoopTitles())
    assert (runs.input_title, runs.unit, runs.input_unit) == ("wheel [deg]", "counts", "deg")
    assert runs.labels == ("a", "b") and runs.first == RECORD.runs.first
    assert runs.input == pytest.approx(RECORD.runs.input)
    assert runs.output == pytest.approx(RECORD.runs.output)
    titles = "stamp,c1,c2,window"
    other = write_table(tmp_path / "b.csv", RECORD.runs, titles)
    columns = {"stamp": "time [ms]", "c2": "probe"}
    named = read_loops(other, LoopTitles(input="C1", output="probe"), columns=columns)
    assert named.time_title == "time [ms]" and named.unit == ""
    assert named.output == pytest.approx(RECORD.runs.output)


def test_a_file_of_matlab_without_a_time_will_do(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"u": RECORD.runs.input, "y": RECORD.runs.output})
    runs = read_loops(tmp_path / "a.mat", LoopTitles())
    assert runs.time.tolist() == list(range(300)) and runs.time_title == ""
    assert runs.output.tolist() == RECORD.runs.output.tolist()


def test_a_time_that_goes_back_begins_a_run_and_empty_cells_are_left_out(tmp_path: Path) -> None:
    text = "".join(f"{k % 20},{k},{'' if k == 3 else k**2}\n" for k in range(40))
    (tmp_path / "a.csv").write_text("t,x,y\n" + text)
    runs = read_loops(tmp_path / "a.csv", LoopTitles())
    assert runs.labels == ("1", "2") and runs.first == (0, 20) and len(runs) == 40
    assert runs.input[3] == 3.0 and np.isnan(runs.output).nonzero()[0].tolist() == [3]
    assert runs.notes == ("1 row without an output: only the input is taken there",)


def test_a_row_without_an_input_ends_a_run_and_one_without_a_time_does_not(tmp_path: Path) -> None:
    text = "".join(
        f"{'' if k == 9 else k},{'' if k in (20, 21) else k},{k**2}\n" for k in range(40)
    )
    (tmp_path / "a.csv").write_text("t,x,y\n" + text)
    runs = read_loops(tmp_path / "a.csv", LoopTitles())
    assert runs.first == (0, 20) and len(runs) == 38 and runs.time[9] == 8.0
    assert runs.notes == (
        "2 rows without an input left out: a run begins after each gap",
        "1 row without a time: that of the row before is taken",
    )


@pytest.mark.parametrize("samples", [2000, 500])
def test_inputs_without_an_output_move_the_law(tmp_path: Path, samples: int) -> None:
    """Where outputs were missing at the turns, an exact backlash was off by 5 % of the span."""
    k = np.arange(1500)
    input_ = 8.0 * np.sin(k / 12.0) * np.where((k // 75) % 2, 1.0, 0.6)
    output = PrandtlIshlinskii((1.7,), (1.0,)).apply([9.0, -9.0, *input_])[2:]
    seen = [f"{y:.9g}" if abs(u) < 4.0 else "" for u, y in zip(input_, output, strict=True)]
    rows = [f"{u:.9g},{y}" for u, y in zip(input_, seen, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["x [mm],y [mm]", *rows]))
    runs = read_loops(tmp_path / "a.csv", LoopTitles())
    found = compare_laws(runs, hold_out=0.3, law="backlash-cubic", samples=samples)
    assert found.row.held_out < (1e-3 if samples > 1500 else 0.02) * found.span
    assert found.fit.law.thresholds[0] == pytest.approx(1.7, rel=0.02)
    assert found.row.share == pytest.approx(100.0 * found.row.held_out / found.span)
    counts = found.parts.fitted + found.parts.held_out + found.parts.lead
    assert (counts == np.isfinite(runs.output)).all()


def test_short_runs_are_seen_and_jitter_is_none(tmp_path: Path) -> None:
    rows = [(run, k) for run in range(6) for k in range(7)]
    text = "".join(f"{0.1 * k + 1e-3 * run},{k + run},{k}\n" for run, k in rows)
    (tmp_path / "a.csv").write_text("t,x,y\n" + text)
    assert read_loops(tmp_path / "a.csv", LoopTitles()).first == tuple(range(0, 42, 7))
    times = 0.1 * np.arange(40)
    times[[0, 1, 7, 8, 20, 21]] = times[[1, 0, 8, 7, 21, 20]]
    text = "".join(f"{time},{k},{k}\n" for k, time in enumerate(times))
    (tmp_path / "b.csv").write_text("t,x,y\n" + text)
    assert read_loops(tmp_path / "b.csv", LoopTitles()).first == (0,)


def test_a_time_that_falls_is_refused(tmp_path: Path) -> None:
    text = "".join(f"{0.1 * k},{k},{k}\n" for k in reversed(range(40)))
    (tmp_path / "a.csv").write_text("t,x,y\n" + text)
    with pytest.raises(FileFormatError, match="first 3.9 and last 0: sort the rows by time"):
        read_loops(tmp_path / "a.csv", LoopTitles())


@pytest.mark.parametrize(
    ("titles", "said"),
    [
        (LoopTitles(input="wheel", output="force"), "there is no column 'force'"),
        (LoopTitles(input="wheel", output="wheel"), "is both input and output"),
        (LoopTitles(input="wheel", output="probe", run="lap"), "there is no column 'lap'"),
    ],
)
def test_what_is_not_there_is_named(tmp_path: Path, titles: LoopTitles, said: str) -> None:
    path = write_table(tmp_path / "a.csv", RECORD.runs)
    with pytest.raises(FileFormatError, match=rf"a\.csv: .*{said}"):
        read_loops(path, titles)
    with pytest.raises(FileFormatError, match="must be named: the table has the columns 'a', 'b'"):
        (tmp_path / "b.csv").write_text("a,b,c\n1,2,3\n")
        read_loops(tmp_path / "b.csv", LoopTitles())
    with pytest.raises(FileFormatError, match="beside time and run the table has 'x'"):
        (tmp_path / "d.csv").write_text("t,x\n1,2\n")
        read_loops(tmp_path / "d.csv", LoopTitles())
    with pytest.raises(FileFormatError, match="5 rows have all numbers: 20 are needed"):
        read_loops(write_table(tmp_path / "c.csv", RECORD.runs, rows=slice(5)), NAMED)


@pytest.mark.parametrize(
    ("titles", "pair"),
    [
        (LoopTitles(input="probe"), ("probe [counts]", "wheel [deg]")),
        (LoopTitles(output="wheel"), ("probe [counts]", "wheel [deg]")),
        (LoopTitles(output="probe"), ("wheel [deg]", "probe [counts]")),
    ],
)
def test_of_two_columns_the_one_that_is_not_named_is_meant(
    tmp_path: Path, titles: LoopTitles, pair: tuple[str, str]
) -> None:
    runs = read_loops(write_table(tmp_path / "a.csv", RECORD.runs), titles)
    assert (runs.input_title, runs.output_title) == pair


def test_an_output_that_is_named_must_be_there_to_predict_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_law(compare_laws(RECORD.runs, law="line"), tmp_path / "law.yaml")
    table = write_table(tmp_path / "a.csv", RECORD.runs)
    twice = tmp_path / "b.csv"
    twice.write_text("wheel [deg],probe [counts],probe [mm]\n1,2,3\n2,3,4\n")
    for path, title, said in (
        (table, "prbe", "there is no column 'prbe'"),
        (twice, "probe", "2 columns are called 'probe'"),
    ):
        task = ["hysteresis", "predict", str(tmp_path / "law.yaml"), str(path), "--output", title]
        assert main(task) == 2
        assert said in capsys.readouterr().err
    like = LoopTitles(input="wheel", output="probe")
    with pytest.raises(FileFormatError, match="2 columns are called 'probe'"):
        read_loops(twice, LoopTitles(), like=like)
    twice.write_text("wheel [deg]\n1\n2\n")
    assert read_loops(twice, LoopTitles(), like=like).output_title == ""


def run(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> Json:
    """Run a command and return its JSON."""
    assert main(["hysteresis", *map(str, arguments), "--json"]) == code
    found: Json = json.loads(capsys.readouterr().out)
    return found


def test_the_commands_fit_and_predict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = write_table(tmp_path / "a.csv", RECORD.runs)
    law, picture = tmp_path / "law.yaml", tmp_path / "a.png"
    found = run(capsys, "fit", table, "--hold-out", "0.2", "--out", law)
    assert found["rows"] == 300 and found["fitted"] + found["held_out"] + found["lead"] == 300
    assert [row["law"] for row in found["laws"]][:3] == ["line", "cubic", "backlash-cubic"]
    assert found["best"] == found["law"] == read_law(law).law
    assert set(found["runs"]) == {"a", "b"}
    again = run(capsys, "predict", law, table)
    assert again["judged"] > 200 and again["error"] < 1.2 * RECORD.noise
    assert again["coverage"] > 0.9
    columns = again["columns"]
    assert list(columns)[2:5] == ["wheel [deg]", "probe [counts]", "predicted probe [counts]"]
    high, low = (np.array(columns[f"{end} probe [counts]"]) for end in ("highest", "lowest"))
    assert high - low == pytest.approx(2.0 * found["band_95"])
    assert main(["hysteresis", "fit", str(table), "--law", "bouc-wen", "--out", str(picture)]) == 0
    said = capsys.readouterr().out
    assert picture.stat().st_size > 5000
    for text in ("chosen: bouc-wen", "backlash-cubic", "300 rows in 2 run(s), 300 fitted"):
        assert text in said


def test_a_law_goes_on_where_the_fit_ended(tmp_path: Path) -> None:
    for law in ("bouc-wen", "generalised"):
        runs = make_record("bouc-wen", count=400).runs
        first, second = (
            replace(runs, input=runs.input[rows], output=runs.output[rows], time=runs.time[rows])
            for rows in (slice(300), slice(300, None))
        )
        found = compare_laws(first, law=law)
        write_law(found, tmp_path / f"{law}.json")
        file = read_law(tmp_path / f"{law}.json")
        whole = found.fit.law.trace(runs.input, found.fit.starts[0])
        unseen = replace(second, output=np.full(100, np.nan), output_title="")
        gone_on = predict_loops(file, unseen, resume=True)
        assert gone_on.predicted == pytest.approx(whole[300:])
        blind = predict_loops(file, unseen)
        assert any("the start of 1 run(s) is not known" in note for note in blind.notes)
        assert not blind.judged.any() and blind.residual == 0.0
        seen = predict_loops(file, second)
        assert seen.error < 1.5 * found.row.fitted and not np.isnan(seen.coverage)
        wide = predict_loops(file, replace(unseen, input=10.0 * second.input))
        assert any("beyond the inputs fitted" in note for note in wide.notes)


def test_a_drift_goes_on_as_it_was_at_the_end(tmp_path: Path) -> None:
    runs = make_record("plays", count=400, drift=0.5).runs
    found = compare_laws(runs, drift="linear")
    write_law(found, tmp_path / "a.yaml")
    last = replace(
        runs, input=runs.input[-60:], output=runs.output[-60:], time=runs.time[-60:], first=(0,)
    )
    predicted = predict_loops(read_law(tmp_path / "a.yaml"), last)
    assert predicted.error < 0.1 * found.drifted
    assert read_law(tmp_path / "a.yaml").offset == pytest.approx(found.drifted, rel=0.02)


def test_other_units_and_other_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = compare_laws(RECORD.runs, law="line")
    write_law(found, tmp_path / "a.yaml")
    file = read_law(tmp_path / "a.yaml")
    with pytest.raises(UnitError, match="'wheel \\[rad\\]' has another unit than the fit"):
        predict_loops(file, replace(RECORD.runs, input_title="wheel [rad]"))
    (tmp_path / "b.yaml").write_text("kind: muscle\n")
    with pytest.raises(FileFormatError, match="it has no 'kind: loops'"):
        read_law(tmp_path / "b.yaml")
    text = (tmp_path / "a.yaml").read_text().replace("law: line", "law: circle", 1)
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(FileFormatError, match="there is no law 'circle'"):
        read_law(tmp_path / "c.yaml")
    with pytest.raises(InputError, match="state has 2 plays"):
        replace(file, state=replace(file.state, plays=(1.0, 2.0)))
    table = write_table(tmp_path / "a.csv", RECORD.runs)
    for wrong in (
        ["--column", "a"],
        ["--hold-out", "x"],
        ["--hold-out", ","],
        ["--input", "x"],
        ["--hold-out", "2"],
    ):
        assert main(["hysteresis", "fit", str(table), *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
