"""What is no number, of the wrong shape or far too large is one clear line, from every function."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bozzini import effector as room
from bozzini.effector import Effector, preset
from bozzini.errors import InputError

DESIGN = preset("prototype")
EFFECTOR = Effector(DESIGN)
CUBIC = room.fit_cubic(EFFECTOR, "R", start=0.1)
HUGE = 10**400

CALLS = {
    "trace_circle steps": lambda: room.trace_circle(EFFECTOR, 1.0, steps=10**9),
    "trace_line steps": lambda: room.trace_line(EFFECTOR, [0, 0], [1, 1], steps=10**9),
    "trace_line half a step": lambda: room.trace_line(EFFECTOR, [0, 0], [1, 1], steps=7.5),
    "trace_path": lambda: room.trace_path(EFFECTOR, None),
    "fit_cubic samples": lambda: room.fit_cubic(EFFECTOR, "R", samples=10**12),
    "rigidity too long": lambda: room.rigidity_from_test(1, 1, 1e200),
    "rigidity too large": lambda: room.rigidity_from_test(1e308, 1e-5, 45),
    "rigidity none": lambda: room.rigidity_from_test(1e-6, 1e4, 1e-6),
    "tolerance None": lambda: room.balance(EFFECTOR, "R", 0.5, tolerance=None),
    "tolerance list": lambda: room.balance(EFFECTOR, "R", 0.5, tolerance=[]),
    "tolerance inf": lambda: room.balance(EFFECTOR, "R", 0.5, tolerance=math.inf),
    "pressure": lambda: room.balance(EFFECTOR, "R", HUGE),
    "pressures": lambda: room.pose(EFFECTOR, {"R": HUGE}),
    "order": lambda: room.pose(EFFECTOR, {"R": 0.1}, order=3, method="thesis"),
    "resultant angles": lambda: room.find_resultant("x", [1.0]),
    "resultant forces": lambda: room.find_resultant([0.0], [None]),
    "cubic lateral": lambda: CUBIC.find_lateral("x"),
    "cubic pressure": lambda: CUBIC.find_pressure([HUGE]),
    "look up": lambda: room.look_up_pressures({"R": CUBIC}, ["R"], "x"),
    "curve azimuth": lambda: room.place_curve([[1.0, 2.0]], math.nan),
    "curve points": lambda: room.place_curve("x", 1.0),
    "curve shapes": lambda: room.place_curve(np.zeros((3, 4, 2)), np.zeros(2)),
    "contraction": lambda: room.bend(DESIGN, HUGE),
    "target": lambda: room.solve_inverse(EFFECTOR, [1.0, HUGE]),
    "force direction": lambda: room.tip_force(EFFECTOR, [1.0, HUGE]),
    "force place": lambda: room.tip_force(EFFECTOR, [1.0, 0.0], lateral=[HUGE, 0.0]),
    "tips": lambda: room.place_tips(DESIGN, [1.0, HUGE]),
    "amplitudes": lambda: room.project_inverse(DESIGN, [1.0, 1.0], amplitudes=[HUGE] * 3),
    "stick": lambda: room.steer(EFFECTOR, [1.0, HUGE]),
    "angle": lambda: room.PlacedMuscle(name="A", muscle=DESIGN.muscles[0].muscle, angle=HUGE),
    "offset": lambda: DESIGN.replace(offset=HUGE),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS.keys())
def test_refused(call):
    with pytest.raises(InputError) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_whole_floats_are_whole_numbers():
    assert len(room.trace_circle(EFFECTOR, 1.0, steps=12.0).targets) == 13
    assert len(room.trace_line(EFFECTOR, [0, 0], [1, 1], steps=5.0).targets) == 5
    assert len(room.fit_cubic(EFFECTOR, "R", start=0.1, samples=20.0).pressure) == 20
    one, two = (room.workspace(EFFECTOR, directions=n, samples=n) for n in (24.0, 24))
    assert np.array_equal(one.boundary, two.boundary)
    found = room.optimise_design(EFFECTOR, 12.0, bounds={"offset": (3.0, 4.0)}, grid=2.0)
    assert found.success


def test_results_are_built_by_keyword_only():
    for result in (room.LinkageBend, room.Peak, room.Balance, room.EffectorPose, room.TipForce):
        with pytest.raises(TypeError, match="positional argument"):
            result(1.0)
