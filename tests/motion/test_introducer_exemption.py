"""The introducer excuses the waiting part of the scope from the lumen, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bozzini.duct import field_from_mask
from bozzini.motion import FreeSpace, Introducer
from bozzini.motion.certify import certify_motion
from tests.exact import voxelise

RADIUS, LINK = 2.0, 10.0


@pytest.fixture(scope="module")
def lumen():
    """A tract that runs down from the entry, turns up beside the introducer, and crosses it.

    The entry is the origin, the introducer the z axis above it.
    """
    corners = np.array(
        [[0, 0, 0], [0, 0, -30], [30, 0, -30], [30, 0, 40], [-30, 0, 40]], dtype=float
    )
    mask, affine = voxelise(corners, 6.0)
    # Above the entry there is tissue.
    return field_from_mask(mask, affine)


@pytest.fixture(scope="module")
def introducer(lumen):
    bore = float(lumen.clearance_bound(np.zeros(3)))
    return Introducer(entry=np.zeros(3), outward=np.array([0.0, 0.0, 1.0]), bore=bore)


def straight(head, joints=6):
    """A straight chain on the z axis with its head at z = head."""
    chain = np.zeros((joints, 3))
    chain[:, 2] = head + LINK * np.arange(joints)
    return chain


def certify(lumen, introducer, *chains):
    return certify_motion(np.array(chains), FreeSpace(lumen, introducer=introducer), radius=RADIUS)


def test_a_straight_insertion_is_certified(lumen, introducer):
    chains = [straight(head) for head in np.arange(0.0, -28.0, -0.5)]
    result = certify(lumen, introducer, *chains)
    assert result.certified
    # One big step is the same motion.
    assert certify(lumen, introducer, chains[0], chains[-1]).clearance == pytest.approx(
        result.clearance, abs=0.11
    )
    # In, out and in again too.
    assert certify(lumen, introducer, *chains, *chains[::-1], *chains).certified


def test_without_the_introducer_the_waiting_part_is_in_the_wall(lumen):
    assert certify_motion(straight(-10.0)[None], lumen, radius=RADIUS).clearance < -RADIUS


def test_waiting_wholly_in_the_introducer_proves_nothing_about_the_lumen(lumen, introducer):
    result = certify(lumen, introducer, straight(0.0))
    assert not result.certified


@pytest.mark.parametrize("joint", [1, 2])
def test_a_middle_of_the_body_in_the_bore_is_held_while_later_joints_are_in_the_tract(
    lumen, introducer, joint
):
    # Joints 0, 1, 2 (or fewer) straight up in the tissue over the entry, inside the endless bore;
    # the tail is in the tract again.
    chain = np.array([[0, 0, -20], [0, 0, -10], [0, 0, 0], [0, 0, 10.0], [8, 0, 4], [0, 0, -4]])
    chain[5] = [0.0, 0.0, -8.0]
    assert certify(lumen, introducer, chain).clearance < -RADIUS
    start = straight(0.0)
    assert certify(lumen, introducer, start, chain).clearance < -RADIUS


def test_a_link_that_leaves_the_bore_sideways_is_held_outside_it(lumen, introducer):
    # The tail waits on the axis; the joint before it stands beside the bore, in the tract's
    # other limb, and the link between goes through tissue.
    chain = straight(12.0, joints=4)
    chain[1] = [30.0, 0.0, 20.0]
    chain[0] = [30.0, 0.0, 10.0]
    result = certify(lumen, introducer, chain)
    assert result.clearance < -RADIUS


def test_a_joint_beside_the_axis_but_within_the_bore_is_free_and_beyond_it_is_not(
    lumen, introducer
):
    room = introducer.bore - RADIUS
    for off, free in ((0.9 * room, True), (1.5 * room, False)):
        chain = straight(-10.0)
        chain[3, 0] = off
        assert certify(lumen, introducer, chain).certified == free


@pytest.mark.parametrize("bore", [6.5, 52.0])
def test_a_bore_wider_than_the_lumen_at_the_entry_is_never_certified(lumen, introducer, bore):
    wide = replace(introducer, bore=bore)
    assert introducer.bore < 5.5
    for chains in ([straight(0.0)], [straight(head) for head in (0.0, -10.0)]):
        result = certify(lumen, wide, *chains)
        assert not result.certified
        assert result.clearance == pytest.approx(introducer.bore - bore)
    # Nor is it for a scope that never uses the introducer.
    inside = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -10.0]])
    assert certify(lumen, introducer, inside).certified
    assert not certify(lumen, wide, inside).certified


def test_a_bore_counts_only_as_far_as_the_lumen_at_the_entry_goes(lumen, introducer):
    # A little wider than is proved, but no wider than the lumen may be by the field's error.
    wide = replace(introducer, bore=introducer.bore + 0.3)
    chains = [straight(head) for head in (0.0, -10.0)]
    assert certify(lumen, wide, *chains).clearance == certify(lumen, introducer, *chains).clearance
    chain = straight(-10.0)
    chain[3, 0] = introducer.bore - RADIUS + 0.2
    assert not certify(lumen, wide, chain).certified


def test_the_part_of_a_link_before_the_entry_plane_is_held(lumen, introducer):
    # Half of the link is in the bore, the other half goes into the wall beside the lumen.
    chain = straight(5.0, joints=4)
    chain[0] = [-9.0, 0.0, -6.0]
    chain[1] = [0.0, 0.0, 1.0]
    assert certify(lumen, introducer, chain).clearance < 0.0


def test_a_tract_that_crosses_the_line_of_the_bore_is_no_introducer(lumen, introducer):
    # A short scope far on in the tract, at rest in the limb that crosses the z axis at z = 40;
    # then its head half goes up into the tissue, within the endless bore.
    here = np.array([[10.0, 0.0, 40.0], [20.0, 0.0, 40.0]])
    there = np.array([[0.0, 0.0, 40.0], [10.0, 0.0, 40.0]])
    lost = np.array([[0.0, 0.0, 60.0], [0.0, 0.0, 50.0]])
    assert certify(lumen, introducer, here, there).certified
    assert certify(lumen, introducer, here, there, lost).clearance < -RADIUS
    # Tail first, so that it is within the bore all the time.
    crossing = np.array([[-10.0, 0.0, 40.0], [0.0, 0.0, 40.0]])
    raised = np.array([[0.0, 0.0, 40.0], [0.0, 0.0, 50.0]])
    assert certify(lumen, introducer, here, there, crossing).certified
    assert certify(lumen, introducer, here, there, crossing, raised).clearance < -RADIUS
    # The tail alone in the bore does not make it the introducer's either.
    tail = np.array([[10.0, 0.0, 47.0], [0.0, 0.0, 47.0]])
    assert certify(lumen, introducer, here, tail).clearance < 0.0


def test_a_scope_that_leaves_the_bore_sideways_is_held_against_the_lumen(lumen, introducer):
    # The tract crosses the introducer's line at z = 40. A chain that stands on that line farther
    # out and leaves into the tract there has never been through the mouth.
    waiting = np.stack([np.zeros(4), np.zeros(4), 40.0 + LINK * np.arange(4)], axis=1)
    ahead = np.stack([-LINK * np.arange(1, 3), np.zeros(2), np.full(2, 40.0)], axis=1)
    sideways = np.concatenate([ahead[::-1], waiting])
    for motion in (sideways[None], np.stack([sideways, sideways - [2.0, 0.0, 0.0]])):
        certificate = certify_motion(motion, FreeSpace(lumen, introducer=introducer), radius=RADIUS)
        assert not certificate.certified
