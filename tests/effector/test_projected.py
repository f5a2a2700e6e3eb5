"""The projected inverse: sectors, the thesis's printed equations, saturation, gaps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bozzini.effector.design import EffectorDesign, PlacedMuscle, effector_preset
from bozzini.effector.inverse import INVERSE_OUTCOMES, find_sectors, project_inverse
from bozzini.muscle import preset as muscle_preset

PROTOTYPE = effector_preset("prototype")

coordinates = st.floats(-40.0, 40.0)
AMPLITUDES = st.just(0.0) | st.floats(1e-6, 30.0)


def place(degrees: list[float]) -> EffectorDesign:
    """A design with muscles at these angles."""
    muscle = muscle_preset("fitted-45")
    return EffectorDesign(
        muscles=tuple(
            PlacedMuscle(name=f"M{k}", muscle=muscle, angle=math.radians(angle))
            for k, angle in enumerate(degrees)
        )
    )


def add_up(design: EffectorDesign, displacements: np.ndarray) -> np.ndarray:
    units = np.stack([np.cos(design.angles), np.sin(design.angles)], axis=-1)
    return displacements @ units


def solve_printed(design: EffectorDesign, target: np.ndarray) -> np.ndarray:
    """(4.10)-(4.14) with the printed angle test, the gap taken modulo a turn, and a tolerance."""
    sizes = np.zeros(len(design.muscles))
    order = find_sectors(design).order
    heading = math.atan2(target[1], target[0])
    for first, second in zip(order, np.roll(order, -1), strict=True):
        one, two = design.angles[first], design.angles[second]
        gap = math.fmod(two - one + 4.0 * math.pi, 2.0 * math.pi)
        from_one, from_two = (abs(math.remainder(heading - a, math.tau)) for a in (one, two))
        if abs(from_one + from_two - gap) < 1e-7:
            matrix = np.array([[math.cos(one), math.cos(two)], [math.sin(one), math.sin(two)]])
            sizes[[first, second]] = np.linalg.solve(matrix, target)
            return sizes
    raise AssertionError(f"no sector for {target}")


def test_sectors_of_the_prototype() -> None:
    sectors = find_sectors(PROTOTYPE)
    assert [PROTOTYPE.names[k] for k in sectors.order] == ["B", "G", "R"]
    assert np.degrees(sectors.gaps) == pytest.approx([144.0, 88.5, 127.5])
    assert sectors.covers_all


def test_agrees_with_the_printed_angle_test() -> None:
    targets = np.random.default_rng(3).normal(size=(2000, 2)) * 8.0
    found = project_inverse(PROTOTYPE, targets, amplitudes=1e6)
    printed = np.array([solve_printed(PROTOTYPE, target) for target in targets])
    assert np.abs(found.displacements - printed).max() < 1e-9
    assert found.reachable.all()


@pytest.mark.parametrize("which", ["first", "second"])
def test_saturation_is_4_15_and_4_16(which: str) -> None:
    amplitudes = np.array([20.0, 12.0, 7.0])
    seen = 0
    for target in np.random.default_rng(4).normal(size=(500, 2)) * 60.0:
        found = project_inverse(PROTOTYPE, target, amplitudes=amplitudes)
        i, j = found.pair if which == "first" else found.pair[::-1]
        if found.reachable or found.displacements[i] < amplitudes[i]:
            continue
        # A_i is known; R and a_j solve R e_v - a_j e_j = A_i e_i.
        seen += 1
        unit = target / np.hypot(*target)
        e_i, e_j = ([math.cos(PROTOTYPE.angles[k]), math.sin(PROTOTYPE.angles[k])] for k in (i, j))
        length, other = np.linalg.solve(
            np.column_stack([unit, -np.asarray(e_j)]), amplitudes[i] * np.asarray(e_i)
        )
        assert other <= amplitudes[j] * (1.0 + 1e-12)
        assert found.displacements[j] == pytest.approx(other, abs=1e-9)
        assert found.delivered == pytest.approx(length * unit, abs=1e-9)
    assert seen > 50


def test_the_divider_is_the_corner_and_not_the_sum_of_unit_vectors() -> None:
    amplitudes = np.array([20.0, 5.0, 10.0])
    one, two = PROTOTYPE.angles[1], PROTOTYPE.angles[0]
    corner = 5.0 * np.exp(1j * one) + 20.0 * np.exp(1j * two)
    printed = np.exp(1j * one) + np.exp(1j * two)

    def full(direction: complex) -> np.ndarray:
        target = 100.0 * np.array([direction.real, direction.imag]) / abs(direction)
        return project_inverse(PROTOTYPE, target, amplitudes=amplitudes).displacements

    assert full(corner)[:2] == pytest.approx([20.0, 5.0])
    assert full(printed)[0] < 10.0


@example([1, 0], [1.0, 1e-6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2.0, 0.0)
@given(
    st.lists(st.integers(0, 359), min_size=1, max_size=8, unique=True),
    st.lists(AMPLITUDES, min_size=8, max_size=8),
    coordinates,
    coordinates,
)
def test_what_is_delivered_is_true_and_along_the_target(
    degrees: list[int], sizes: list[float], x: float, y: float
) -> None:
    design = place([float(value) for value in degrees])
    amplitudes = np.array(sizes[: len(degrees)])
    target = np.array([x, y])
    found = project_inverse(design, target, amplitudes=amplitudes)
    moves = found.displacements
    assert np.all((moves >= 0.0) & (moves <= amplitudes))
    assert np.count_nonzero(moves) <= 2
    assert 0.0 <= found.share <= 1.0
    size = math.hypot(x, y)
    assert np.abs(found.delivered - found.share * target).max() <= 1e-15 * size
    assert np.abs(add_up(design, moves) - found.delivered).max() <= 1e-9 * (1.0 + size)
    if found.reachable:
        assert np.abs(found.delivered - target).max() <= 1e-11 * size
    elif found.code == 1:
        # Not reached because of a muscle, so one is at its amplitude.
        assert np.any(np.isclose(moves, amplitudes, rtol=1e-9, atol=0.0))


@given(coordinates, coordinates, st.floats(-10.0, 10.0))
def test_turning_everything_turns_nothing_else(x: float, y: float, turn: float) -> None:
    amplitudes = [20.0, 12.0, 7.0]
    turned = PROTOTYPE.replace(
        muscles=tuple(
            PlacedMuscle(name=one.name, muscle=one.muscle, angle=one.angle + turn)
            for one in PROTOTYPE.muscles
        )
    )
    target = complex(x, y)
    there = target * np.exp(1j * turn)
    here = project_inverse(PROTOTYPE, [x, y], amplitudes=amplitudes)
    moved = project_inverse(turned, [there.real, there.imag], amplitudes=amplitudes)
    assert moved.displacements == pytest.approx(here.displacements, abs=1e-9 * (1 + abs(target)))


@given(coordinates, coordinates)
def test_mirror(x: float, y: float) -> None:
    amplitudes = [20.0, 12.0, 7.0]
    mirrored = PROTOTYPE.replace(
        muscles=tuple(
            PlacedMuscle(name=one.name, muscle=one.muscle, angle=-one.angle)
            for one in PROTOTYPE.muscles
        )
    )
    here = project_inverse(PROTOTYPE, [x, y], amplitudes=amplitudes).displacements
    there = project_inverse(mirrored, [x, -y], amplitudes=amplitudes).displacements
    assert there == pytest.approx(here, abs=1e-9)


def test_zero_needs_nothing() -> None:
    found = project_inverse(PROTOTYPE, [0.0, 0.0], amplitudes=10.0)
    assert found.reachable and not found.displacements.any()
    assert list(found.pair) == [-1, -1]


def test_a_shared_edge_is_the_same_from_both_sides() -> None:
    for index, angle in enumerate(PROTOTYPE.angles):
        for nudge in (-1e-13, 0.0, 1e-13):
            target = 5.0 * np.array([math.cos(angle + nudge), math.sin(angle + nudge)])
            found = project_inverse(PROTOTYPE, target, amplitudes=10.0)
            assert found.reachable
            assert found.displacements[index] == pytest.approx(5.0, abs=1e-11)
            assert found.displacements.sum() == pytest.approx(5.0, abs=1e-11)


@pytest.mark.parametrize("degrees", [[30.0], [30.0, 210.0], [0.0, 100.0], [0.0, 60.0, 120.0]])
def test_gaps_of_half_a_turn_are_said(degrees: list[float]) -> None:
    design = place(degrees)
    assert not find_sectors(design).covers_all
    found = project_inverse(design, [0.0, -3.0], amplitudes=10.0)
    assert not found.reachable and found.code == 3
    assert not found.displacements.any() and not found.delivered.any()
    for index, angle in enumerate(design.angles):
        target = [4.0 * math.cos(angle), 4.0 * math.sin(angle)]
        along = project_inverse(design, target, amplitudes=10.0)
        assert along.reachable
        assert along.displacements[index] == pytest.approx(4.0)


def test_a_muscle_that_does_nothing() -> None:
    found = project_inverse(PROTOTYPE, [[0.0, -3.0], [0.0, 3.0]], amplitudes=[5.0, 0.0, 5.0])
    assert not found.reachable[0] and not found.delivered[0].any()


def test_the_largest_deflection_cuts() -> None:
    angle = math.radians(260.0)
    target = 30.0 * np.array([math.cos(angle), math.sin(angle)])
    found = project_inverse(PROTOTYPE, target, amplitudes=25.0, peak=20.0)
    assert found.code == 2 and not found.reachable
    assert np.hypot(*found.delivered) == pytest.approx(20.0)


def test_batches_are_rows() -> None:
    targets = np.random.default_rng(5).normal(size=(4, 3, 2)) * 20.0
    found = project_inverse(PROTOTYPE, targets, amplitudes=12.0)
    assert found.displacements.shape == (4, 3, 3) and found.pair.shape == (4, 3, 2)
    for place_ in np.ndindex(4, 3):
        one = project_inverse(PROTOTYPE, targets[place_], amplitudes=12.0)
        assert np.array_equal(one.displacements, found.displacements[place_])
    empty = project_inverse(PROTOTYPE, np.empty((0, 2)), amplitudes=12.0)
    assert empty.displacements.shape == (0, 3)


def test_codes_have_names() -> None:
    gap = place([0.0, 90.0])
    for target, peak, word in (
        ([1.0, 1.0], math.inf, "reached"),
        ([9.0, 1.0], math.inf, "muscle limit"),
        ([4.0, 4.0], 3.0, "largest deflection"),
        ([-1.0, -1.0], math.inf, "gap"),
    ):
        found = project_inverse(gap, target, amplitudes=5.0, peak=peak)
        assert INVERSE_OUTCOMES[int(found.code)] == word
