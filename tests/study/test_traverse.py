"""What limits links along a tract or shapes: verdicts, and what they are about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bozzini.duct import RoundCones
from bozzini.duct.shapes.cylinders import ConnectedCylinders
from bozzini.duct.shapes.super_ellipses import SuperEllipsoids
from bozzini.study import PathOptions, TractFitOptions, run_fit, run_sections, traverse
from bozzini.study.traverse import explain_fit, run_limits
from tests.study.test_insertion import END, START, make_labels

TURN = np.linspace(0.0, 0.8, 13)
BEND = 60.0 * np.stack([np.cos(TURN), np.sin(TURN), 0.0 * TURN], axis=1)


def make_waist(radius=3.0):
    """A tube 12 mm wide, 48 mm long, bent, with a waist as wide as a ball of that radius."""
    away = 60.0 * (TURN - TURN[6])
    return RoundCones(BEND, 6.0 - (6.0 - radius) * np.exp(-((away / 10.0) ** 2)))


@pytest.fixture(scope="module")
def tight():
    return run_limits(make_waist(), diameter=9.0, link=15.0, fit="inscribed")


@pytest.mark.slow
def test_a_body_wider_than_the_waist_is_too_wide_and_not_its_links_too_long(tight):
    assert tight.links.link_high == 0.0
    assert tight.links.judge(15.0) == "too long"
    assert tight.verdict == "too wide"
    assert replace(tight, diameters_of_link=None).verdict == "too wide"
    assert tight.diameters.low <= 6.0 <= tight.diameters.high <= 9.0
    assert tight.diameters_of_link.high <= tight.diameters.high


@pytest.mark.slow
def test_the_limits_are_a_result_with_a_reason_a_table_and_a_picture(tight):
    assert (tight.converged, tight.reason) == (False, "too wide")
    assert tight.to_frame().loc[0, "verdict"] == "too wide"
    assert "not converged" in tight._repr_html_()
    axes = tight.plot()
    assert tight.plot(axes) is axes and axes.get_ylabel() == "length of a link [mm]"


@pytest.mark.slow
def test_that_no_link_passes_is_a_bound_of_the_diameter(tight, monkeypatch):
    """Where the search of diameters itself proves less, the proof about links counts."""
    real = traverse.find_diameter_limits

    def find(*given, **options):
        return replace(real(*given, **options), high=12.0, high_at=1.0)

    monkeypatch.setattr(traverse, "find_diameter_limits", find)
    study = run_limits(make_waist(), diameter=9.0, link=15.0)
    assert study.verdict == "too wide"
    assert study.diameters.high == study.diameters_of_link.high == 9.0
    assert study.diameters.high_at == pytest.approx(24.0, abs=9.0)


@pytest.mark.slow
def test_the_diameter_is_that_of_the_waist(tight):
    room = 2.0 * float(-make_waist().signed_distance(BEND[6]))
    assert 0.9 * room <= tight.diameters.low <= room + 1e-9 <= tight.diameters.high + 1e-9
    assert tight.diameters.high <= 1.35 * room
    assert tight.diameters.low_at == pytest.approx(24.0, abs=4.0)


@pytest.mark.slow
def test_the_way_along_a_chain_is_that_of_its_centres(tight):
    assert np.linalg.norm(tight.line.points[:, None] - BEND, axis=-1).min(axis=1).max() <= 2.1
    assert tight.line.length == pytest.approx(48.0, rel=0.01)
    # On a grid, as with a voxel, there is no more room.
    grid = run_limits(make_waist(), PathOptions(voxel=1.5), diameter=4.0)
    assert grid.diameters.low <= tight.diameters.low * 1.05


@pytest.mark.slow
def test_the_way_along_cylinders_is_that_of_their_centres():
    radii = make_waist().radii
    cylinders = ConnectedCylinders(BEND, np.gradient(BEND, axis=0), radii)
    study = run_limits(cylinders, diameter=9.0)
    assert study.diameters.low >= 0.8 * 2.0 * radii.min()
    assert study.verdict == "too wide"


@pytest.mark.slow
def test_super_ellipsoids_keep_the_room_that_balls_have(monkeypatch):
    monkeypatch.setattr(traverse, "NODES", 50_000)
    centres = BEND[:8]
    balls = SuperEllipsoids(
        centres, np.full((len(centres), 3), 6.0), e1=np.ones(len(centres)),
        e2=np.ones(len(centres)), rotations=np.tile(np.eye(3), (len(centres), 1, 1)),
    )  # fmt: skip
    study = run_limits(balls, diameter=4.0)
    # Halfway between centres 4 mm apart a union of balls says 2 mm less.
    assert study.line.radius.min() > 3.7
    assert study.diameters.low > 7.0


@pytest.mark.slow
def test_bounds_of_fitted_shapes_are_told_to_be_of_the_shapes(tight):
    assert tight.fit == tight.to_dict()["fit"] == "inscribed"
    (found,) = tight.findings
    assert found.severity == "warning" and "upper bounds do not hold" in found.message
    (other,) = explain_fit("least squares", tight.duct)
    assert "no bound holds" in other.message
    assert explain_fit("", tight.duct) == ()


def test_fitted_shapes_and_sections_are_results_with_a_picture():
    fit = run_fit(make_labels(), TractFitOptions(max_error=2.0, start=START, end=END))
    assert fit.converged is fit.fitted.converged
    assert fit.residual == fit.fitted.report.outside_bound
    assert 0.0 < fit.clearance_min <= -fit.field.signed_distance(fit.line.points).min()
    axes = fit.plot()
    assert fit.plot(axes) is axes
    assert [line.get_label() for line in axes.lines[:2]] == ["true", "of the shapes"]
    sections = run_sections(make_labels(), PathOptions(start=START, end=END), spacing=5.0)
    drawn = sections.plot()
    names = [line.get_label() for line in drawn.lines]
    assert names == ["clearance on the centreline", *sections.circles]
    assert np.array_equal(drawn.lines[1].get_ydata(), sections.inscribed.radii)
