"""Where the linkage ends before the deflection has a maximum: its slope is endless there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from bozzini.effector import (
    Effector,
    EffectorDesign,
    PlacedMuscle,
    balance,
    effector_preset,
    find_conflicts,
    find_peak,
    lateral_deflection,
    pose,
    solve_inverse,
)
from bozzini.effector.kernels.linkage import find_end, measure_lateral
from bozzini.effector.linkage import take_linkage
from bozzini.errors import GeometryError
from bozzini.muscle import EnergyMuscle, Muscle, ThesisMuscle
from bozzini.muscle import preset as muscle_preset
from tests.effector.models import SpringMuscle

PROTOTYPE = effector_preset("prototype")
HALF = PROTOTYPE.replace(offset=1.5, pressure_limit=1.5)


def place(muscle: Muscle, **fields: float) -> EffectorDesign:
    return EffectorDesign(
        muscles=(PlacedMuscle(name="M", muscle=muscle, angle=1.0),),
        backbone_length=muscle.length,
        **fields,
    )


@given(st.floats(12.0, 500.0), st.integers(1, 1000), st.floats(0.5, 1.05) | st.just(0.5))
def test_every_contraction_up_to_the_end_closes(length, segments, share):
    linkage = (share * length / segments, length, segments)
    end = find_end(linkage)
    some = [end]
    for _ in range(30):
        some.append(math.nextafter(some[-1], 0.0))
    some += (end * (1.0 - np.geomspace(1e-15, 1.0, 30, endpoint=False))).tolist()
    assert not any(measure_lateral(linkage, x)[2] for x in some if x < length)
    # No more is given up than round-off.
    past = end * (1.0 + 1e-9)
    assert end == length or measure_lateral(linkage, past)[2] > 0 or end > (1 - 1e-6) * length


def test_pressures_up_to_saturation_are_continuous():
    """Found by bisection: on either side of the edge the pose is the end of the linkage."""
    effector = Effector(HALF)
    peak = find_peak(HALF)
    assert not peak.is_maximum
    low, high = 0.1, 1.5
    while math.nextafter(low, high) < high:
        middle = 0.5 * (low + high)
        if balance(effector, "R", pressure=middle).saturated:
            high = middle
        else:
            low = middle
    spread = [low, high]
    for _ in range(200):
        spread = [math.nextafter(spread[0], 0.0), *spread, math.nextafter(spread[-1], 1.0)]
    found = balance(effector, "R", pressure=spread)
    assert np.all(found.converged | found.saturated)
    assert found.lateral == pytest.approx(np.full(402, peak.lateral), abs=1e-5)
    assert np.abs(found.residual[found.converged]).max() < 1e-8
    posed = pose(effector, {"R": spread})
    assert np.hypot(*posed.tip[:, :2].T) == pytest.approx(posed.lateral, abs=1e-9)
    pieces = np.linalg.norm(np.diff(posed.backbone, axis=1), axis=-1)
    assert pieces == pytest.approx(np.full((402, 15), 3.0), abs=1e-9)


def test_the_pressure_that_left_the_linkage_open():
    found = balance(Effector(HALF), "R", pressure=0.6455327403963403)
    assert found.lateral == pytest.approx(9.7234, abs=1e-4)
    assert abs(found.residual) < 1e-6


def test_a_short_step_near_the_end_is_no_root():
    design = place(
        muscle_preset("thesis-45"), offset=0.6080035345178763, segments=38,
        flexural_rigidity=19.40099188902511, beam_factor=2.0,
    )  # fmt: skip
    pressure = 0.15605715
    for model in (EnergyMuscle, lambda muscle: Wrapped(EnergyMuscle(muscle))):
        effector = Effector(design, model)
        muscle, peak = effector.models[0], find_peak(design)

        def miss(x, muscle=muscle):
            return float(
                muscle.force(pressure, x) - lateral_deflection(design, x) / design.compliance
            )

        root = brentq(miss, 0.0, peak.contraction, xtol=1e-15)
        found = balance(effector, "M", pressure=pressure)
        assert found.converged
        assert found.lateral == pytest.approx(float(lateral_deflection(design, root)), abs=1e-8)


class Wrapped(SpringMuscle):
    """A model that the kernels do not know, with the answers of another."""

    def __init__(self, inner):
        object.__setattr__(self, "inner", inner)
        object.__setattr__(self, "muscle", inner.muscle)

    def free_contraction(self, pressure):
        return self.inner.free_contraction(pressure)

    def force(self, pressure, contraction, *, direction=None):
        return self.inner.force(pressure, contraction)

    def stiffness(self, pressure, contraction):
        return self.inner.stiffness(pressure, contraction)


@given(st.integers(2, 60), st.floats(0.5, 0.7), st.floats(1.0, 500.0), st.floats(0.05, 0.98))
def test_the_inverse_comes_back_in_any_narrow_design(segments, share, rigidity, out):
    design = place(
        muscle_preset("thesis-45"), offset=share * 45.0 / segments, segments=segments,
        flexural_rigidity=rigidity, beam_factor=2.0,
    )  # fmt: skip
    effector = Effector(design)
    most = solve_inverse(effector, 1e3 * np.array([math.cos(1.0), math.sin(1.0)])).delivered
    wanted = solve_inverse(effector, out * most)
    back = pose(effector, wanted.pressures)
    assert wanted.converged and back.converged and wanted.reachable
    assert back.lateral_vector == pytest.approx(out * most, abs=1e-7)


def test_any_model_at_the_very_end():
    """An equilibrium at the last contraction that closes, to its last bit."""
    muscle = muscle_preset("fitted-45", length=12.0, end_length=0.0, dead_length=3.6)
    design = place(
        muscle, offset=1.69972, segments=4, flexural_rigidity=1.0, beam_factor=2.0,
        pressure_limit=0.3,
    )  # fmt: skip
    peak = find_peak(design)
    found = balance(
        Effector(design, SpringMuscle), "M", pressure=np.linspace(0.27609, 0.27611, 401)
    )
    assert np.all(found.converged | found.saturated)
    assert np.all(np.diff(found.lateral) > -1e-8)
    assert found.lateral == pytest.approx(np.full(401, peak.lateral), abs=0.02)


def test_one_segment_of_half_its_length():
    """The only linkage that closes up to a muscle of no length: it ends lying on its side."""
    peak = find_peak(PROTOTYPE.replace(segments=1, offset=22.5))
    assert peak.contraction == pytest.approx(45.0, rel=1e-6)
    assert peak.lateral == pytest.approx(45.0, rel=1e-6)


@pytest.mark.parametrize("offset", [2.0, 2.55, 2.6, 2.65, 2.8, 2.99, 3.0, 3.5])
def test_conflicts_say_that_segments_do_not_close_only_where_it_is_so(offset):
    design = PROTOTYPE.replace(offset=offset)
    said = [line for line in find_conflicts(design) if "not every segment closes" in line]
    linkage = take_linkage(design)
    tried = np.linspace(0.0, 45.0, 20_001)[:-1]
    closes = np.array([measure_lateral(linkage, x)[2] == 0 for x in tried])
    assert bool(said) == (not closes.all())
    if said:
        first = float(said[0].split("contraction of ")[1].split()[0])
        assert tried[np.argmin(closes)] == pytest.approx(first, abs=0.01)


def test_the_reason_says_segment_interval_and_what_to_change():
    effector = Effector(HALF)
    for reason in (
        str(balance(effector, "R", pressure=0.8).reason),
        str(pose(effector, {"R": 0.6, "G": 0.6}).reason),
        str(solve_inverse(effector, [30.0, -30.0]).reason),
    ):
        assert "segment 15 of 15 would come nearer than 1.5 mm" in reason
        assert "[1.5, 4.5] mm is legal; use more segments or a larger offset" in reason
        assert "\n" not in reason
    # The offset that is named closes, and the design as it is does not.
    least = float(str(balance(effector, "R", pressure=0.8).reason).split("(2 n) = ")[1].split()[0])
    beyond = find_peak(HALF).contraction * (1.0 + 1e-6)
    with pytest.raises(GeometryError, match="segment 15 of 15"):
        lateral_deflection(HALF, beyond)
    assert math.isfinite(lateral_deflection(HALF.replace(offset=least), beyond))


def test_the_fixed_point_does_not_end_at_no_deflection_under_load():
    stiff = Effector(PROTOTYPE.replace(flexural_rigidity=600.0))
    found = balance(stiff, "R", pressure=0.6894, method="fixed-point")
    assert balance(stiff, "R", pressure=0.6894).lateral == pytest.approx(6.77, abs=0.01)
    assert not found.converged and "not converged" in str(found.reason)
    slack = balance(stiff, "R", pressure=0.01, method="fixed-point")
    assert slack.converged and slack.iterations == 1


def test_blind_muscles_end_there_too():
    design = place(muscle_preset("effector-45"), offset=1.6)
    found = balance(Effector(design, ThesisMuscle), "M", pressure=0.827)
    assert found.saturated and found.lateral == find_peak(design).lateral
