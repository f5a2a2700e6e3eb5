"""Manoeuvres of a pushed scope: what is done comes back, twist arrives, wrong steps are refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.io.records import read_record
from bozzini.physics.manoeuvre import Manoeuvre, Step
from bozzini.physics.options import ExecuteOptions, ScopeOptions, WallOptions
from bozzini.physics.robots import ManoeuvreDrive
from bozzini.physics.simulate import Dynamics, Simulation
from bozzini.physics.study import Scenery

SOFT = ScopeOptions(rigidity=300.0, torsion=5000.0, tip_length=20.0)
STEP_S = 0.004


def drive(scenery: Scenery, *steps: Step, scope: ScopeOptions = SOFT) -> ManoeuvreDrive:
    made = dataclasses.replace(scenery, scope=scope, manoeuvre=Manoeuvre(steps=steps))
    found = made.make_drive("push", 40.0)
    assert isinstance(found, ManoeuvreDrive)
    return found


def run_free(clear: Scenery, *steps: Step) -> tuple[ManoeuvreDrive, Simulation]:
    """Make steps without a wall."""
    found = drive(clear, *steps)
    simulation = Simulation(found.chain, dynamics=Dynamics(step=STEP_S))
    simulation.place(found.start)
    for k in range(1, math.ceil(found.duration / STEP_S) + 1):
        simulation.step(*found.command(k * STEP_S, simulation))
    return found, simulation


def test_twist_of_a_free_straight_shaft_arrives_whole(clear: Scenery) -> None:
    found, simulation = run_free(clear, Step(twist=math.radians(400.0)))
    (report,) = found.reports
    assert report.twist_arrived == pytest.approx(1.0, abs=1e-3)
    assert report.tip_turned == pytest.approx(math.radians(400.0), rel=1e-3)
    assert report.tip_moved < 1e-3 and report.base_moved == pytest.approx(0.0, abs=1e-6)
    assert abs(simulation.torque) < 1e-2 * report.torque


def test_twist_by_a_torque_at_the_tip_is_that_of_a_rod(clear: Scenery) -> None:
    found = drive(clear, Step(push=0.0))
    simulation = Simulation(found.chain, dynamics=Dynamics(step=STEP_S))
    torque, length = 3.0, found.length - 0.5 * found.chain.lengths[0]
    simulation.data.xfrc_applied[-1, 3:] = 1e3 * torque * simulation.tip_frame[:, 2]
    control = np.zeros(simulation.model.nu)
    for _ in range(1000):
        simulation.step(control)
    # The rod of the last half link lies beyond the last joint.
    assert simulation.twist % math.tau == pytest.approx(
        torque * length / SOFT.torsion % math.tau, rel=1e-3
    )
    assert simulation.torque == pytest.approx(-torque, rel=1e-3)


def test_a_bent_tip_is_turned_about_the_shaft(clear: Scenery) -> None:
    bend = math.radians(60.0)
    found, simulation = run_free(clear, Step(bend=bend), Step(twist=math.pi))
    bent, turned = found.reports
    tube = clear.plan.get_introducer()
    across = 0.5 * turned.tip_moved  # the tip goes round half a circle
    assert bent.tip_moved > across
    axis = -tube.outward
    assert simulation.tip_frame[:, 2] @ axis == pytest.approx(math.cos(bend), abs=0.02)
    off = simulation.joints[0] - tube.entry
    assert np.linalg.norm(off - (off @ axis) * axis) == pytest.approx(across, rel=0.02)
    assert turned.twist_arrived == pytest.approx(1.0, abs=0.02)


def test_what_is_pushed_and_pulled_comes_back(clear: Scenery) -> None:
    found, _ = run_free(clear, Step(push=15.0), Step(pull=15.0, speed=100.0))
    into, back = found.reports
    assert into.base_moved == pytest.approx(15.0, abs=0.01)
    assert back.base_moved == pytest.approx(-15.0, abs=0.01)
    still, _ = run_free(clear, Step(push=15.0), Step(pull=15.0), Step(push=0.0))
    assert still.reports[2].base_moved == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("step", [Step(push=0.0), Step(pull=0.0), Step(twist=0.0), Step(bend=0.0)])
def test_nothing_done_is_no_motion(clear: Scenery, step: Step) -> None:
    found, simulation = run_free(clear, step)
    assert np.abs(simulation.data.qpos).max() == 0.0
    assert found.reports[0].tip_moved == 0.0 and math.isnan(found.reports[0].twist_arrived)


@pytest.mark.slow
def test_friction_in_a_bent_lumen_takes_twist(clear: Scenery) -> None:
    # The tip is let go first: one that is bent at rest is held by the bent lumen, without friction.
    steps = Step(push=70.0), Step(bend=0.0), Step(twist=0.5 * math.pi), Step(pull=30.0)
    found = {}
    for friction in (0.0, 0.4):
        wall = WallOptions(friction=friction, stiffness=1.0)
        made = dataclasses.replace(clear, scope=SOFT, wall=wall, manoeuvre=Manoeuvre(steps=steps))
        found[friction] = made.run(ExecuteOptions(drive="push", speed=60.0, step=STEP_S))
        assert found[friction].converged, found[friction].reason
    smooth, rough = (found[friction].steps for friction in (0.0, 0.4))
    assert rough[2].twist_arrived < smooth[2].twist_arrived - 0.02
    assert smooth[2].twist_arrived == pytest.approx(1.0, abs=0.05)
    assert rough[2].torque > smooth[2].torque
    assert rough[0].normal_peak > 0.0
    assert rough[0].inside_over_reached == pytest.approx(1.0, abs=0.1)
    assert rough[3].base_moved == pytest.approx(-30.0, abs=0.2)
    assert rough[3].tip_progress < rough[0].tip_progress
    record = found[0.4]
    assert max(step.normal_peak for step in rough) == pytest.approx(record.normal_peak.max())
    assert record.summarise()["limits"]


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ([], "steps is empty: give 1 or more"),
        ([{}], "steps[0] has none of these: give one of push, pull, twist, bend"),
        ([{"push": "1 mm", "pull": "1 mm"}], "steps[0] has push and pull: give one of"),
        ([{"push": "9 mm"}, {"pull": "12 mm"}], "steps[1].pull is 12 mm: it must be at most the 9"),
        ([{"push": "-1 mm"}], "steps[0].push is -1 mm: it must"),
        ([{"twist": "90 mm"}], "steps[0].twist"),
        ([{"twist": "9 deg", "speed": "2 mm/s"}], "steps[0] has speed with twist: only push and"),
        ([{"push": "9 mm", "direction": "2 deg"}], "steps[0] has direction with push: only bend"),
        ([{"turn": "9 deg"}], "steps[0] has"),
    ],
)
def test_wrong_steps_are_one_line(steps: list[dict[str, str]], words: str) -> None:
    with pytest.raises(InputError) as caught:
        read_record({"steps": steps}, Manoeuvre)
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("step", "scope", "words"),
    [
        (
            Step(push=5000.0),
            SOFT,
            "steps[0].push is 5000 mm: with it 5000 mm are in, and",
        ),
        (Step(bend=4.0), SOFT, "steps[0].bend is 229.183 deg: it must be at most the tip's"),
        (Step(bend=1.0), dataclasses.replace(SOFT, tip_rate=0.0), "tip rate is 0: steps[0] bends"),
    ],
)
def test_what_the_scope_cannot_do_is_one_line(
    clear: Scenery, step: Step, scope: ScopeOptions, words: str
) -> None:
    with pytest.raises(InputError) as caught:
        drive(clear, step, scope=scope)
    assert words in str(caught.value)
