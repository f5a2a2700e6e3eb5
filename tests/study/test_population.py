"""Shares of patients: what is proved, what is undecided, and what is an error, counted apart."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
import yaml
from scipy.stats import binom

from bozzini.cli.main import main
from bozzini.errors import InputError
from bozzini.io.records import read_record
from bozzini.study import Study, StudySpec
from bozzini.study.jobs import InsertionJob
from bozzini.study.population import count_fits
from tests.study.test_insertion_map import write_tube


def make_study(**changes: Any) -> Study:
    given = {
        "format": "bozzini-study-1",
        "job": "insertion-feasibility",
        "fixed": {"link_length": "10 mm"},
        "factors": {
            "phantom": {"integers": [1, 20]},
            "diameter": {"values": [8, 12]},
        },
        "sampling": {"method": "grid"},
    }
    return Study(read_record(given | changes, StudySpec))


def make_rows(study: Study, codes: list[list[int]]) -> pandas.DataFrame:
    """Return rows of the study with a list of codes for each diameter."""
    drawn = study.draw(0, study.rows)
    code = np.array(codes).T.ravel()
    return pandas.DataFrame({
        "phantom": drawn["phantom"], "diameter_mm": drawn["diameter"], "code": code,
        "feasible": code == 0,
    })  # fmt: skip


def test_every_kind_of_answer_is_counted_apart() -> None:
    study = make_study()
    small = [0] * 20
    large = [0] * 6 + [InsertionJob.TOO_WIDE] * 8 + [InsertionJob.NOT_FOUND] * 2 + [1, 1, -1, -1]
    found = count_fits(study, make_rows(study, [small, large]))
    first, second = found.table.to_dict("records")
    assert first["patients"] == first["fits"] == 20 and first["share_high"] == 1.0
    counts = {name: second[name] for name in ("fits", "fits_not", "undecided", "errors")}
    assert counts == {"fits": 6, "fits_not": 8, "undecided": 2, "errors": 4}
    assert second["patients"] == 16 and second["share"] == 6 / 16  # errors are no patients
    assert second["share_low"] < 6 / 16 < second["share_high"]
    # Wilson's ends are where the score of the count is the quantile.
    for end in (second["share_low"], second["share_high"]):
        score = abs(6 / 16 - end) / np.sqrt(end * (1 - end) / 16)
        assert score == pytest.approx(1.95996, abs=1e-4)
    none = count_fits(study, make_rows(study, [small, [1] * 20])).table.to_dict("records")[1]
    assert none["patients"] == 0 and np.isnan(none["share"])


def test_a_motion_beyond_a_constraint_decides_nothing() -> None:
    study = make_study(constraints={"clearance": {"at_least": "0.5 mm"}})
    rows = make_rows(study, [[0] * 20, [0] * 20])
    rows.loc[:9, "feasible"] = False
    for row in count_fits(study, rows).table.to_dict("records"):
        assert (row["fits"], row["undecided"], row["fits_not"]) == (15, 5, 0)


def test_missing_rows_are_told() -> None:
    study = make_study()
    rows = make_rows(study, [[0] * 20, [0] * 20])
    with pytest.raises(InputError, match="10 of 40 rows are missing"):
        count_fits(study, rows[:30])


def test_intervals_hold_the_share_that_is_true() -> None:
    study, held = make_study(), []
    rows = make_rows(study, [[0] * 20, [0] * 20])
    for count in range(21):
        rows.loc[rows["diameter_mm"] == 8, "code"] = [0] * count + [2] * (20 - count)
        rows["feasible"] = rows["code"] == 0
        row = count_fits(study, rows).table.iloc[0]
        held.append(row["share_low"] <= 0.3 <= row["share_high"])
    assert binom.pmf(range(21), 20, 0.3) @ held == pytest.approx(0.95, abs=0.03)


def test_what_is_no_population() -> None:
    study = make_study(
        factors={"diameter": {"values": [8, 12]}}, fixed={"phantom": 1, "link_length": 10}
    )
    with pytest.raises(InputError, match="no population"):
        count_fits(study, pandas.DataFrame())
    random = make_study(sampling={"method": "random", "count": 5})
    with pytest.raises(InputError, match="sampling grid"):
        count_fits(random, pandas.DataFrame())


@pytest.mark.slow(20)
def test_command_over_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_tube(tmp_path / "wide.nii.gz", 6.0)
    write_tube(tmp_path / "narrow.nii.gz", 4.0)
    (tmp_path / "damaged.nii.gz").write_bytes(b"no volume")
    study = {
        "format": "bozzini-study-1",
        "job": "insertion-feasibility",
        "fixed": {"head_step": "1 mm", "organ": "colon", "link_length": "6 mm"},
        "factors": {
            "tract": {"files": ["wide.nii.gz", "narrow.nii.gz", "damaged.nii.gz"]},
            "diameter": {"values": ["3 mm", "9 mm", "20 mm"]},
        },
        "sampling": {"method": "grid"},
    }
    path, out = tmp_path / "study.yaml", tmp_path / "out"
    path.write_text(yaml.safe_dump(study))
    run = ["uncertainty", str(path), "--workers", "1", "--out", str(out), "--json", "--quiet"]
    assert main(run) == 0
    rows = json.loads(capsys.readouterr().out)["scopes"]
    assert [row["diameter_mm"] for row in rows] == [3.0, 9.0, 20.0]
    assert all(row["errors"] == 1 and row["patients"] == 2 for row in rows)
    assert rows[0]["fits"] == 2 and rows[1]["fits"] <= 1 and rows[2]["fits_not"] == 2
    assert {"population.csv", "population.png", "summary.json"} < {p.name for p in out.iterdir()}
    assert main(["uncertainty", str(out)]) == 0
    text = capsys.readouterr().out
    assert "0.34 to 1.00" in text and "study status" in text
