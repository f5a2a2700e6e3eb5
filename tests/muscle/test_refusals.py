"""Refusals of muscles, fits and hysteresis: one clear line with the field and what is legal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.muscle import (
    MODELS,
    Braid,
    EnergyMuscle,
    FitOptions,
    Measurements,
    Muscle,
    RankOptions,
    ThesisMuscle,
    Tube,
    calibrate,
    compare_models,
    preset,
    rank,
    take_measurements,
)
from bozzini.muscle.hysteresis import (
    AsymmetricPrandtlIshlinskii,
    BoucWen,
    FrictionBand,
    HysteresisState,
    LoopOptions,
    MaxwellSlip,
    PrandtlIshlinskii,
    Preisach,
    PreisachForce,
    UnparallelPrandtlIshlinskii,
)
from bozzini.muscle.ranking import compute_aicc, compute_bic, weigh_models
from tests.muscle.hysteresis.reference import OPERATORS

BRAID = Braid(length=45.0, radius=0.59, angle=math.radians(36.0))
TUBE = Tube(length=45.0, inner_radius=0.25, outer_radius=0.55, modulus=0.35)
BLOWN = TUBE.deform([0.1, 0.2])
MUSCLE = preset("effector-45")
ENERGY, THESIS = EnergyMuscle(MUSCLE), ThesisMuscle(MUSCLE)
BULK = ThesisMuscle(MUSCLE, load_path="bulk")
STRETCHY = preset("thesis-45", modulus=1e-3, poisson_ratio=0.0)
PRESSURE = np.linspace(0.1, 0.8, 12)
DATA = Measurements(pressure=PRESSURE, contraction=ENERGY.contraction(PRESSURE))
SLIPS = OPERATORS["slips"]
RELAYS = Preisach((0.0, 0.5, 1.0), (1.0, 1.0, 1.0))
UNPARALLEL = UnparallelPrandtlIshlinskii((0.0, 0.1), (1.0, 0.5), (1.0, 1.0), (1.0, 0.9))
WALL = {"length": 45.0, "inner_radius": 0.25, "outer_radius": 0.55, "modulus": 0.35}
PULL = {"length": 1.0, "coefficients": (1.0,) * 5, "scale": 0.0, "relays": RELAYS}
LOOP = {"slope": 1.0, "alpha": 1.0, "beta": 1.0, "gamma": 0.0}


def braid(**changes: Any) -> object:
    return Braid(**{"length": 45.0, "radius": 0.59, "angle": 0.6, **changes})


def tube(**changes: Any) -> object:
    return Tube(**{**WALL, **changes})


def fit(free: Any = None, **options: Any) -> object:
    return calibrate(EnergyMuscle, MUSCLE, data=DATA, free=free, options=FitOptions(**options))


def order(models: Any = MODELS.own, **options: Any) -> object:
    fit = FitOptions(seed=options.pop("seed", 0))
    return rank(DATA, MUSCLE, models=models, options=RankOptions(**options, fit=fit))


def table(**columns: Any) -> object:
    return Measurements(**{"pressure": [0.1], "contraction": [1.0], **columns})


def compare(least: float = 1.0, models: Any = None, **rest: Any) -> object:
    models = {"energy": ENERGY} if models is None else models
    return compare_models(models, Measurements(pressure=[0.1], contraction=[least]), **rest)


def loops(history: Any = (0.0, 1.0), response: Any = (0.0, 1.0), **options: Any) -> object:
    return PrandtlIshlinskii.identify(history, response, **options)


def remember(name: str, memory: tuple[float, ...]) -> object:
    return OPERATORS[name].run([0.1], initial=HysteresisState(0.0, memory))


# fmt: off
REFUSALS: list[tuple[Callable[[], object], str, str]] = [
    (lambda: ENERGY.contraction(700), "pressure is 700 MPa", "[0, 20] MPa; is it in kPa?"),
    (lambda: MODELS["chou"](MUSCLE).contraction(700), "pressure is 700 MPa", "[0, 20] MPa"),
    (lambda: MODELS["chou"]("effector-45"), "muscle is 'effector-45'", "preset('effector-45')"),
    (lambda: MODELS["chou"](None), "muscle is None", "it must be a Muscle"),
    (lambda: EnergyMuscle("thesis-45"), "muscle is 'thesis-45'", "preset('thesis-45')"),
    (lambda: ThesisMuscle(45.0), "muscle is 45.0", "it must be a Muscle"),
    (lambda: calibrate(EnergyMuscle, "thesis-45", data=DATA),
     "muscle is 'thesis-45'", "preset('thesis-45')"),
    (lambda: rank(DATA, MUSCLE, models="energy"), "models is 'energy'", "a sequence of names"),
    (lambda: rank(DATA, MUSCLE, models=ENERGY), "models is EnergyMuscle", "a sequence of names"),
    (lambda: rank(DATA, MUSCLE, models=["energy", "enemy"]), "model is 'enemy'", "a name in"),
    (lambda: rank(DATA, MUSCLE, models=[EnergyMuscle]), "model is <class", "a name in"),
    (lambda: rank(DATA, MUSCLE, models={"mine": ENERGY}),
     "the model 'mine' is EnergyMuscle", "a class of muscle models"),
    (lambda: rank(DATA, MUSCLE, models={"mine": dict}),
     "the model 'mine' is <class 'dict'>", "a class of muscle models"),
    (lambda: ENERGY.plot_contraction("0.7MPa"), "pressure is '0.7MPa'", "a number in (0, inf) MPa"),
    (lambda: ENERGY.plot_contraction(0.7, lowest=0.9), "lowest is 0.9 MPa", "[0, 0.7] MPa"),
    (lambda: ENERGY.plot_force("0.7MPa"), "pressure is '0.7MPa'", "a number in (0, inf) MPa"),
    (lambda: braid(length=0.0), "braid length is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: braid(length=1e308), "braid length is 1e+308 mm", "[1e-06, 1e+06] mm"),
    (lambda: braid(length="45"), "braid length is '45'", "a number in [1e-06, 1e+06] mm"),
    (lambda: braid(radius=1e-308), "braid radius is 1e-308 mm", "[1e-06, 1e+06] mm"),
    (lambda: braid(radius=-1.0), "braid radius is -1 mm", "[1e-06, 1e+06] mm"),
    (lambda: braid(angle=1.5), "braid angle is 1.5 rad", "[0.0872665, 1.48353] rad"),
    (lambda: braid(angle=math.nan), "braid angle is nan rad", "[0.0872665, 1.48353] rad"),
    (lambda: BRAID.radius_at([50.0, 60.0]),
     "braid length[1] is 60 mm", "[0, 55.6231] mm, the length of a strand"),
    (lambda: BRAID.length_at([1.0, 2.0]), "braid angle[1] is 2 rad", "[0, 1.5708] rad"),
    (lambda: BRAID.ideal_force(0.1, math.nan),
     "braid length is nan mm", "[0, 55.6231] mm, the length of a strand"),
    (lambda: BRAID.ideal_force(math.nan, [40.0, 41.0]), "pressure is nan MPa", "[0, 20] MPa"),
    (lambda: BRAID.ideal_force("high", [40.0, 41.0]),
     "pressure is 'high'", "a number or an array of numbers"),
    (lambda: BRAID.ideal_force([0.1, 0.2, 0.3], [40.0, 41.0]),
     "these shapes do not go together", "pressure (3,), braid length (2,)"),
    (lambda: tube(inner_radius=0.0), "tube inner radius is 0 mm", "[1e-06, 1e+06] mm"),
    (lambda: tube(outer_radius=0.2), "tube outer radius is 0.2 mm", "[0.250025, 1e+06] mm"),
    (lambda: tube(outer_radius=0.25), "tube outer radius is 0.25 mm", "[0.250025, 1e+06] mm"),
    (lambda: tube(length=1e308), "tube length is 1e+308 mm", "[1e-06, 1e+06] mm"),
    (lambda: tube(poisson_ratio=0.5), "Poisson's ratio is 0.5", "[0, 0.499999]"),
    (lambda: tube(modulus=math.inf), "tube modulus is inf MPa", "[1e-12, 1e+06] MPa"),
    (lambda: TUBE.deform(math.nan), "inner pressure is nan MPa", "[-1e+06, 1e+06] MPa"),
    (lambda: TUBE.deform(math.inf), "inner pressure is inf MPa", "[-1e+06, 1e+06] MPa"),
    (lambda: TUBE.deform("high"), "inner pressure is 'high'", "a number or an array of numbers"),
    (lambda: TUBE.deform(0.1, end_stress=math.nan), "end stress is nan MPa", "[-1e+06, 1e+06] MPa"),
    (lambda: TUBE.deform([0.1, 0.2], outer_pressure=[0.0, 0.1, 0.2]),
     "these shapes do not go together",
     "inner pressure (2,), outer pressure (3,), end stress (2,)"),
    (lambda: BLOWN.radial_displacement(0.0), "radius is 0 mm", "[0.25, 0.55] mm"),
    (lambda: BLOWN.radial_displacement(0.24), "radius is 0.24 mm", "[0.25, 0.55] mm"),
    (lambda: BLOWN.radial_displacement(math.nan), "radius is nan mm", "[0.25, 0.55] mm"),
    (lambda: BLOWN.radial_displacement([0.3, 0.4, 0.5]),
     "these shapes do not go together", "radius (3,), c1 (2,), c2 (2,), c3 (2,)"),
    (lambda: BLOWN.stresses(0.0), "radius is 0 mm", "[0.25, 0.55] mm"),
    (lambda: BLOWN.stresses(0.56), "radius is 0.56 mm", "[0.25, 0.55] mm"),
    (lambda: BLOWN.stresses([0.3, 0.4, 0.5]),
     "these shapes do not go together", "radius (3,), c1 (2,), c2 (2,), c3 (2,)"),
    (lambda: Muscle(length=45.0, outer_radius="wide"),
     "muscle outer radius is 'wide'", "a number in [0.001, 1000] mm"),
    (lambda: Muscle(length=45.0, outer_radius="0.55"),
     "muscle outer radius is '0.55'", "a number in [0.001, 1000] mm"),
    (lambda: Muscle(length=45.0, outer_radius=b"0.55"),
     "muscle outer radius is b'0.55'", "a number in [0.001, 1000] mm"),
    (lambda: Muscle(length=45.0, outer_radius=True),
     "muscle outer radius is True", "a number in [0.001, 1000] mm"),
    (lambda: Muscle(length=45.0, outer_radius=0.55j),
     "muscle outer radius is 0.55j", "a number in [0.001, 1000] mm"),
    (lambda: Muscle(length=45.0, outer_radius=None),
     "muscle outer radius is None", "a number in [0.001, 1000] mm"),
    (lambda: Muscle(length=45.0, outer_radius=[0.55]),
     "muscle outer radius is [0.55]", "a number in [0.001, 1000] mm"),
    (lambda: MUSCLE.replace(lenght=40.0),
     "a muscle has no field 'lenght'",
     "its fields are ['length', 'outer_radius', 'inner_radius', 'b"),
    (lambda: MUSCLE.legal_range("strands"),
     "field is 'strands'",
     "one of length, outer_radius, inner_radius, br"),
    (lambda: preset("thesis"),
     "there is no muscle preset 'thesis'",
     "choose one of thesis-40"),
    (lambda: compute_aicc(0.0, 10, 1), "sum of squares is 0", "(0, inf)"),
    (lambda: compute_aicc(math.nan, 10, 1), "sum of squares is nan", "(0, inf)"),
    (lambda: compute_aicc(1.0, 4, 2), "number of rows is 4", "[5, inf]"),
    (lambda: compute_aicc(1.0, 10, -1), "number of fitted parameters is -1", "[0, inf]"),
    (lambda: compute_bic(1.0, 0, 0), "number of rows is 0", "[1, inf]"),
    (lambda: weigh_models([]), "there are 0 models to weigh", "give 1 or more"),
    (lambda: compare(models={}), "there are 0 models to compare", "give 1 or more"),
    (lambda: compare(0.0),
     "the largest contraction is 0 mm", "0.001 mm or more, since errors are percentages of it"),
    (lambda: compare(1e-300),
     "the largest contraction is 1e-300 mm",
     "0.001 mm or more, since errors are percentages of it"),
    (lambda: compare(9e-4),
     "the largest contraction is 0.0009 mm",
     "0.001 mm or more, since errors are percentages of it"),
    (lambda: compare(fitted={"thesis": 1}),
     "parameters are fitted in 'thesis'", "the models are energy"),
    (lambda: compare(fitted={"energy": 13}),
     "number of parameters fitted in energy is 13", "[0, 0]"),
    (lambda: THESIS.contraction(0.5, [0.0, 0.5]),
     "load[1] is 0.5 N", "0 N, the thesis's equations have no response to a load (the"),
    (lambda: THESIS.force(0.5, 1.0),
     "load path is 'none'", "the thesis's equations have no response to a load, so no for"),
    (lambda: THESIS.stiffness(0.5, 1.0),
     "load path is 'none'", "the thesis's equations have no response to a load, so no for"),
    (lambda: THESIS.free_contraction(11.0), "pressure is 11 MPa", "[0, 10] MPa"),
    (lambda: ThesisMuscle(MUSCLE, load_path="share"),
     "load path is 'share'", "one of none, bulk"),
    (lambda: ThesisMuscle(MUSCLE.replace(strand_radius=0.09)),
     "muscle strand radius is 0.09 mm", "(0, 0.0785398] mm for the contact area of eq. (3.22)"),
    (lambda: ThesisMuscle(MUSCLE.replace(poisson_ratio=0.0), load_path="bulk"),
     "Poisson's ratio is 0", "with the load path 'bulk' it must lie in [0.01, 0.499999]"),
    (lambda: BULK.contraction(0.5, 90.0),
     "load is 90 N", "at a pressure of 0.5 MPa it must lie in [0, 35.4759] N, at w"),
    (lambda: BULK.force(0.5, 30.0), "contraction is 30 mm", "[-10.6231, 17.1885] mm"),
    (lambda: ThesisMuscle(STRETCHY).free_contraction(10.0),
     "pressure is 10 MPa", "above which the thesis's equations have no answer"),
    (lambda: fit(()), "no parameter is free", "name one or more"),
    (lambda: fit(("colour",)),
     "parameter 'colour' is not known",
     "use outer_radius, inner_radius, braid_angle, gap, dead_length"),
    (lambda: fit(("strands",)),
     "parameter 'strands' is not known",
     "use outer_radius, inner_radius, braid_angle, gap, dead_length"),
    (lambda: fit(("modulus", "length")),
     "parameter 'length' is not known",
     "use outer_radius, inner_radius, braid_angle, gap, dead_length"),
    (lambda: fit(("strand_modulus",)), "strand_modulus has", "it cannot be fitted"),
    (lambda: fit(("friction_length",)), "friction_length has", "it cannot be fitted"),
    (lambda: fit(bounds={"gap": (0.0, 0.1)}),
     "bounds are given for gap", "the free ones are modulus, dead_length"),
    (lambda: fit(bounds={"modulus": (1.0, 0.5)}),
     "upper bound of modulus is 0.5 MPa", "(1, 1000] MPa"),
    (lambda: fit(bounds={"modulus": 3.0}), "bounds of modulus is 3.0", "a pair (low, high)"),
    (lambda: fit(bounds={"modulus": None}), "bounds of modulus is None", "a pair (low, high)"),
    (lambda: fit(bounds={"modulus": (0.1, 0.5, 1.0)}),
     "bounds of modulus is (0.1, 0.5, 1.0)", "a pair (low, high)"),
    (lambda: fit(bounds={"modulus": ("0.1", 0.5)}),
     "lower bound of modulus is '0.1'", "a number in [1e-09, 1000] MPa"),
    (lambda: fit(bounds={"modulus": (math.nan, 0.5)}),
     "lower bound of modulus is nan MPa", "[1e-09, 1000] MPa"),
    (lambda: fit(bounds={"dead_length": (-5.0, 60.0)}),
     "lower bound of dead_length is -5 mm", "[0, 44.55] mm"),
    (lambda: fit(bounds={"dead_length": (0.0, 60.0)}),
     "upper bound of dead_length is 60 mm", "(0, 44.55] mm"),
    (lambda: fit(bounds=[("modulus", (0.1, 0.5))]),
     "bounds must be a mapping from names to pairs", "a list"),
    (lambda: order({}), "there are 0 models to rank", "give 1 or more"),
    (lambda: order(criterion="best"), "criterion is 'best'", "one of aicc, bic, cv"),
    (lambda: order(folds=1), "folds is 1", "2 or more, or 0 for no cross-validation"),
    (lambda: order(folds=-1), "folds is -1", "[0, inf]"),
    (lambda: order(folds=99), "folds is 99", "there are 12 different state(s) to deal"),
    (lambda: order(folds=0, criterion="cv"),
     "folds is 0", "to rank by the rows left out it must be 2 or more"),
    (lambda: order(seed=-1), "seed is -1", "[0, inf]"),
    (lambda: take_measurements([0.1, 1.0]), "data is a list", "Measurements or a DataFrame"),
    (lambda: table(pressure=[], contraction=[]),
     "the measurements have 0 rows", "there must be 1 or more"),
    (lambda: table(contraction=[1.0, 2.0]),
     "contraction has shape (2,)", "(1,), one for each pressure"),
    (lambda: table(pressure=[0.1, -0.1], contraction=[1.0, 2.0]),
     "row 2", "pressure is -0.1 MPa: it must lie in [0, 20] MPa"),
    (lambda: table(contraction=[math.nan]),
     "row 1", "contraction is nan mm: it must lie in (-inf, inf) mm"),
    (lambda: table(direction="up"),
     "row 1", "direction is 'up': it must be inflating, deflating or empty"),
    (lambda: table(load=-2e6), "row 1", "load is -2e+06 N: it must lie in [-1e+06, 1e+06] N"),
    (lambda: table(errors={"load": 0.0}), "row 1", "load error is 0 N: it must lie in (0, inf) N"),
    (lambda: table(errors={"length": 1.0}), "a name in errors is 'length'", "pressure, con"),
    (lambda: table(geometry={"width": 1.0}), "a name in geometry is 'width'", "one of length, "),
    (lambda: table(pressure=[0.1] * 2, contraction=[1.0] * 2, geometry={"length": [83.0, 84.0]}),
     "row 2: rest length is 84 mm", "it must be 83 mm, as in row 1"),
    (lambda: table(specimen="a\nb"),
     "row 1", "specimen is 'a\\nb': it must be text without control characte"),
    (lambda: table(specimen="\ud800"),
     "row 1", "specimen is '\\ud800': it must be text without control charac"),
    (lambda: table(numbers=[1, 2]), "numbers has shape (2,)", "(1,), one for each pressure"),
    (lambda: table(pressure=0.1), "pressure has shape ()", "(n,)"),
    (lambda: table(pressure=["x"]), "pressure is ['x']", "a number or an array of numbers"),
    (lambda: loops((0.0, 1.0), (0.0,)), "response has shape (1,)", "(2,)"),
    (lambda: loops((1.0, 1.0)), "history is 1 all along", "change"),
    (lambda: loops((), ()), "history has shape (0,)", "have at least 2 samples"),
    (lambda: loops((0.0, 1.0), (0.0, math.nan)), "response[1] is nan", "[-1e+12, 1e+12]"),
    (lambda: loops(options=LoopOptions(skip=1)), "skip is 1", "[0, 0]"),
    (lambda: loops(count=0), "count is 0", "[1, 200]"),
    (lambda: loops(thresholds=(0.1, 0.1)), "thresholds[1] is 0.1", "above 0.1, the one before it"),
    (lambda: MaxwellSlip.identify([0.0, 1.0, 0.0], [0.0, -1.0, 0.0]),
     "response does not resist the history anywhere", "stiffnesses of 0 fit it best"),
    (lambda: UnparallelPrandtlIshlinskii.identify([0.0, 1.0], [0.0, 1.0], thresholds=(0.0,)),
     "thresholds is [0.0]", "have one above 0"),
    (lambda: BoucWen.identify([0.0, 1.0], [0.0, 1.0], exponent=0.5), "exponent is 0.5", "[1, 20]"),
    (lambda: BoucWen(**(LOOP | {"gamma": -1.0})),
     "beta + gamma is 0", "above 0.001 for h to be bounded"),
    (lambda: BoucWen(**(LOOP | {"gamma": -0.9999})),
     "beta + gamma is 0.0001", "above 0.001 for h to be bounded"),
    (lambda: BoucWen(**(LOOP | {"alpha": 0.0})), "alpha is 0", "(0, 1e+12]"),
    (lambda: BoucWen(**LOOP, exponent=0.5), "exponent is 0.5", "[1, 20]"),
    (lambda: BoucWen(**(LOOP | {"slope": math.nan})), "slope is nan", "[-1e+12, 1e+12]"),
    (lambda: BoucWen(**(LOOP | {"alpha": 1e-320, "beta": 1e12})),
     "alpha / (beta + gamma) is 0", "with an exponent of 1 the bound of h is not a number that ca"),
    (lambda: BoucWen(**LOOP).run([0.0], initial=HysteresisState(0.0, (2.0,))),
     "memory[0] of the initial state is 2", "[-1, 1]"),
    (lambda: MaxwellSlip.from_virgin_curve([1.0, 2.0], [1.0, 3.0]),
     "outputs[0] is 1", "the slope there goes from 1 to 2, and must fall"),
    (lambda: MaxwellSlip.from_virgin_curve([0.0, 2.0], [1.0, 3.0]), "inputs[0] is 0", "(0, 1e+12]"),
    (lambda: MaxwellSlip((1.0,), (0.0,)), "limits[0] is 0", "(0, 1e+12]"),
    (lambda: MaxwellSlip((1.0, 2.0), (1.0,)), "limits has 1 number(s)", "have 2, as stiffnesses"),
    (lambda: MaxwellSlip((1.0,), (1.0,)).to_plays(slope=math.nan),
     "slope is nan", "[-1e+12, 1e+12]"),
    (lambda: SLIPS.apply(0.3), "history is a single number", "an array of shape (..., n)"),
    (lambda: SLIPS.apply([0.0, math.nan]), "history[1] is nan", "[-1e+12, 1e+12]"),
    (lambda: SLIPS.apply([[0.0], [math.inf]]), "history[1, 0] is inf", "[-1e+12, 1e+12]"),
    (lambda: SLIPS.apply(["a"]), "history is ['a']", "a number or an array of numbers"),
    (lambda: SLIPS.run([0.0], initial=0.0), "initial is a float", "a HysteresisState"),
    (lambda: SLIPS.run([0.0], initial=OPERATORS["bouc-wen"].rest()),
     "initial has last () and memory (1,)",
     "for these histories it needs () and (3,), or () and (3,)"),
    (lambda: SLIPS.run(np.zeros((2, 4)), initial=SLIPS.rest((3,))),
     "initial has last (3,) and memory (3, 3)",
     "for these histories it needs (2,) and (2, 3), or () and (3,)"),
    (lambda: HysteresisState(np.zeros(2), np.zeros(2)),
     "memory of the state has shape (2,)", "with last of shape (2,) it must be (2, 'k')"),
    (lambda: HysteresisState(math.nan, np.zeros(2)), "last of the state must be finite", ""),
    (lambda: remember("slips", (0.0, 0.0, 0.3)),
     "memory[2] of the initial state is 0.3", "[-0.2, 0.2]"),
    (lambda: remember("bouc-wen", (9.0,)),
     "memory[0] of the initial state is 9", "[-0.369932, 0.369932]"),
    (lambda: remember("band", (0.5,)), "memory[0] of the initial state is 0.5", "-1, 0 or 1"),
    (lambda: remember("relays", (0.5,) * 36),
     "memory of the initial state has",
     "relays are -1 or +1, +1 from the level at which they turn on"),
    (lambda: remember("relays", (1.0,) * 36),
     "memory of the initial state has",
     "relays are -1 or +1, +1 from the level at which they turn on"),
    (lambda: PrandtlIshlinskii((), ()), "thresholds is empty", "have at least one number"),
    (lambda: PrandtlIshlinskii((0.0, 0.0), (1.0, 1.0)),
     "thresholds[1] is 0", "above 0, the one before it"),
    (lambda: PrandtlIshlinskii((-1.0,), (1.0,)), "thresholds[0] is -1", "[0, 1e+12]"),
    (lambda: PrandtlIshlinskii((0.0,), (1.0, 2.0)),
     "weights has 2 number(s)", "have 1, as thresholds"),
    (lambda: PrandtlIshlinskii((0.0,), (math.nan,)), "weights[0] is nan", "[-1e+12, 1e+12]"),
    (lambda: PrandtlIshlinskii(0.3, (1.0,)), "thresholds is 0.3", "a sequence of numbers"),
    (lambda: PrandtlIshlinskii((0.0,), (1.0,)).invert_state(HysteresisState(0.0, (0.0, 0.0))),
     "initial has last () and memory (2,)",
     "for these histories it needs () and (1,), or () and (1,)"),
    (lambda: PrandtlIshlinskii((0.1,), (1.0,)).invert(),
     "thresholds[0] is 0.1", "for an inverse it must be 0, or small changes of the input a"),
    (lambda: PrandtlIshlinskii((0.0, 0.1, 0.2), (1.0, -1.5, 3.0)).invert(),
     "weights[0] to weights[1] add up to -0.5", "for an inverse it must be above 0"),
    (lambda: Preisach((0.0, 0.5, 1.0), (1.0, 1.0)),
     "weights has 2 number(s)", "with 3 levels it must have 3"),
    (lambda: Preisach((0.0,), (1.0,)), "levels has 1 number(s)", "have 2 to 201"),
    (lambda: Preisach((0.0, -1.0), (1.0,)), "levels[1] is -1", "above 0, the one before it"),
    (lambda: PreisachForce(**PULL).force(0.2, [0.1, 0.0]), "strain[1] is 0", "(0, 1]"),
    (lambda: PreisachForce(**PULL).force(-1.0, [0.1]), "pressure is -1 MPa", "[0, 1e+12] MPa"),
    (lambda: PreisachForce(**PULL).force([0.1, 0.2], [0.1, 0.2, 0.3]),
     "these shapes do not go together", "pressure (2,), strain (3,)"),
    (lambda: PreisachForce(**(PULL | {"coefficients": (1.0,)})),
     "coefficients has 1 number(s)", "have 5"),
    (lambda: PreisachForce(**(PULL | {"relays": FrictionBand(0.0)})),
     "relays is a FrictionBand", "a Preisach"),
    (lambda: PreisachForce(**(PULL | {"length": 0.0})), "length is 0 mm", "(0, 1e+06] mm"),
    (lambda: AsymmetricPrandtlIshlinskii(0.5, (0.1,), (0.3,), (0.3,)).invert_history(
        [0.0], between=(0.0, 1.0)),
     "this operator has no inverse for certain",
     "its slope is at least -0.1, from the plays that never stick:"),
    (lambda: UnparallelPrandtlIshlinskii((0.1,), (1.0,), (1.0,), (1.0,)).invert_history(
        [0], between=(0.0, 1.0)),
     "this operator has no inverse for certain",
     "its slope is at least 0, from the plays that never stick: it"),
    (lambda: UNPARALLEL.invert_history([0.0, 9.0], between=(0.0, 1.0)),
     "response[1] is 9", "between inputs of 0 and 1 it must lie in [0, 1.45]"),
    (lambda: UNPARALLEL.invert_history([0.0], between=(0.0, 0.0)), "between[1] is 0", "(0, 1e+12]"),
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
