"""Sections across a duct: circles of known tubes, frames, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.duct import Centreline, RoundCones
from bozzini.duct.fitting.measure import cut_sections
from bozzini.duct.shapes.super_ellipses import SuperEllipsoids
from bozzini.numeric.polylines import carry_frames
from tests.shapes import bend_curve

BEND = bend_curve(30.0, 1.5, 20.0)


def oval(a, b):
    duct = SuperEllipsoids(
        np.zeros((1, 3)), np.array([[a, b, 60.0]]),
        e1=np.array([0.1]), e2=np.array([1.0]), rotations=np.eye(3)[None],
    )  # fmt: skip
    return duct, Centreline.from_points([[0, 0, -20.0], [0, 0, 20.0]], duct)


def test_sections_of_a_round_tube_are_round():
    duct = RoundCones(BEND, np.full(len(BEND), 6.0))
    line = Centreline.from_points(BEND, duct)
    cuts = cut_sections(duct, line, spacing=4.0)
    inner = (cuts.arc_length > 3.0) & (cuts.arc_length < line.length - 3.0)
    assert cuts.lengths[inner] == pytest.approx(6.0, abs=0.02)
    assert np.abs(duct.signed_distance(cuts.wall)).max() < 1e-9
    for circles in (cuts.fit_circles(), cuts.inscribe_circles()):
        assert circles.radii[inner] == pytest.approx(6.0, abs=0.03)
        assert np.linalg.norm(circles.centres - cuts.centres, axis=1)[inner].max() < 0.05
    assert cuts.areas[inner] == pytest.approx(np.pi * 36.0, rel=0.01)


@pytest.mark.parametrize(("b", "factor"), [(6.0, 1.35), (8.0, 1.13)])
def test_circle_by_least_squares_is_no_inscribed_one(b, factor):
    """As said for ellipses 10 x 6 and 10 x 8."""
    duct, line = oval(10.0, b)
    cuts = cut_sections(duct, line, spacing=10.0, rays=360)
    fitted, inscribed = cuts.fit_circles(), cuts.inscribe_circles()
    assert inscribed.radii == pytest.approx(b, abs=0.01)
    assert fitted.radii / inscribed.radii == pytest.approx(factor, abs=0.04)
    assert fitted.residuals.min() > 0.5
    assert cuts.areas == pytest.approx(np.pi * 10.0 * b, rel=1e-3)


def test_inscribed_circle_is_found_off_the_centreline():
    duct, _ = oval(10.0, 6.0)
    line = Centreline.from_points([[5.0, 2.0, -10.0], [5.0, 2.0, 10.0]], duct)
    cuts = cut_sections(duct, line, spacing=10.0, rays=360)
    circles = cuts.inscribe_circles()
    assert circles.radii == pytest.approx(6.0, abs=0.02)
    assert np.abs(circles.centres[:, 1]).max() < 0.05
    # No wall point lies inside an inscribed circle.
    away = np.linalg.norm(cuts.wall - circles.centres[:, None], axis=2)
    assert (away.min(axis=1) >= circles.radii - 1e-9).all()


def test_frames_are_carried_without_twist():
    random = np.random.default_rng(1)
    steps = np.cumsum(random.normal(0.0, 0.2, (60, 3)), axis=0) + [0, 0, 3.0]
    tangents = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    frames = carry_frames(tangents)
    product = np.einsum("nji,njk->nik", frames, frames)
    assert product == pytest.approx(np.broadcast_to(np.eye(3), product.shape), abs=1e-12)
    assert np.linalg.det(frames) == pytest.approx(1.0)
    assert frames[:, :, 2] == pytest.approx(tangents)
    # The rotation between neighbours has its axis across both tangents.
    turn = np.einsum("nij,nkj->nik", frames[1:], frames[:-1])
    axis = np.stack(
        [
            turn[:, 2, 1] - turn[:, 1, 2],
            turn[:, 0, 2] - turn[:, 2, 0],
            turn[:, 1, 0] - turn[:, 0, 1],
        ],
        axis=1,
    )
    assert np.abs(np.einsum("ni,ni->n", axis, tangents[1:])).max() < 1e-12


def test_stations_are_where_they_were_asked_for():
    duct, line = oval(10.0, 6.0)
    cuts = cut_sections(duct, line, stations=[1.0, 7.5, 30.0], rays=12)
    assert cuts.centres[:, 2] == pytest.approx([-19.0, -12.5, 10.0])
    assert cuts.lengths.shape == (3, 12)
