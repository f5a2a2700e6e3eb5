"""Refusals of every figure: one clear line with what was given and what is legal."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bozzini.continuum import ArcModel, ContinuumRobot
from bozzini.continuum.workspace import map_dexterity, sample_workspace
from bozzini.duct import Centreline, Polygon, RoundCones
from bozzini.duct.fitting.measure import cut_sections
from bozzini.effector import Effector, balance, effector_preset, pose, trace_circle
from bozzini.errors import BozziniError, GeometryError, InputError, OutputError
from bozzini.motion.traverse import find_link_limits
from bozzini.muscle import MODELS, EnergyMuscle, Measurements, RankOptions, preset, rank
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from bozzini.muscle.ranking import compare_models
from bozzini.plot import continuum, effector, muscle
from bozzini.plot.clearance import draw_clearance
from bozzini.plot.comparison import draw_comparison
from bozzini.plot.duct import draw_link_limits, draw_sections, draw_shapes, outline_shapes
from bozzini.plot.figures import draw_depths, draw_overview
from bozzini.plot.fluoroscopy import render_fluoroscopy
from tests.plot.fake_motion import END, START, make_field, make_plan

EFFECTOR = Effector(effector_preset("prototype"))
ENERGY = EnergyMuscle(preset("effector-45"))
DATA = Measurements(pressure=[0.2, 0.4, 0.6], contraction=ENERGY.contraction([0.2, 0.4, 0.6]))
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOT = ContinuumRobot.from_yaml(EXAMPLES / "two_sections.yaml")


@cache
def rest():
    return ArcModel(ROBOT).shape(np.zeros(6))


PLAYS = PrandtlIshlinskii((0.0, 0.1), (0.5, 0.4))
LOOP = np.array([0.0, 0.3, 0.7, 0.2, 0.6, 0.0])
SQUARE = Polygon([[0, 0], [40, 0], [40, 6], [0, 6]])
FIELD = make_field()
LINE = Centreline.from_points([START, END], FIELD)
ACROSS = Centreline.from_points([[3, 3], [37, 3]], SQUARE)


def order(name: str) -> object:
    """Return a ranking of one model."""
    return rank(DATA, models={name: MODELS[name]}, options=RankOptions(folds=0))


def spoil() -> object:
    """Return a plan with a joint that is nowhere."""
    plan = make_plan()
    plan.joints[3, 2, 1] = np.nan
    return plan


def draw_fit_of_others() -> object:
    """Draw a fit beside a history of another."""
    fit = PrandtlIshlinskii.identify(LOOP, PLAYS.apply(LOOP), thresholds=PLAYS.thresholds)
    return muscle.draw_fit(fit, LOOP[1:], LOOP[1:])


# fmt: off
REFUSALS = [
    (lambda _: draw_depths(make_plan(), make_field(), depths=0),
     InputError, "number of depths is 0", "[1, 12]"),
    (lambda _: draw_clearance(spoil()),
     InputError, "joints of the plan has 1 value(s)", "NaN or infinite"),
    (lambda f: draw_overview(make_plan(), make_field(), path=f / "missing" / "a.png"),
     OutputError, "cannot write", "No such file"),
    (lambda _: draw_comparison([]), InputError, "no plan to compare was given", "at least 1"),
    (lambda _: render_fluoroscopy(make_field(), axis="oblique"),
     InputError, "view is 'oblique'", "coronal, sagittal, axial"),
    (lambda _: render_fluoroscopy(make_field(), margin=-1.0),
     InputError, "margin is -1 mm", "[0, inf) mm"),
    (lambda _: render_fluoroscopy(make_field(radius=-9.0)),
     GeometryError, "the field has no inside", "within the wall"),
    (lambda _: draw_shapes(RoundCones([(0, 0, 0), (9, 0, 0)], [2.0, 1.0]), line=LINE),
     InputError, "a centreline is drawn with its lumen", "give the field too"),
    (lambda _: outline_shapes(Polygon([[0, 0], [1, 0], [0, 1]])),
     InputError, "a Polygon cannot be drawn", "RoundCones"),
    (lambda _: draw_sections(FIELD, LINE, cut_sections(FIELD, LINE, rays=12), {}),
     InputError, "there are 0 kinds of circles", "give 1 or more"),
    (lambda _: draw_link_limits(find_link_limits(SQUARE, ACROSS, diameter=1.0, stations=2),
                                link=0.0),
     InputError, "link is 0 mm", "(0, inf) mm"),
    (lambda _: effector.draw_pose(EFFECTOR, pose(EFFECTOR, np.zeros((2, 3)))),
     InputError, "the pose has a tip of shape (2, 3)", "one pose"),
    (lambda _: effector.draw_iteration({}), InputError, "there are 0 iterations", "give 1 or more"),
    (lambda _: effector.draw_iteration({"root": balance(EFFECTOR, "R", pressure=0.5)}),
     InputError, "the balance 'root' has no single iteration table", "method='fixed-point'"),
    (lambda _: effector.draw_trace(trace_circle(EFFECTOR, 5.0), ["R"]),
     InputError, "there are 1 names", "give 3"),
    (lambda _: effector.draw_deflection(EFFECTOR, points=1),
     InputError, "points is 1", "[2, 1000000]"),
    (lambda _: effector.draw_force(EFFECTOR, points=3), InputError, "points is 3", "[4, 1000000]"),
    (lambda _: effector.draw_force(EFFECTOR, pressures=np.zeros((2, 3))),
     InputError, "pressures are a batch of shape (2,)", "one set"),
    (lambda _: muscle.draw_models(compare_models({"a": ENERGY, "b": ENERGY}, DATA), {"a": ENERGY}),
     InputError, "model 'b' was compared", "not among those given"),
    (lambda _: muscle.draw_contraction({}, pressure=0.5),
     InputError, "there are 0 models to draw", "give 1 or more"),
    (lambda _: muscle.draw_braid_angle({}, pressure=0.5),
     InputError, "there are 0 models to draw", "give 1 or more"),
    (lambda _: muscle.draw_contraction({"a": ENERGY}, pressure=-1.0),
     InputError, "pressure is -1 MPa", "(0, inf) MPa"),
    (lambda _: muscle.draw_braid_angle({"a": ENERGY}, pressure=-1.0),
     InputError, "pressure is -1 MPa", "(0, inf) MPa"),
    (lambda _: muscle.draw_force(ENERGY, []),
     InputError, "there are 0 pressures", "give 1 or more"),
    (lambda _: muscle.draw_force(ENERGY, [0.5], count=1), InputError, "count is 1", "[2, inf]"),
    (lambda _: muscle.draw_phases(ENERGY, pressure=0.01),
     InputError, "pressure is 0.01 MPa", "inf) MPa"),
    (lambda _: muscle.draw_ranking(order("wang")),
     InputError, "there are 0 models to draw", "give 1 or more"),
    (lambda _: muscle.draw_ranking(order("gaylord-1"), curves=0),
     InputError, "curves is 0", "[1, 5]"),
    (lambda _: muscle.draw_loops({}, [0.0, 1.0]),
     InputError, "there are 0 operators to draw", "give 1"),
    (lambda _: muscle.draw_loops({"plays": PLAYS}, [0.0]),
     InputError, "history has shape (1,)", "n >= 2"),
    (lambda _: draw_fit_of_others(), InputError, "history has shape (5,)", "the fit has (6,)"),
    (lambda _: continuum.draw_shape(ArcModel(ROBOT).shape(np.zeros((2, 6)))),
     InputError, "shape has points of shape (2, 45, 3)", "one shape is drawn"),
    (lambda _: continuum.draw_shape(ArcModel(ROBOT).shape([5.0, 0, 0, 0, 0, 0])),
     InputError, "shape is no shape to draw", "let out"),
    (lambda _: continuum.draw_comparison({}), InputError, "there are 0 shapes", "give 1 or more"),
    (lambda _: continuum.draw_comparison({"arc": rest()}),
     InputError, "reference 'rod' is not among", "arc"),
    (lambda _: continuum.draw_workspace(map_dexterity(sample_workspace(ROBOT, 50), cell=20.0),
                                        length=0.0),
     InputError, "length is 0 mm", "(0, inf) mm"),
    (lambda _: continuum.draw_shape(rest(), target=[1.0, 2.0]),
     InputError, "target has shape (2,)", "(..., 3)"),
    (lambda _: continuum.draw_shape(rest(), direction=[0.0, 0.0, 0.0]),
     InputError, "direction is (0, 0, 0)", "not be zero"),
]
# fmt: on
"""What is drawn, the error, the field that the message names, and what it states as legal."""


@pytest.mark.parametrize(("call", "error", "field", "legal"), REFUSALS)
def test_refused(
    tmp_path: Path,
    call: Callable[[Path], object],
    error: type[BozziniError],
    field: str,
    legal: str,
) -> None:
    with pytest.raises(error) as caught:
        call(tmp_path)
    line = str(caught.value)
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 400
    assert not [*tmp_path.iterdir()]
