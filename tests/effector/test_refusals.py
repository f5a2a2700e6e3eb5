"""Refusals of every function of the effector: one clear line with the field and what is legal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bozzini import effector as package
from bozzini.effector import (
    Effector,
    EffectorDesign,
    PlacedMuscle,
    Stick,
    effector_preset,
    find_peak,
)
from bozzini.errors import InputError
from bozzini.muscle import ThesisMuscle

DESIGN = effector_preset("prototype")
EFFECTOR = Effector(DESIGN)
MUSCLE = DESIGN.muscles[0].muscle
CUBIC = package.fit_cubic(EFFECTOR, "R", start=0.1)
ONE = PlacedMuscle(name="A", muscle=MUSCLE, angle=0.0)
HUGE = 10**400
RANGES = {
    "offset": (3.0, 4.0), "flexural_rigidity": (100.0, 200.0), "holder_length": (1.0, 2.0)
}  # fmt: skip


def optimise(deflection: float = 10.0, **options: Any) -> object:
    return package.optimise_design(EFFECTOR, deflection, **options)


def project(target: Any, amplitudes: Any = 3.0, **options: Any) -> object:
    return package.project_inverse(DESIGN, target, amplitudes=amplitudes, **options)


def sweep(parameters: Any) -> object:
    return package.sweep(EFFECTOR, parameters)


def change(changes: Any) -> object:
    return package.change_design(DESIGN, changes)


CUBICS = {name: package.fit_cubic(EFFECTOR, name, start=0.1) for name in DESIGN.names}
NARROW, WEAK = (
    Effector(DESIGN.replace(**one)) for one in ({"offset": 3.0}, {"pressure_limit": 0.5})
)

# fmt: off
REFUSALS: list[tuple[Callable[[], object], str, str]] = [
    (lambda: package.trace_circle(EFFECTOR, 1.0, steps=10**9),
     "steps is 1000000000", "[3, 1000000]"),
    (lambda: package.trace_circle(EFFECTOR, 0.0), "radius is 0 mm", "(0, 1e+06] mm"),
    (lambda: package.trace_line(EFFECTOR, [0, 0], end=[1, 1], steps=10**9),
     "steps is 1000000000", "[2, 1000000]"),
    (lambda: package.trace_line(EFFECTOR, [0, 0], end=[1, 1], steps=7.5),
     "steps is 7.5", "a whole number in [2, 1000000]"),
    (lambda: package.trace_line(EFFECTOR, [0.0, 0.0], end=[1.0, 0.0], steps=1),
     "steps is 1", "[2, 1000000]"),
    (lambda: package.trace_line(EFFECTOR, [0.0, 0.0], end=[[1.0, 0.0]]),
     "end has shape (1, 2)", "(2,)"),
    (lambda: package.trace_path(EFFECTOR, None),
     "target is None", "a number or an array of numbers"),
    (lambda: package.trace_path(EFFECTOR, np.empty((0, 2))),
     "targets has shape (0, 2)", "(n, 2) with n of 1 or more"),
    (lambda: package.fit_cubic(EFFECTOR, "R", samples=10**12),
     "samples is 1000000000000", "[4, 1000000]"),
    (lambda: package.fit_cubic(EFFECTOR, "R", samples=3), "samples is 3", "[4, 1000000]"),
    (lambda: package.fit_cubic(EFFECTOR, "R", start=5.0), "start is 5 MPa", "[0, 0.78565] MPa"),
    (lambda: CUBIC.find_lateral("x"), "pressure is 'x'", "a number or an array of numbers"),
    (lambda: CUBIC.find_lateral(2.0), "pressure is 2 MPa", "[0.1, 0.827] MPa"),
    (lambda: CUBIC.find_pressure([HUGE]), "lateral is", "a number or an array of numbers"),
    (lambda: CUBIC.find_pressure(100.0), "deflection by muscle R is 100 mm", "[0, 14.2038] mm"),
    (lambda: package.look_up_pressures({"R": CUBIC}, ["R"], displacements="x"),
     "displacements is 'x'", "a number or an array of numbers"),
    (lambda: package.look_up_pressures({"R": CUBIC}, ["R", "B"], displacements=[1.0, 1.0]),
     "muscle B has no cubic", "there are some for R"),
    (lambda: package.rigidity_from_test(1, 1, length=1e200),
     "length is 1e+200 mm", "(0, 10000] mm"),
    (lambda: package.rigidity_from_test(1e308, 1e-5, length=45),
     "force is 1e+308 N", "(0, 1e+06] N"),
    (lambda: package.rigidity_from_test(1e-6, 1e4, length=1e-6),
     "flexural rigidity of the test is", "[1e-06, 1e+12] N mm^2"),
    (lambda: package.balance(EFFECTOR, "R", pressure=0.5, tolerance=None),
     "tolerance is None", "a number in (0, 1000] mm"),
    (lambda: package.balance(EFFECTOR, "R", pressure=0.5, tolerance=[]),
     "tolerance is []", "a number in (0, 1000] mm"),
    (lambda: package.balance(EFFECTOR, "R", pressure=0.5, tolerance=math.inf),
     "tolerance is inf mm", "(0, 1000] mm"),
    (lambda: package.balance(EFFECTOR, "R", pressure=HUGE),
     "pressure of muscle R is", "a number or an array of numbers"),
    (lambda: package.pose(EFFECTOR, {"R": HUGE}),
     "pressure of muscle R is", "a number or an array of numbers"),
    (lambda: package.pose(EFFECTOR, {"R": 0.1}, order=3, method="thesis"),
     "order is 3", "a sequence of names"),
    (lambda: package.pose(EFFECTOR, {"R": 0.1}, order=["X"], method="thesis"),
     "there is no muscle 'X'", "choose one of R, G, B"),
    (lambda: package.pose(EFFECTOR, {"R": 0.1}, order=["R", "R"], method="thesis"),
     "order is ['R', 'R']", "each muscle may be there once"),
    (lambda: package.pose(EFFECTOR, {"R": 0.1}, order=["R"]),
     "an order of pressing is given", "only method='thesis' depends on one"),
    (lambda: package.pose(EFFECTOR, [0.3, 0.3, 0.3], method="thesis"),
     "3 muscles are contracted", "the thesis's steps are for at most 2; method='superposition'"),
    (lambda: package.find_resultant("x", [1.0]),
     "angles is 'x'", "a number or an array of numbers"),
    (lambda: package.find_resultant([0.0], [None]),
     "forces is [None]", "a number or an array of numbers"),
    (lambda: package.place_curve([[1.0, 2.0]], math.nan),
     "azimuth is nan rad", "[-1e+06, 1e+06] rad"),
    (lambda: package.place_curve("x", 1.0),
     "points must", "be an array of numbers of shape (..., 2)"),
    (lambda: package.place_curve(np.zeros((3, 4, 2)), np.zeros(2)),
     "points (3, 4, 2) and azimuth (2,) do not go toge", "give one azimuth for each curve"),
    (lambda: package.bend(DESIGN, HUGE), "contraction is", "a number or an array of numbers"),
    (lambda: package.bend(DESIGN, -0.1), "contraction is -0.1 mm", "[0, 45) mm"),
    (lambda: package.bend(DESIGN, math.nan), "contraction is nan mm", "[0, 45) mm"),
    (lambda: package.lateral_deflection(DESIGN, 45.0), "contraction is 45 mm", "[0, 45) mm"),
    (lambda: package.lateral_slope(DESIGN, [1.0, math.inf]),
     "contraction[1] is inf mm", "[0, 45) mm"),
    (lambda: package.contraction_for_lateral(DESIGN, -0.1),
     "lateral deflection is -0.1 mm", "[0, 27.7018] mm, what this section can reach"),
    (lambda: package.contraction_for_lateral(DESIGN, 27.8),
     "lateral deflection is 27.8 mm", "[0, 27.7018] mm, what this section can reach"),
    (lambda: package.contraction_for_lateral(DESIGN, math.nan),
     "lateral deflection is nan mm", "[0, 27.7018] mm, what this section can reach"),
    (lambda: package.contraction_for_lateral(DESIGN, "far"),
     "lateral is 'far'", "a number or an array of numbers"),
    (lambda: package.solve_inverse(EFFECTOR, [1.0, HUGE]),
     "target is", "a number or an array of numbers"),
    (lambda: package.workspace(EFFECTOR, directions=3), "directions is 3", "[12, 1000000]"),
    (lambda: package.place_tips(DESIGN, [1.0, HUGE]),
     "lateral position is", "a number or an array of numbers"),
    (lambda: package.place_tips(DESIGN, [30.0, 0.0]),
     "lateral deflection is 30 mm", "[0, 27.7018] mm, what this section can reach"),
    (lambda: package.tip_force(EFFECTOR, [1.0, HUGE]),
     "direction is", "a number or an array of numbers"),
    (lambda: package.tip_force(EFFECTOR, [0.0, 0.0]),
     "direction is (0, 0)", "a vector of any length but zero"),
    (lambda: package.tip_force(EFFECTOR, [1.0, 0.0], lateral=[HUGE, 0.0]),
     "lateral is", "a number or an array of numbers"),
    (lambda: package.tip_force(EFFECTOR, [1.0, 0.0], lateral=[20.0, 0.0]),
     "lateral is (20, 0) mm", "the tip cannot be there, muscle R (14.35 mm) is at its most"),
    (lambda: package.tip_force(EFFECTOR, [1.0, 0.0], lateral=[[1.0, 0.0]]),
     "lateral has shape (1, 2)", "(2,)"),
    (lambda: package.tip_stiffness(Effector(DESIGN, ThesisMuscle), [0.5, 0.0, 0.0]),
     "load path is 'none'", "the thesis's equations have no response to a load, so no for"),
    (lambda: project([1.0, 1.0], [HUGE] * 3), "amplitudes is", "a number or an array of numbers"),
    (lambda: project([1.0, 2.0, 3.0], 1.0), "target has shape (3,)", "(..., 2)"),
    (lambda: project([1.0, math.nan], 1.0),
     "target has", "1 point(s) that are not finite (NaN or infinite)"),
    (lambda: project([1.0, 1e300], 1.0), "target y is 1e+300 mm", "[-1e+09, 1e+09] mm"),
    (lambda: project([1.0, 2.0], [1.0, 2.0]), "amplitudes has shape (2,)", "() or (3,)"),
    (lambda: project([1.0, 2.0], -1.0), "amplitude is -1 mm", "[0, 1e+12] mm"),
    (lambda: project([1.0, 2.0], "many"),
     "amplitudes is 'many'", "a number or an array of numbers"),
    (lambda: project([1.0, 2.0], math.nan), "amplitude is nan mm", "[0, 1e+12] mm"),
    (lambda: project([1.0, 1.0], peak=None), "peak is None", "a number in [0, 1e+12] mm"),
    (lambda: project([1.0, 1.0], peak="x"), "peak is 'x'", "a number in [0, 1e+12] mm"),
    (lambda: project([1.0, 1.0], peak=-1.0), "peak is -1 mm", "[0, 1e+12] mm"),
    (lambda: project([1.0, 1.0], peak=math.nan), "peak is nan mm", "[0, 1e+12] mm"),
    (lambda: package.steer(EFFECTOR, [1.0, HUGE]),
     "stick reading is", "a number or an array of numbers"),
    (lambda: package.steer(EFFECTOR, [1025, 500]), "stick reading x is 1025", "[0, 1024]"),
    (lambda: package.steer(EFFECTOR, [500, -1]), "stick reading y is -1", "[0, 1024]"),
    (lambda: package.steer(EFFECTOR, [500, math.nan]),
     "stick reading has", "1 point(s) that are not finite (NaN or infinite)"),
    (lambda: package.steer(EFFECTOR, [500]), "stick reading has shape (1,)", "(..., 2)"),
    (lambda: package.steer(EFFECTOR, [500, 500], scale=0.0),
     "stick scale is 0 mm", "(0, 1e+06] mm"),
    (lambda: Stick(centre=2000.0), "stick centre is 2000", "[0, 1024]"),
    (lambda: Stick(span=0.0), "stick span is 0", "(0, 1e+09]"),
    (lambda: Stick(dead_zone=500.0), "stick dead zone is 500", "[0, 460.8]"),
    (lambda: Stick(highest=-1.0), "stick highest is -1", "(0, 1e+09]"),
    (lambda: PlacedMuscle(name="A", muscle=MUSCLE, angle=HUGE),
     "angle of muscle A is", "a number in [-1e+06, 1e+06] rad"),
    (lambda: PlacedMuscle(name="A", muscle=MUSCLE, angle=math.inf),
     "angle of muscle A is inf rad", "[-1e+06, 1e+06] rad"),
    (lambda: PlacedMuscle(name="A", muscle=45.0, angle=0.0), "muscle A is a float", "a Muscle"),
    (lambda: PlacedMuscle(name="a b", muscle=MUSCLE, angle=0.0),
     "muscle name is 'a b'", "a word without blanks, ',' or '='"),
    (lambda: EffectorDesign(muscles=(ONE, PlacedMuscle(name="A", muscle=MUSCLE, angle=1.0))),
     "two muscles are called 'A'", "names must differ"),
    (lambda: EffectorDesign(muscles=(ONE, PlacedMuscle(name="B", muscle=MUSCLE, angle=math.tau))),
     "muscles A and B are", "angles must differ"),
    (lambda: DESIGN.index("X"), "there is no muscle 'X'", "choose one of R, G, B"),
    (lambda: DESIGN.replace(offset=HUGE), "offset is", "a number in [0.001, 1000] mm"),
    (lambda: effector_preset("x"),
     "there is no effector preset 'x'", "choose one of measured"),
    (lambda: package.find_needed_pressure(EFFECTOR, 27.6),
     "deflection is 27.6 mm", "muscle R does not reach it at any pressure up to 10 MPa"),
    (lambda: package.find_needed_pressure(EFFECTOR, find_peak(DESIGN).lateral),
     "deflection is 27.7018 mm", "muscle R does not reach it at any pressure up to 10 MPa"),
    (lambda: package.find_needed_pressure(EFFECTOR, 30.0),
     "deflection is 30 mm", "(0, 27.7018] mm, the backbone's largest deflection"),
    (lambda: package.find_needed_pressure(EFFECTOR, 0.0), "deflection is 0 mm", "(0, 1e+06] mm"),
    (lambda: sweep({}), "there is nothing to vary", "give a mapping of parameters to their values"),
    (lambda: sweep(3), "there is nothing to vary", "give a mapping of parameters to their values"),
    (lambda: sweep({"offset": []}), "values of offset is", "give 1 or more"),
    (lambda: sweep({"colour": [1]}),
     "there is no parameter 'colour'",
     "give one such as 'offset'; legal are a field of EffectorDesi"),
    (lambda: sweep({"muscle.colour": [1]}),
     "there is no parameter 'muscle.colour'",
     "did you mean 'muscle.modulus'; legal are a field of Effector"),
    (lambda: sweep({"ofset": [1]}),
     "there is no parameter 'ofset'",
     "did you mean 'offset'; legal are a field of EffectorDesign,"),
    (lambda: sweep({"offset": 4.0}), "values of offset is 4.0", "give a sequence of values"),
    (lambda: sweep({"offset": [4.0, None]}), "offset is None", "a number in [0.001, 1000] mm"),
    (lambda: sweep({"offset": [4.0, -1.0]}), "offset is -1 mm", "[0.001, 1000] mm"),
    (lambda: sweep({"length": [None]}), "length is None", "a number in [0.01, 10000] mm"),
    (lambda: sweep({"angles": [None]}), "angles is None", "give 3 numbers in rad"),
    (lambda: sweep({"angles": [(0.0, 1.0)]}),
     "angles has 2 value(s)", "give 3, one for each of the muscles R, G, B"),
    (lambda: sweep({"angles": [(0.0, 1.0, 1.0)]}),
     "muscles G and B are both at 1 rad (57.2958 deg)", "angles must differ"),
    (lambda: sweep({"segments": [0, 15]}), "segments is 0", "[1, 1000]"),
    (lambda: sweep({"beam_factor": [2.5]}), "beam factor is 2.5", "3 (as printed) or 2 (derived)"),
    (lambda: sweep({"muscle.strands": [23.3]}),
     "muscle.strands is 23.3", "a whole number in [2, 10000]"),
    (lambda: sweep({"muscle.braid_angle": [2.0]}),
     "muscle.braid angle is 2", "[0.0872665, 1.48353]"),
    (lambda: sweep({"muscles": [(1, 2)]}), "muscles is (1, 2)", "1 to 12 PlacedMuscle"),
    (lambda: optimise(bounds={"offset": (3.0, 4.0)}, segments=3),
     "values of segments is 3", "give a sequence of values"),
    (lambda: optimise(bounds={"offset": (3.0, 4.0)}, segments="12"),
     "values of segments is '12'", "give a sequence of values"),
    (lambda: optimise(bounds={"offset": (3.0, 4.0)}, segments=[2000]),
     "segments is 2000", "[1, 1000]"),
    (lambda: optimise(bounds={"offset": (3.0, 4.0)}, segments=[0]), "segments is 0", "[1, 1000]"),
    (lambda: optimise(bounds={"offset": (3.0, 4.0)}, segments=[]),
     "values of segments is", "give 1 or more"),
    (lambda: optimise(bounds={}), "there are 0 parameters to optimise", "give 1 to 4"),
    (lambda: optimise(bounds=dict.fromkeys("abcde", (1.0, 2.0)), grid=2),
     "there are 5 parameters to optimise", "give 1 to 4"),
    (lambda: optimise(bounds=None), "bounds is None", "map names to (low, high)"),
    (lambda: optimise(bounds={"pressure_limit": (0.1, 0.8)}),
     "parameter 'pressure_limit' does not change the p", "it cannot be in bounds"),
    (lambda: optimise(bounds={"offset": (0.0, 0.8)}), "offset is 0 mm", "[0.001, 1000] mm"),
    (lambda: optimise(bounds={"angles": (0.0, 1.0)}),
     "parameter 'angles' has no range of numbers", "it cannot be in bounds"),
    (lambda: optimise(bounds={"offset": (4.0, 3.0)}), "upper bound of offset is 3", "(4, inf)"),
    (lambda: optimise(bounds={"offset": 3.0}),
     "bounds of offset is 3.0", "give two numbers (low, high)"),
    (lambda: optimise(bounds={"colour": (0.0, 1.0)}),
     "there is no parameter 'colour'",
     "give one such as 'offset'; legal are a field of EffectorDesi"),
    (lambda: optimise(bounds=dict.fromkeys(("offset", "length", "holder_length", "x"), (1.0, 2.0))),
     "there is no parameter 'x'", "give one such as 'offset'; legal are a field of EffectorDesi"),
    (lambda: optimise(bounds=RANGES, grid=50),
     "grid is 50", "with 3 parameters it must lie in [2, 21]"),
    (lambda: package.find_resultant([0.0, 2.0], [1.0, -1.0]), "force is -1 N", "[0, inf) N"),
    (lambda: package.find_resultant([0.0, 2.0], [1.0, 1.0, 1.0]),
     "forces has shape (3,)", "(..., 2)"),
    (lambda: package.find_resultant([[1.0]], [1.0]), "angles has shape (1, 1)", "(m,)"),
    (lambda: package.rigidity_from_test(0.0, 15.0, length=45.0), "force is 0 N", "(0, 1e+06] N"),
    (lambda: package.rigidity_from_test(0.1, -1.0, length=45.0),
     "deflection is -1 mm", "(0, 10000] mm"),
    (lambda: package.rigidity_from_test(0.1, 15.0, length=math.nan),
     "length is nan mm", "(0, 10000] mm"),
    (lambda: DESIGN.replace(offset=-1.0), "offset is -1 mm", "[0.001, 1000] mm"),
    (lambda: DESIGN.replace(offset=math.nan), "offset is nan mm", "[0.001, 1000] mm"),
    (lambda: DESIGN.replace(segments=2.5), "segments is 2.5", "a whole number in [1, 1000]"),
    (lambda: DESIGN.replace(segments=0), "segments is 0", "[1, 1000]"),
    (lambda: DESIGN.replace(beam_factor=2.5),
     "beam factor is 2.5", "3 (as printed) or 2 (derived)"),
    (lambda: DESIGN.replace(flexural_rigidity=0.0),
     "flexural rigidity is 0 N mm^2", "[1e-06, 1e+12] N mm^2"),
    (lambda: DESIGN.replace(catheter_rigidity=-1.0),
     "catheter rigidity is -1 N mm^2", "[0, 1e+12] N mm^2"),
    (lambda: DESIGN.replace(pressure_limit=11.0), "pressure limit is 11 MPa", "[1e-06, 10] MPa"),
    (lambda: DESIGN.replace(backbone_length=50.0),
     "muscle R is 45 mm long", "as long as the backbone, 50 mm (EffectorDesign.resize changes"),
    (lambda: DESIGN.replace(muscles=()), "muscles is ()", "1 to 12 PlacedMuscle"),
    (lambda: DESIGN.replace(muscles=3), "muscles is 3", "1 to 12 PlacedMuscle"),
    (lambda: effector_preset("prototype", colour=1),
     "an effector has no field 'colour'",
     "its fields are ['muscles', 'offset', 'backbone_length',"),
    (lambda: package.balance(EFFECTOR, "X", pressure=0.1),
     "there is no muscle 'X'", "choose one of R, G, B"),
    (lambda: package.balance(EFFECTOR, "R", pressure=0.9),
     "pressure of muscle R is 0.9 MPa", "[0, 0.827] MPa"),
    (lambda: package.balance(EFFECTOR, "R", pressure=[0.1, -0.1]),
     "pressure of muscle R is -0.1 MPa", "[0, 0.827] MPa"),
    (lambda: package.balance(EFFECTOR, "R", pressure=math.nan),
     "pressure of muscle R is nan MPa", "[0, 0.827] MPa"),
    (lambda: package.balance(EFFECTOR, "R", pressure="much"),
     "pressure of muscle R is 'much'", "a number or an array of numbers"),
    (lambda: package.balance(EFFECTOR, "R", pressure=0.1, method="newton"),
     "method is 'newton'", "one of root, fixed-point"),
    (lambda: package.balance(EFFECTOR, "R", pressure=0.1, method="fixed-point", tolerance=0.0),
     "tolerance is 0 mm", "(0, 1000] mm"),
    (lambda: Effector(DESIGN, 3), "model is 3", "a class or a function"),
    (lambda: Effector(DESIGN, lambda muscle: 3), "model gives a int", "a MuscleModel"),
    (lambda: Effector("prototype"), "design is a str", "an EffectorDesign"),
    (lambda: package.pose(EFFECTOR, [0.1, 0.1]),
     "pressures has shape (2,)", "(..., 3), one for each of ['R', 'G', 'B']"),
    (lambda: package.pose(EFFECTOR, 0.1),
     "pressures has shape ()", "(..., 3), one for each of ['R', 'G', 'B']"),
    (lambda: package.pose(EFFECTOR, [0.1, 0.9, 0.1]),
     "pressure of muscle G is 0.9 MPa", "[0, 0.827] MPa"),
    (lambda: package.pose(EFFECTOR, [[0.0, 0.0, 0.0], [0.0, 0.0, math.nan]]),
     "pressure of muscle B is nan MPa", "[0, 0.827] MPa"),
    (lambda: package.pose(EFFECTOR, {"R": -0.1}),
     "pressure of muscle R is -0.1 MPa", "[0, 0.827] MPa"),
    (lambda: package.pose(EFFECTOR, {"X": 0.1}),
     "there is no muscle 'X'", "choose one of R, G, B"),
    (lambda: package.pose(EFFECTOR, {"R": [0.1, 0.2], "G": [0.1, 0.2, 0.3]}),
     "pressures is {'R'", "[0.1, 0.2], 'G': [0.1, 0.2, 0.3]}: it must be an array (...,"),
    (lambda: package.pose(EFFECTOR, "R"), "pressures is 'R'", "a number or an array of numbers"),
    (lambda: package.pose(EFFECTOR, [0.0, 0.0, 0.0], method="sum"),
     "method is 'sum'", "one of superposition, thesis"),
    (lambda: package.solve_inverse(EFFECTOR, [1.0, 2.0, 3.0]), "target has shape (3,)", "(..., 2)"),
    (lambda: package.solve_inverse(EFFECTOR, [1.0, math.inf]),
     "target has 1 point(s) that are not finite (NaN or infinite)", ""),
    (lambda: package.steer(EFFECTOR, [600, 600], stick=3), "stick is 3", "a Stick"),
    (lambda: package.steer(EFFECTOR, [600, 600], cubics=3),
     "cubics is 3", "a mapping from names to CubicFit"),
    (lambda: package.steer(EFFECTOR, [600, 600], cubics={}),
     "muscle R has no cubic", "there are some for none"),
    (lambda: package.steer(EFFECTOR, [600, 600], cubics={**CUBICS, "R": None}),
     "muscle R has no cubic", "there are some for R, G, B"),
    (lambda: package.steer(EFFECTOR, [600, 600], cubics={**CUBICS, "R": 3}),
     "cubic of muscle R is 3", "a CubicFit"),
    (lambda: package.steer(EFFECTOR, [600, 600], cubics={**CUBICS, "R": CUBICS["G"]}),
     "cubic of muscle R is that of G", "fit one to each"),
    (lambda: package.steer(NARROW, [600, 600], cubics=CUBICS),
     "cubic of muscle R was fitted to 14.3461 mm at 0.827 MPa",
     "here it is 14.8375 mm, so it is that of another design"),
    (lambda: package.steer(WEAK, [600, 600], cubics=CUBICS),
     "cubic of muscle R goes up to 0.827 MPa",
     "this design's limit is 0.5 MPa, so it was fitted to another"),
    (lambda: package.trace_path(NARROW, [[1.0, 1.0]], cubics=CUBICS),
     "cubic of muscle R was fitted to 14.3461 mm at 0.827 MPa",
     "here it is 14.8375 mm, so it is that of another design"),
    (lambda: package.trace_path(WEAK, [[1.0, 1.0]], cubics=CUBICS),
     "cubic of muscle R goes up to 0.827 MPa",
     "this design's limit is 0.5 MPa, so it was fitted to another"),
    (lambda: change({"length": 50.0, "backbone_length": 50.0}),
     "'length' and 'backbone_length' are both given", "give one of them"),
    (lambda: change({"angles": [1.0]}),
     "angles has 1 value(s)", "give 3, one for each of the muscles R, G, B"),
    (lambda: change({"angles": 3.0}), "angles is 3.0", "give 3 numbers in rad"),
    (lambda: change({"colour": 1}),
     "there is no parameter 'colour'", "give one such as 'offset'; legal are a field of"),
    (lambda: change({"muscle.colour": 1}),
     "there is no parameter 'muscle.colour'",
     "did you mean 'muscle.modulus'; legal are a field of"),
    (lambda: change({"length": None}), "muscle length is None", "a number in [0.001, 10000] mm"),
    (lambda: change({"angles": None}), "angles is None", "give 3 numbers in rad"),
    (lambda: change({"muscles": (1, 2)}), "muscles is (1, 2)", "1 to 12 PlacedMuscle"),
    (lambda: change(None), "changes is None", "a mapping from names to values"),
]
# fmt: on
"""What is asked, the field that the message names, and what it says to be legal."""


@pytest.mark.parametrize(("call", "field", "legal"), REFUSALS)
def test_refused(call: Callable[[], object], field: str, legal: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    line = str(caught.value)
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 300


def test_whole_floats_are_whole_numbers():
    assert len(package.trace_circle(EFFECTOR, 1.0, steps=12.0).targets) == 13
    assert len(package.trace_line(EFFECTOR, [0, 0], end=[1, 1], steps=5.0).targets) == 5
    assert len(package.fit_cubic(EFFECTOR, "R", start=0.1, samples=20.0).pressure) == 20
    one, two = (package.workspace(EFFECTOR, directions=n, samples=n) for n in (24.0, 24))
    assert np.array_equal(one.boundary, two.boundary)
    found = package.optimise_design(EFFECTOR, 12.0, bounds={"offset": (3.0, 4.0)}, grid=2.0)
    assert found.converged


def test_results_are_built_by_keyword_only():
    for result in (
        package.LinkageBend,
        package.Peak,
        package.Balance,
        package.EffectorPose,
        package.TipForce,
    ):
        with pytest.raises(TypeError, match="positional argument"):
            result(1.0)
