"""What every result of muscles and effectors offers: plain values, a table, a cell, a picture."""

from __future__ import annotations

import dataclasses
import importlib
import json
import pkgutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas
import pytest

import bozzini
from bozzini import views
from bozzini.anatomy.tract import LabelTract
from bozzini.continuum import ContinuumRobot
from bozzini.duct import Centreline
from bozzini.effector import (
    Effector,
    balance,
    effector_preset,
    optimise_design,
    sweep,
    tip_force,
    trace_circle,
)
from bozzini.errors import ConvergenceError, InputError, MissingExtraError
from bozzini.muscle import (
    EnergyMuscle,
    Measurements,
    RankOptions,
    calibrate,
    compare_models,
    rank,
    take_measurements,
)
from bozzini.muscle import preset as muscle_preset
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from bozzini.results import (
    SHOWN_TOTAL,
    ClosedForm,
    ReasonedResult,
    Result,
    Shown,
    measured,
    rows_of,
    tabulated,
)

mpl.use("Agg")

EXAMPLES = Path(__file__).parents[1] / "examples"

MUSCLE = muscle_preset("effector-45")
EFFECTOR = Effector(effector_preset("prototype"))
PRESSURE = np.linspace(0.0, 0.8, 12)
DATA = Measurements(pressure=PRESSURE, contraction=EnergyMuscle(MUSCLE).contraction(PRESSURE))

RESULTS = {
    "state": (lambda: EnergyMuscle(MUSCLE).solve(PRESSURE), 12),
    "calibration": (lambda: calibrate(EnergyMuscle, MUSCLE, data=DATA), 2),
    "comparison": (lambda: compare_models({"energy": EnergyMuscle(MUSCLE)}, DATA), 1),
    "ranking": (
        lambda: rank(DATA, MUSCLE, models={"energy": EnergyMuscle}, options=RankOptions(folds=0)),
        1,
    ),
    "hysteresis": (
        lambda: PrandtlIshlinskii.identify(np.sin(PRESSURE * 20), np.sin(PRESSURE * 20)),
        1,
    ),
    "pose": (lambda: EFFECTOR.forward({"R": PRESSURE}), 12),
    "inverse": (lambda: EFFECTOR.inverse([[3.0, -4.0], [300.0, 0.0]]), 2),
    "workspace": (lambda: EFFECTOR.workspace(directions=12, samples=1), None),
    "force": (lambda: tip_force(EFFECTOR, [[1.0, 0.0], [0.0, 1.0]]), 2),
    "balance": (lambda: balance(EFFECTOR, "R", pressure=PRESSURE), 12),
    "trace": (lambda: trace_circle(EFFECTOR, 5.0, steps=8), 9),
    "sweep": (lambda: sweep(EFFECTOR, {"offset": [3.0, 4.0]}), 2),
    "optimum": (lambda: optimise_design(EFFECTOR, 9.0, bounds={"offset": (3.9, 4.0)}, grid=2), 1),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_plain_values_a_table_and_a_picture(name: str) -> None:
    build, rows = RESULTS[name]
    found: Any = build()
    assert isinstance(found, Result)
    plain = found.to_dict()
    assert {"converged", "reason", "residual"} <= set(plain)
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    frame = found.to_frame()
    assert rows is None or len(frame) == rows
    if found.rows_have_verdict:
        assert np.array_equal(frame["converged"], found.converged)
        assert np.array_equal(frame["reason"], found.reason)
    assert frame.to_html(max_rows=20) in found._repr_html_()
    if hasattr(found, "plot"):
        axes = found.plot()
        assert axes.get_xlabel().endswith("]") or axes.get_xlabel() in ("row", "design")
        assert found.plot(axes) is axes
        mpl.pyplot.close(axes.figure)


@dataclass(frozen=True, kw_only=True)
class Step:
    """A row of `Walk`."""

    place: float = tabulated("mm")
    note: str = tabulated(name="why")
    hidden: int = 0


@dataclass(frozen=True, kw_only=True)
class Walk(ClosedForm):
    """A result that says in its fields what its table is."""

    names: tuple[str, ...] = ("left", "right")
    tip: Any = tabulated("mm", "tip_{}")
    pulls: Any = tabulated("N", "pull_{}", over="names")
    count: Any = tabulated()
    length: float = measured("mm")


@dataclass(frozen=True, kw_only=True)
class Walked(ReasonedResult):
    """A result whose rows are items."""

    steps: tuple[Step, ...] = rows_of(Step)
    reason: str = ""
    residual: float = 0.0


def test_fields_are_the_columns_of_a_table() -> None:
    tips, pulls = np.arange(12.0).reshape(2, 2, 3), np.arange(8.0).reshape(2, 2, 2)
    walk = Walk(tip=tips, pulls=pulls, count=np.arange(4).reshape(2, 2), length=3.0)
    frame = walk.to_frame()
    assert list(frame) == ["tip_x_mm", "tip_y_mm", "tip_z_mm", "pull_left_N", "pull_right_N",
                           "count"]  # fmt: skip
    assert np.array_equal(frame.to_numpy()[:, :3], tips.reshape(4, 3))
    assert np.array_equal(frame["pull_right_N"], pulls[..., 1].ravel())
    assert walk.to_dict()["length_mm"] == 3.0
    walked = Walked(steps=(Step(place=1.0, note="a"), Step(place=2.0, note="b")))
    assert walked.list_table() == {"place_mm": [1.0, 2.0], "why": ["a", "b"]}
    assert walked.list_table().keys() == Walked(steps=()).list_table().keys()
    assert walked.converged and not Walked(steps=(), reason="none").converged


def test_a_view_that_lacks_an_extra_says_so_each_time(monkeypatch) -> None:
    def load() -> None:
        raise MissingExtraError("nothing", "none")

    monkeypatch.setattr(views, "_loaders", [])
    views.load_views_by(load)
    for _ in range(2):
        with pytest.raises(MissingExtraError):
            views.find_view(int)


def test_a_result_without_a_view_says_so() -> None:
    with pytest.raises(InputError, match="there is no view of a Walked"):
        Walked(steps=()).show()
    assert "<iframe" in EFFECTOR.forward({"R": 0.5}).show()._repr_html_()


def test_a_cell_names_the_reason() -> None:
    assert "the target is 300 mm away" in EFFECTOR.inverse([300.0, 0.0])._repr_html_()


def test_a_target_out_of_reach_is_missed_by_what_is_left() -> None:
    found = EFFECTOR.inverse([[3.0, -4.0], [30.0, 0.0]])
    missed = np.linalg.norm(found.target - EFFECTOR.forward(found.pressures).lateral_vector, axis=1)
    assert found.residual == pytest.approx(missed, abs=1e-9)
    assert found.converged.tolist() == (missed < 1e-6).tolist() == [True, False]


def test_verbs_are_the_functions() -> None:
    found = EFFECTOR.forward({"R": 0.5})
    back = EFFECTOR.inverse(found.lateral_vector)
    assert back.pressures == pytest.approx([0.5, 0.0, 0.0], abs=1e-9)
    assert EFFECTOR.inverse(tip=found.lateral_vector).delivered == pytest.approx(
        found.lateral_vector
    )


def test_columns_of_a_table_are_muscles() -> None:
    table = pandas.DataFrame({"B": [0.0, 0.1], "R": [0.5, 0.2]})
    wanted = EFFECTOR.forward([[0.5, 0.0, 0.0], [0.2, 0.0, 0.1]]).tip
    assert np.array_equal(EFFECTOR.forward(table).tip, wanted)
    assert np.array_equal(EFFECTOR.forward(table.iloc[1]).tip, wanted[1])
    with pytest.raises(InputError, match="no muscle 'Q'"):
        EFFECTOR.forward(table.rename(columns={"B": "Q"}))


def test_tables_of_pandas_are_measurements() -> None:
    frame = DATA.to_frame()
    again = take_measurements(frame)
    for name in ("pressure", "contraction", "load", "direction", "specimen"):
        assert np.array_equal(getattr(again, name), getattr(DATA, name))
    kilo = frame.rename(columns={"pressure [MPa]": "pressure [kPa]"})
    kilo["pressure [kPa]"] *= 1e3
    ranking = rank(kilo, MUSCLE, models={"energy": EnergyMuscle}, options=RankOptions(folds=0))
    assert ranking.models[0].score.rmse < 1e-6
    assert list(ranking.to_frame()["model"]) == ["energy"]


def test_measurements_are_drawn_row_by_row() -> None:
    axes = DATA.plot()
    assert axes.lines[0].get_xydata().tolist() == (
        np.stack([DATA.pressure, DATA.contraction], axis=1).tolist()
    )
    mpl.pyplot.close(axes.figure)


def test_a_model_draws_itself() -> None:
    import bozzini as bz

    model = bz.muscle.TonduLopez(MUSCLE, kappa1=0.0, kappa2=1.0)
    axes = model.plot_contraction(0.6, lowest=0.1)
    over, drawn = axes.lines[0].get_data()
    assert drawn == pytest.approx(model.contraction(np.asarray(over) / 1e3))
    force = model.plot_force(0.6)
    assert force.lines[0].get_ydata()[-1] == pytest.approx(0.0, abs=1e-9)
    for drawn_into in (axes, force):
        mpl.pyplot.close(drawn_into.figure)
    with pytest.raises(AttributeError, match="has no attribute 'Nobody'"):
        bz.muscle.Nobody  # noqa: B018


def test_large_arrays_are_shown_by_their_shape() -> None:
    height = np.linspace(0.0, 90.0, 91)
    points = np.stack([0.0 * height, 0.0 * height, height], axis=1)
    line = Centreline(points=points, arc_length=height, radius=np.full(91, 7.0))
    labels = np.zeros((9, 9, 40), dtype=np.uint16)
    labels[3:6, 3:6, 3:-3] = 1
    tract = LabelTract(labels=labels, affine=np.eye(4), source="box")
    assert f"points=<{line.points.shape}>" in repr(line)
    assert f"labels=<{tract.labels.shape}>" in repr(tract) and repr(tract.affine) in repr(tract)
    assert max(len(repr(line)), len(repr(tract))) < 1000


def test_results_are_shown_briefly() -> None:
    import bozzini as bz

    tip = bz.Effector(bz.effector.effector_preset("prototype"))
    tendons = [
        bz.continuum.Tendon(name=f"T{k}", offset=4.0, angle=0.5 * np.pi * k) for k in range(4)
    ]
    robot = bz.ContinuumRobot([bz.continuum.Section(length=60.0, radius=5.0, tendons=tendons)])
    model = bz.continuum.EnergyModel(robot)
    shape = model.shape([1.0, 0.0, -1.0, 0.0])
    shown = [
        tip.forward({"R": np.linspace(0.1, 0.5, 40)}),
        bz.effector.workspace(tip),
        model.jacobian(shape),
        robot.inverse([10.0, 5.0, 55.0]),
        robot,
        tip,
        Measurements(pressure=np.linspace(0.0, 0.6, 200), contraction=np.linspace(0.0, 0.2, 200)),
    ]
    for result in shown:
        assert repr(result).startswith(f"{type(result).__name__}(")
        assert len(repr(result)) < 600, type(result)


def _list_public() -> set[type]:
    """Return the dataclasses that packages offer."""
    packages = [
        item.name
        for item in pkgutil.walk_packages(bozzini.__path__, "bozzini.")
        if item.ispkg and not item.name.endswith((".cli", ".kernels"))
    ]
    modules = [bozzini, *map(importlib.import_module, packages)]
    offered = (
        getattr(module, name) for module in modules for name in getattr(module, "__all__", ())
    )
    return {item for item in offered if isinstance(item, type) and dataclasses.is_dataclass(item)}


def test_what_packages_offer_is_shown_briefly() -> None:
    """What is not shown by `Shown` has a few plain fields and is short by itself."""
    plain = {"float", "int", "str", "bool", "float | None", "int | None", "str | None"}
    long = [
        kind.__name__
        for kind in _list_public()
        if not issubclass(kind, Shown)
        and (
            len(dataclasses.fields(kind)) > 5
            or any(str(item.type) not in plain for item in dataclasses.fields(kind) if item.repr)
        )
    ]
    assert long == []


def test_a_representation_ends_before_it_is_long() -> None:
    fields = [f"length_{k}" for k in range(60)]
    kind = dataclasses.make_dataclass("Long", [(name, str) for name in fields], bases=(Shown,))
    few, many = kind(*["a" * 9] * 60), kind(*["b" * 999] * 60)
    assert len(repr(few)) <= SHOWN_TOTAL and repr(few).endswith("...)")
    assert len(repr(many)) <= SHOWN_TOTAL
    assert few._repr_html_().count("<tr>") == 60
    robot = ContinuumRobot.from_yaml(EXAMPLES / "two_sections.yaml")
    shape = robot.model("arc").solve(np.zeros(len(robot.tendons)))
    for item in (robot, shape, Effector.from_preset("measured"), muscle_preset("effector-45")):
        assert len(repr(item)) <= SHOWN_TOTAL
        assert "<table" in item._repr_html_()
    assert "45.0 mm" in muscle_preset("effector-45")._repr_html_()


def test_what_is_no_answer_is_required_in_vain() -> None:
    effector = Effector.from_preset("measured")
    with pytest.raises(ConvergenceError, match="300 mm away"):
        effector.inverse((300.0, 0.0)).require()
    with pytest.raises(ConvergenceError, match="in 1 of 2"):
        effector.inverse([(3.0, 0.0), (300.0, 0.0)]).require()
    found = effector.inverse((3.0, 0.0))
    assert found.require() is found
