"""Contact: found where the body stands beyond the wall at rest, as deep as it does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bozzini.plot.contact import draw_contact, measure_contact
from bozzini.plot.figures import write_figure
from tests.plot.fake_motion import make_field, make_plan


def push(side: float, *, radius: float = 4.0):
    """Return a scope in the 6 mm capsule, moved sideways from 30 to 50 mm along it."""
    plan = make_plan(radius=radius)
    joints = plan.joints.copy()
    place = 60.0 - joints[..., 2]
    joints[..., 0] += np.where((place >= 30.0) & (place <= 50.0), side, 0.0)
    away = np.maximum(joints[:, :-1, 0], joints[:, 1:, 0]) - 10.0
    clearance = np.where(np.isfinite(plan.clearance), 6.0 - radius - away, np.inf)
    return dataclasses.replace(plan, joints=joints, clearance=clearance)


def test_depth_and_place_of_a_push():
    contact = measure_contact(push(3.0), make_field())
    assert contact.depth.max() == pytest.approx(1.0)
    touched = contact.places[contact.deepest > 0.0]
    # A link of 8 mm to a displaced joint leans over: its last third stands beyond the wall.
    assert 26.5 < touched.min() < 30.5 and 49.5 < touched.max() < 53.5
    assert contact.touched == pytest.approx(touched.max() - touched.min(), abs=3.0)
    early = contact.over < 25.0
    assert early.any() and not contact.depth[:, early].any()


def test_a_wider_scope_touches_no_less():
    lengths = [measure_contact(push(3.0, radius=r), make_field()).touched for r in (2.9, 3.5, 4.5)]
    assert lengths[0] == 0.0 < lengths[1] <= lengths[2]


def test_a_scope_wider_than_the_tract_touches_all_of_it():
    contact = measure_contact(make_plan(radius=9.0), make_field())
    np.testing.assert_allclose(contact.deepest, 3.0, atol=0.2)
    assert contact.depth.max() == 3.0 and contact.touched == pytest.approx(80.0)


@pytest.mark.parametrize(
    "plan",
    [push(3.0), push(0.0), make_plan(steps=1, radius=9.0), make_plan(first=80.0, reach=10.0)],
    ids=["push", "none", "one step", "in and out"],
)
def test_contact_can_be_drawn(plan, tmp_path):
    figure = draw_contact(plan, make_field(), used=1.0, allowed=2.0)
    assert write_figure(figure, tmp_path / "figure.png", dpi=30).stat().st_size > 0
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    deepest = max(0.0, -plan.clearance_min)
    assert any(text.startswith(f"{deepest:.2f} mm at") for text in texts) or deepest == 0.0
    assert ("no contact" in texts) == (deepest == 0.0)
