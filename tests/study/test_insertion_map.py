"""Maps of what fits: the answers of the planner, without its reasons."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini.io.records import read_record
from bozzini.motion import PlannerOptions, Scope, plan_insertion
from bozzini.study import Engine, Study, StudySpec, run_study
from bozzini.study.jobs import open_tract
from tests.cli.plan_cases import write_volume
from tests.shapes import bend_curve, curve_distance

DIAMETERS, LINKS = (3.0, 6.0, 9.0, 14.0), (6.0, 12.0)


def write_tube(path: Path, radius: float) -> None:
    """Write a bent tube as labels."""
    curve = bend_curve(30.0, 1.5, 25.0)
    low, high = curve.min(axis=0) - 12.0, curve.max(axis=0) + 12.0
    axes = [np.arange(a, b, 1.5) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = curve_distance(curve, radius)(points) < 0.0
    write_volume(path, inside.astype(np.uint8), 1.5)


@pytest.mark.slow(15)
def test_map_is_what_the_planner_proves(tmp_path: Path) -> None:
    write_tube(tmp_path / "wide.nii.gz", 6.0)
    write_tube(tmp_path / "narrow.nii.gz", 4.0)
    plain: dict[str, Any] = {
        "format": "bozzini-study-1",
        "job": "insertion-feasibility",
        "fixed": {"head_step": "1 mm", "organ": "colon"},
        "factors": {
            "tract": {"files": ["wide.nii.gz", "narrow.nii.gz"]},
            "diameter": {"values": list(DIAMETERS)},
            "link_length": {"values": list(LINKS)},
        },
        "sampling": {"method": "grid"},
    }
    study = Study(read_record(plain, StudySpec), tmp_path)
    rows = run_study(study, tmp_path / "out", engine=Engine(workers=1)).read()
    assert len(rows) == 16 and set(rows["code"]) <= {0, 2, 3}
    assert 0 < rows["feasible"].sum() < 16
    options = PlannerOptions(head_step=1.0, advise=False)
    for row in rows.to_dict("records"):
        # A scope wider than the widest way through never fits.
        assert not (row["feasible"] and row["diameter_mm"] > row["passage_mm"])
        assert (row["code"] == 2) == (row["diameter_mm"] > row["passage_mm"])
        case = open_tract(str(tmp_path / row["tract"]), -1.0, "", "colon", 0.0, 0.0)
        scope = Scope(diameter=row["diameter_mm"], link_length=row["link_length_mm"])
        first = plan_insertion(case.field, case.line, scope=scope, options=options)
        plan = case.change(head_step=1.0).plan(scope, advise=False).plan
        assert row["feasible"] == (plan.status == "complete" and plan.certified)
        assert row["feasible"] or first.status == "stopped"
        if row["feasible"]:
            assert plan.certificate is not None
            assert row["clearance_mm"] == pytest.approx(plan.certificate.clearance, abs=1e-3)


def test_a_phantom_by_its_seed(tmp_path: Path) -> None:
    plain: dict[str, Any] = {
        "format": "bozzini-study-1",
        "job": "insertion-feasibility",
        "fixed": {"link_length": "15 mm", "head_step": "3 mm", "voxel": "3 mm"},
        "factors": {"phantom": {"integers": [0, 1]}, "diameter": {"values": ["60 mm"]}},
        "sampling": {"method": "grid"},
    }
    study = Study(read_record(plain, StudySpec))
    rows = run_study(study, tmp_path / "out", engine=Engine(workers=1)).read()
    assert (rows["code"] == 2).all() and rows["passage_mm"].nunique() == 2
    assert (rows["reason"] == "no way through is so wide (proved)").all()
