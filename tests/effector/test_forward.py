"""`bend`: against the printed problem by SLSQP, the thesis's tables, and geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.effector import (
    bend,
    contraction_for_lateral,
    effector_preset,
    find_peak,
    lateral_deflection,
    lateral_slope,
    place_curve,
)
from bozzini.effector.kernels.linkage import find_end, measure_lag, measure_lateral
from bozzini.errors import GeometryError
from tests.effector.reference import ROWS, intersect_circles, solve_printed
from tests.effector.strategies import designs

DESIGN = effector_preset("prototype")


def test_all_rows_of_the_tables():
    """Within what rounding Delta and delta_e to 0.1 mm leaves open."""
    lateral = lateral_deflection(DESIGN, ROWS[:, 0])
    band = 0.05 * lateral_slope(DESIGN, ROWS[:, 0]) + 0.05
    assert np.all(np.abs(lateral - ROWS[:, 1]) <= band)
    assert np.sqrt(np.mean((lateral - ROWS[:, 1]) ** 2)) < 0.075


def test_deflection_per_force_of_the_tables():
    """Every row allows an interval of c; they meet, and the design's compliance lies there."""
    low = np.max((ROWS[:, 1] - 0.05) / (ROWS[:, 2] + 0.005))
    high = np.min((ROWS[:, 1] + 0.05) / (ROWS[:, 2] - 0.005))
    assert 13.47 <= low <= DESIGN.compliance <= high <= 13.56


@pytest.mark.parametrize("contraction", [0.5, 3.0, 6.9, 10.5, 14.0])
def test_against_the_printed_problem(contraction):
    found = bend(DESIGN, contraction)
    backbone, muscle = solve_printed(4.0, 45.0, 15, contraction)
    assert found.backbone == pytest.approx(backbone, abs=1e-6)
    assert found.muscle == pytest.approx(muscle, abs=1e-6)


def test_against_the_printed_norm():
    backbone, _ = solve_printed(4.0, 45.0, 15, 6.9, objective="norm")
    assert bend(DESIGN, 6.9).backbone == pytest.approx(backbone, abs=1e-5)


@given(designs(), st.floats(0.0, 0.999))
def test_against_intersected_circles(design, share):
    contraction = share * find_peak(design).contraction
    found = bend(design, contraction)
    backbone, muscle = intersect_circles(
        design.offset, design.backbone_length, design.segments, contraction
    )
    size = design.backbone_length
    # Near a link in line with the muscle the joint is the root of a small difference.
    slack = 1e-11 / max(1e-5, found.spacing.min() / design.offset) ** 2
    assert found.backbone == pytest.approx(backbone, abs=slack * size)
    assert found.muscle == pytest.approx(muscle, abs=slack * size)


@given(designs(closes=True), st.floats(0.0, 0.99))
def test_lengths_are_kept(design, share):
    contraction = share * design.backbone_length
    found = bend(design, contraction)
    n, length = design.segments, design.backbone_length
    pieces = np.linalg.norm(np.diff(found.backbone, axis=0), axis=-1)
    parts = np.linalg.norm(np.diff(found.muscle, axis=0), axis=-1)
    links = np.linalg.norm(found.muscle - found.backbone, axis=-1)
    assert pieces == pytest.approx(np.full(n, length / n), abs=1e-9)
    assert parts == pytest.approx(np.full(n, (length - contraction) / n), abs=1e-9)
    assert links == pytest.approx(np.full(n + 1, design.offset), abs=1e-9)
    # The muscle's piece is parallel to the backbone's last one, (4.2).
    ahead = np.stack([np.sin(found.backbone_angle), np.cos(found.backbone_angle)], axis=-1)
    assert np.diff(found.muscle, axis=0) == pytest.approx(parts[:, None] * ahead[:-1], abs=1e-8)
    assert found.backbone[1:] - found.backbone[:-1] == pytest.approx(
        length / n * ahead[1:], abs=1e-8
    )


@given(designs(), st.floats(0.01, 0.99))
def test_slope_is_the_derivative(design, share):
    contraction = share * find_peak(design).contraction
    step = 1e-6 * contraction * (1.0 - share)
    ahead, behind = lateral_deflection(design, [contraction + step, contraction - step])
    rise = (ahead - behind) / (2.0 * step)
    noise = 1e-13 * design.backbone_length / step
    assert lateral_slope(design, contraction) == pytest.approx(rise, rel=1e-4, abs=noise)


@given(designs())
def test_the_branch_rises_to_the_peak(design):
    peak = find_peak(design)
    lateral = lateral_deflection(design, np.linspace(0.0, peak.contraction, 300))
    assert np.all(np.diff(lateral) > -1e-12 * design.backbone_length)
    assert lateral[-1] == pytest.approx(peak.lateral, rel=1e-12)
    if peak.is_maximum and peak.contraction * (1 + 1e-3) < find_end(
        (design.offset, design.backbone_length, design.segments)
    ):
        assert lateral_deflection(design, peak.contraction * (1 + 1e-3)) <= peak.lateral


def test_peak_of_the_prototype():
    peak = find_peak(DESIGN)
    assert peak.contraction == pytest.approx(10.5, abs=0.01)
    assert peak.lateral == pytest.approx(27.70, abs=0.005)
    assert peak.is_maximum
    assert np.degrees(bend(DESIGN, peak.contraction).backbone_angle[-1]) == pytest.approx(
        138.0, abs=0.5
    )


@given(designs(), st.floats(0.0, 1.0))
def test_round_trip(design, share):
    lateral = share * find_peak(design).lateral
    contraction = contraction_for_lateral(design, lateral)
    assert 0.0 <= contraction <= find_peak(design).contraction
    back = lateral_deflection(design, contraction)
    # Where a segment is about to fold, deflection changes within the last bit of the contraction.
    step = 4e-16 * design.backbone_length * abs(float(lateral_slope(design, contraction)))
    assert back == pytest.approx(lateral, abs=1e-13 * design.backbone_length + step)


def test_many_segments_bend_to_a_circle():
    def lateral(n):
        return float(lateral_deflection(DESIGN.replace(segments=n), 6.9))

    turn = 6.9 / 4.0
    circle = 45.0 / turn * (1.0 - math.cos(turn))
    assert circle == pytest.approx(30.09, abs=0.005)
    misses = [circle - lateral(n) for n in (50, 100, 200, 400, 800)]
    # So the number of segments is a property of the hardware.
    assert [lateral(15), lateral(50)] == pytest.approx([20.45, 25.93], abs=0.01)
    assert all(0.4 < b / a < 0.7 for a, b in zip(misses, misses[1:], strict=False))


def test_small_contractions_grow_with_the_square():
    small = lateral_deflection(DESIGN, [0.01, 0.02])
    assert small[1] / small[0] == pytest.approx(4.0, rel=0.01)
    # A section of constant curvature grows in proportion, L * x / (2 a) at first.
    assert lateral_deflection(DESIGN, 1.0) == pytest.approx(0.65, abs=0.01)
    assert lateral_deflection(DESIGN, 0.0) == 0.0
    assert lateral_slope(DESIGN, 0.0) == pytest.approx(0.0, abs=1e-15)


def test_the_muscle_drifts_inwards():
    found = bend(DESIGN, 7.6)
    assert np.all(np.diff(found.spacing) < 0.0)
    assert found.spacing[0] == 4.0
    assert found.spacing[-1] == pytest.approx(3.06, abs=0.01)
    lag = found.link_angle[-1] - found.backbone_angle[-1]
    assert np.degrees([found.backbone_angle[-1], lag]) == pytest.approx([85.9, 40.0], abs=0.3)


@given(designs(closes=False), st.floats(1e-6, 0.999))
def test_existence_is_the_closed_form(design, share):
    """Segment k closes where (l + m)/(2 a) (1 - (m/l)^k) is below 1, and nowhere else."""
    contraction = share * design.backbone_length
    rest = design.backbone_length / design.segments
    short = rest * (1.0 - share)
    sines = [
        (rest + short) / (2.0 * design.offset) * (1.0 - (short / rest) ** k)
        for k in range(1, design.segments + 1)
    ]
    if max(sines) < 1.0 - 1e-9:
        assert math.isfinite(lateral_deflection(design, contraction))
    elif max(sines) > 1.0 + 1e-9:
        with pytest.raises(
            GeometryError, match=r"cannot close.*D = .*\(l0 \+ l_a\)/\(2 n\)"
        ) as got:
            bend(design, contraction)
        segment = 1 + next(k for k, sine in enumerate(sines) if sine >= 1.0)
        assert f"segment {segment} of {design.segments} " in str(got.value)
        message = str(got.value)
        apart = float(message.split("D = ")[1].split()[0])
        least = float(message.split("[")[1].split(",")[0])
        assert apart <= least * (1.0 + 1e-5) + 1e-9


def test_an_offset_that_always_closes():
    for n in (12, 15, 40):
        design = DESIGN.replace(offset=45.0 / n + 1e-9, segments=n)
        assert np.all(np.isfinite(lateral_deflection(design, np.linspace(0.0, 44.9, 200))))


def test_the_first_failure_ends_the_branch():
    design = DESIGN.replace(offset=2.5)
    linkage = (2.5, 45.0, 15)
    end = find_end(linkage)
    assert end == pytest.approx(6.3055, abs=1e-4)
    assert measure_lag(linkage, end, 15) == pytest.approx(1.0, abs=1e-12)
    assert find_peak(design).contraction < end
    assert measure_lateral(linkage, 7.6)[2] == 14
    with pytest.raises(GeometryError, match="segment 14 of 15 cannot close"):
        bend(design, 7.6)


def test_a_batch_is_its_members():
    contractions = np.array([[0.0, 3.0, 6.9], [1.0, 2.0, 10.0]])
    batch = bend(DESIGN, contractions)
    assert batch.backbone.shape == batch.muscle.shape == (2, 3, 16, 2)
    assert batch.spacing.shape == (2, 3, 16)
    assert batch.lateral == pytest.approx(lateral_deflection(DESIGN, contractions), abs=1e-13)
    for index in np.ndindex(2, 3):
        one = bend(DESIGN, contractions[index])
        assert one.lateral.shape == ()
        for name in ("backbone", "muscle", "tip", "holder_tip", "total", "link_angle"):
            assert np.array_equal(getattr(one, name), getattr(batch, name)[index])
    assert bend(DESIGN, np.zeros((0, 2))).tip.shape == (0, 2, 2)


def test_the_holder_goes_straight_on():
    found = bend(DESIGN, 6.9)
    last = found.backbone[-1] - found.backbone[-2]
    assert found.holder_tip - found.tip == pytest.approx(10.0 / 3.0 * last)
    assert bend(DESIGN.replace(holder_length=0.0), 6.9).holder_tip == pytest.approx(found.tip)
    assert found.total == pytest.approx(22.38, abs=0.005)


def test_curves_in_space():
    found = bend(DESIGN, [3.0, 6.9])
    placed = place_curve(found.muscle, [0.0, 0.5 * math.pi])
    assert placed.shape == (2, 16, 3)
    assert placed[0, :, 0] == pytest.approx(found.muscle[0, :, 0])
    assert placed[1, :, 1] == pytest.approx(found.muscle[1, :, 0])
    assert placed[..., 2] == pytest.approx(found.muscle[..., 1])
