"""Motions that are driven: the plan is followed, forces obey statics, what fails is said."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.continuum import ContinuumRobot, EnergyModel, Helix, Section, Tendon
from bozzini.errors import InputError
from bozzini.motion import Plan, Scope, plan_insertion
from bozzini.numeric.polylines import carry_frames, follow_way, measure_arc_length
from bozzini.physics.execute import execute
from bozzini.physics.options import ExecuteOptions, ScopeOptions, WallOptions
from bozzini.physics.robots import (
    PlanDrive,
    PushDrive,
    build_tendon_chain,
    drag_chain,
    find_bends,
    spread_rigidity,
    stand_outside,
)
from bozzini.physics.simulate import Chain, Dynamics, Simulation
from bozzini.physics.study import Scenery, study_execution
from bozzini.physics.walls import NEWTON, Floats, LumenWall
from tests.shapes import bend_curve, tube_lumen

FAST = ExecuteOptions(speed=60.0)


@pytest.mark.parametrize("kind", ["penalty", "prism"])
def test_a_certified_plan_is_driven_without_touching(clear: Scenery, kind) -> None:
    wall = WallOptions(kind=kind)
    found = dataclasses.replace(clear, wall=wall).run(FAST)
    assert found.converged, found.reason
    assert not found.contacts.any()
    assert found.clearance.min() > 0.0
    # What the servos lag behind is all that the tip is off.
    assert found.tip_error.max() < 1.0
    assert found.tip_progress[-1] == pytest.approx(clear.plan.path_arc_length[-1], abs=1.0)


def test_a_body_that_is_too_thick_touches_as_deep_as_it_must(touching: Scenery) -> None:
    found = touching.run(FAST)
    assert found.normal_peak.max() > 0.01
    # The wall is pressed in by no more than the plan itself would be.
    assert found.clearance.min() > touching.plan.clearance.min() - 2.5 - 0.5
    assert (found.normal_sum >= found.normal_peak - 1e-12).all()
    assert (found.normal_sum * math.hypot(1.0, 0.1) >= found.resultant - 1e-9).all()


@pytest.mark.slow
def test_half_the_step_changes_little_and_friction_is_looked_at(touching: Scenery) -> None:
    study = study_execution(touching, FAST, check=True)
    assert study.convergence is not None
    checked = study.convergence.describe()
    assert set(checked) == {"half_step", "friction_0", "friction_0.3"}
    change = checked["half_step"]["normal_sum_N"]
    assert abs(change["change"]) < 0.25 * change["value"]
    assert change["value"] == pytest.approx(study.executions[0].normal_sum.max())
    smooth = checked["friction_0"]
    direct = dataclasses.replace(touching, wall=WallOptions(friction=0.0)).run(FAST)
    assert smooth["normal_sum_N"]["there"] == pytest.approx(direct.normal_sum.max())
    assert smooth["resultant_N"]["there"] <= smooth["normal_sum_N"]["there"]
    assert checked["friction_0.3"]["normal_sum_N"]["change"] != 0.0


@pytest.mark.slow
def test_both_walls_press_about_as_hard_at_the_same_moments(clear: Scenery) -> None:
    thick = dataclasses.replace(clear.plan, scope=Scope(diameter=8.0, link_length=8.0))
    dragged = dataclasses.replace(FAST, drive="tractrix")
    ball, prism = (
        dataclasses.replace(clear, plan=thick, wall=WallOptions(kind=kind, stiffness=1.0))
        .run(dragged).normal_sum for kind in ("penalty", "prism")
    )  # fmt: skip
    pressed = ball > 0.05
    assert np.count_nonzero(pressed) > 8
    assert 0.8 < np.median(prism[pressed] / ball[pressed]) < 1.25
    assert prism.max() == pytest.approx(ball.max(), rel=0.3)


def test_a_run_is_repeated_exactly(touching: Scenery) -> None:
    one, two = (touching.run(FAST, repeat=2) for _ in range(2))
    other = touching.run(FAST, repeat=3)
    assert np.array_equal(one.normal_sum, two.normal_sum)
    assert not np.array_equal(one.joints[0], other.joints[0])


def test_joints_are_where_the_plan_has_them(clear: Scenery) -> None:
    drive = PlanDrive(clear.plan)
    simulation = Simulation(drive.chain)
    for step in (0, len(clear.plan.joints) // 2, -1):
        simulation.place(drive.table[step])
        assert simulation.joints == pytest.approx(clear.plan.joints[step], abs=1e-6)


def test_bends_of_a_chain_in_any_direction() -> None:
    random = np.random.default_rng(3)
    ways = np.cumsum(0.3 * random.standard_normal((5, 7, 3)), axis=1) + [0.0, 0.0, 1.0]
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    joints = np.concatenate([np.zeros((5, 1, 3)), np.cumsum(4.0 * ways, axis=1)], axis=1)
    base = carry_frames(np.array([[0.6, 0.0, 0.8]]))[0]
    frame = np.eye(4)
    frame[:3, :3] = base
    chain = Chain(
        lengths=np.full(7, 4.0), radius=1.0, frame=frame, springs=np.zeros(7), servos=np.ones(7)
    )
    simulation = Simulation(chain)
    for row, bends in zip(joints, find_bends(joints, base), strict=True):
        simulation.place(np.append(0.0, bends))
        assert simulation.joints[::-1] == pytest.approx(row, abs=1e-6)


def test_a_cantilever_bends_as_euler_and_bernoulli_say() -> None:
    rigidity, length, force = 500.0, 80.0, 0.002
    off = []
    for count in (8, 16):
        lengths = np.full(count, length / count)
        chain = Chain(
            lengths=lengths,
            radius=2.0,
            frame=np.eye(4),
            springs=spread_rigidity(np.full(count, rigidity), lengths),
            servos=np.zeros(count),
        )
        simulation = Simulation(chain, dynamics=Dynamics(step=0.005))
        # At the tip: a force, and its moment about the last link's middle.
        simulation.data.xfrc_applied[-1, 0] = 1e3 * force
        simulation.data.xfrc_applied[-1, 4] = 1e3 * force * 0.5 * lengths[0]
        for _ in range(4000):
            simulation.step(np.array([0.0]))
        sag = force * length**3 / (3.0 * rigidity)
        off.append(abs(simulation.joints[0, 0] - sag) / sag)
    assert off[1] < 0.01
    assert off[1] < off[0]


def test_a_scope_that_is_pushed_harder_against_its_way_needs_more_force(clear: Scenery) -> None:
    forces = []
    for rigidity in (100.0, 1000.0):
        scenery = dataclasses.replace(
            clear,
            scope=ScopeOptions(rigidity=rigidity, tip_length=16.0),
            wall=WallOptions(stiffness=2.0),
        )
        found = scenery.run(dataclasses.replace(FAST, drive="push"))
        assert not found.outside
        forces.append(found.normal_sum.max())
    # In a bend of one radius an elastic rod presses in proportion to its stiffness.
    assert 4.0 < forces[1] / forces[0] < 16.0


def test_a_blind_end_makes_a_pushed_scope_loop_and_the_place_is_said() -> None:
    from bozzini.motion.scope import Introducer
    from bozzini.physics.walls import LumenWall
    from tests.shapes import ball_distance, sample_field

    field = sample_field(ball_distance([0.0, 0.0, 0.0], 30.0), [-34.0] * 3, [34.0] * 3, 1.0)
    tube = Introducer(
        entry=np.array([3.0, 0.0, -25.0]), outward=np.array([0.0, 0.0, -1.0]), bore=4.0
    )
    line = np.array([[3.0, 0.0, -25.0], [3.0, 0.0, 0.0], [3.0, 0.0, 60.0]])
    line = np.stack([np.interp(np.arange(86.0), [0.0, 25.0, 85.0], c) for c in line.T], axis=1)
    drive = PushDrive(
        line=line, introducer=tube, diameter=4.0, length=150.0, link=6.0, speed=60.0,
        options=ScopeOptions(rigidity=100.0), steered=False,
    )  # fmt: skip
    wall = LumenWall(duct=field, introducer=tube, guide=2.5, options=WallOptions(stiffness=1.0))
    found = execute(drive, wall, line=line)
    assert not found.converged and not found.outside
    assert 50.0 < found.looped_at < 90.0
    assert "no longer advances" in found.reason
    assert np.abs(found.looped_place).max() < 31.0
    # It stops soon after, and the force at the mouth is no more than Euler's load of what is in.
    assert found.inserted.max() < found.looped_at + 50.0


def test_a_link_outside_the_lumen_is_an_error_and_no_picture(clear: Scenery) -> None:
    soft = dataclasses.replace(
        clear,
        scope=ScopeOptions(rigidity=5000.0, tip_bend=0.0),
        wall=WallOptions(stiffness=0.001, friction=0.0),
    )
    found = soft.run(dataclasses.replace(FAST, drive="push"))
    assert found.outside and not found.converged
    assert found.reason.startswith("a link is outside the lumen after")


def test_a_last_joint_off_the_introducers_axis_is_held_by_a_link_more(clear: Scenery) -> None:
    tube = clear.plan.get_introducer()
    joints = clear.plan.joints.copy()
    aside = carry_frames(tube.outward[None])[0, :, 0]
    # The last link is turned about its front joint.
    lean = np.array([0.9, 0.1]) @ np.stack([tube.outward, aside])
    joints[-1, -1] = joints[-1, -2] + 8.0 * lean / np.linalg.norm(lean)
    plan = dataclasses.replace(clear.plan, joints=joints)
    drive = PlanDrive(plan)
    assert len(drive.chain.lengths) == plan.links + 1
    simulation = Simulation(drive.chain)
    simulation.place(drive.table[-1])
    assert simulation.joints[:-1] == pytest.approx(joints[-1], abs=1e-6)
    joints[-1, -1] += 20.0 * aside
    with pytest.raises(InputError, match="off the introducer's axis"):
        PlanDrive(dataclasses.replace(clear.plan, joints=joints))


def test_a_dragged_chain_keeps_its_links_and_its_head_but_not_the_wall(clear: Scenery) -> None:
    plan = clear.plan
    dragged = drag_chain(plan)
    assert dragged.joints[:, 0] == pytest.approx(plan.joints[:, 0], abs=0.05)
    lengths = np.linalg.norm(np.diff(dragged.joints, axis=1), axis=2)
    assert lengths == pytest.approx(8.0)
    # Each joint moves along its link, but for what the step is long.
    moves = np.diff(dragged.joints[:, 1], axis=0)
    links = dragged.joints[1:, 0] - dragged.joints[1:, 1]
    across = np.linalg.norm(np.cross(moves, links), axis=1) / 8.0
    assert across.max() < 0.1
    found = clear.run(dataclasses.replace(FAST, drive="tractrix"))
    assert found.drive == "tractrix"
    assert found.clearance.min() < clear.run(FAST).clearance.min()


def test_forces_and_work_of_drives_do_not_depend_on_the_step(clear: Scenery) -> None:
    runs = [clear.run(dataclasses.replace(FAST, step=step)) for step in (0.004, 0.001)]
    pushes = [np.abs(found.push_force).max() for found in runs]
    assert pushes[0] == pytest.approx(pushes[1], rel=0.3)
    assert runs[0].work[-1] == pytest.approx(runs[1].work[-1], rel=0.15)
    # From rest, drives give energy and take none that they did not give.
    assert all(found.work.min() >= 0.0 for found in runs)


def test_work_on_a_free_mass_is_its_energy() -> None:
    works = []
    for step in (0.002, 0.001):
        chain = Chain(
            lengths=np.array([10.0]), radius=3.0, frame=np.eye(4), springs=np.zeros(1),
            servos=np.full(1, 500.0),
        )  # fmt: skip
        simulation = Simulation(chain, dynamics=Dynamics(step=step))
        for k in range(1, round(0.2 / step) + 1):
            time = k * step
            way, speed = 250.0 * time**2, 500.0 * time
            simulation.step(np.array([way, 0.0, 0.0]), np.array([speed, 0.0, 0.0]))
        mass = float(simulation.model.body_mass.sum())
        energy = 0.5 * mass * float(simulation.data.qvel[0]) ** 2 / NEWTON
        works.append(simulation.work / energy)
    # The integration loses half the square of each change of velocity: less with a shorter step.
    assert works[1] == pytest.approx(1.0, abs=0.02)
    assert abs(works[1] - 1.0) < abs(works[0] - 1.0)


def test_how_far_a_tip_is_does_not_depend_on_how_finely_its_way_is_given() -> None:
    way = bend_curve(20.0, math.pi, 20.0)
    places = []
    for part in (1, 2, 4):
        line = np.vstack([way[:-1:part], way[-1]])
        arc = measure_arc_length(line)
        before, found = 0.0, []
        for tip in way[:-1] + 0.3 * np.diff(way, axis=0) + [0.0, 1.0, 0.0]:
            before = follow_way(line, arc, tip, before=before)
            found.append(before)
        places.append(found)
    assert (np.diff(places[0]) > 0.0).all()
    # A chord is shorter than its arc, and a place beside it is seen under another angle.
    assert places[1] == pytest.approx(places[0], abs=0.25)
    assert places[2] == pytest.approx(places[0], abs=0.5)


def test_results_have_the_usual_forms(touching: Scenery, tmp_path) -> None:
    study = study_execution(touching, FAST)
    frame = study.executions[0].to_frame()
    assert {"time_s", "push_force_N", "normal_peak_N", "tip_error_mm"} <= set(frame)
    assert len(study.to_frame()) == 1
    assert study.plot().get_ylabel() == "force [N]"
    summary = study.write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(summary["files"])
    table = study.executions[0].list_contacts()
    assert np.max(table["normal_force_N"]) == pytest.approx(summary["normal_peak_N"])
    forces = study.executions[0].map_forces(np.column_stack([table[f"{a}_mm"] for a in "xyz"]))
    assert forces.max() == pytest.approx(summary["normal_peak_N"])


def test_an_introducer_that_stands_outside_ends_at_the_entry(clear: Scenery) -> None:
    tube = clear.plan.get_introducer()
    frame = stand_outside(tube, 50.0)
    assert frame[:3, 3] + 50.0 * frame[:3, 2] == pytest.approx(tube.entry)
    assert isinstance(clear.plan, Plan)


def test_a_wall_gives_way_by_force_over_stiffness_and_is_smooth(touching: Scenery) -> None:
    import trimesh

    found = touching.run(FAST)
    place = found.touched[np.argmax(found.touched[:, 8]), 2:5]
    # A plane through the place that is pressed most, seen from below.
    mesh = trimesh.creation.box([60.0, 60.0, 1.0]).subdivide_to_size(1.5)
    mesh.apply_translation(place - [0.0, 0.0, 0.5])
    surface = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    sharp, moved = found.displace_wall(surface, spread=0.0)
    assert moved.max() == pytest.approx(found.normal_peak.max() * found.compliance)
    assert np.linalg.norm(sharp - surface[0], axis=1) == pytest.approx(moved)
    smooth = found.displace_wall(surface, spread=6.0)[1]
    assert 0.0 < smooth.max() < moved.max()
    assert np.count_nonzero(smooth > 1e-6) > np.count_nonzero(moved > 1e-6)


def settle_tendons(robot: ContinuumRobot, pulls: Floats, most: float) -> Floats:
    """Return the tip of a free robot whose tendons are pulled slowly."""
    simulation = Simulation(
        build_tendon_chain(robot, np.eye(4), most=most), dynamics=Dynamics(damping=1.0)
    )
    for k in range(2000):
        simulation.step(np.append(0.0, -min(1.0, k / 1000.0) * pulls))
    assert np.abs(simulation.data.qvel).max() < 1e-3
    return simulation.joints[0]


@pytest.mark.parametrize("turns", [0.0, 0.2])
def test_tendons_bend_a_free_robot_as_its_least_energy_does(turns: float) -> None:
    """Several sections, bent across both hinges, whose tendons stretch; straight and helical."""
    sections = tuple(
        Section(
            length=20.0,
            tendons=tuple(
                Tendon(
                    name=f"s{j}t{k}", offset=2.5, stiffness=5000.0,
                    angle=Helix(start=0.3 * j + k * 2.0 * math.pi / 3.0, turns=turns),
                )
                for k in range(3)
            ),
            radius=3.0,
            bending_stiffness=200.0,
            torsional_stiffness=2e4,
        )
        for j in range(3)
    )  # fmt: skip
    robot = ContinuumRobot(sections)
    places = np.array([tendon.place_at(0.0) for tendon in robot.tendons])
    bends = np.array([[0.5, 0.5], [-0.2, 0.7], [0.6, -0.5]])
    reached = np.arange(3) <= np.repeat(np.arange(3), 3)[:, None]
    pulls = (reached * (places @ bends.T)).sum(axis=1)
    wanted = EnergyModel(robot, segment="channel", between=7).shape(pulls)
    assert wanted.converged
    off = [
        float(np.linalg.norm(settle_tendons(robot, pulls, most) - wanted.points[-1]))
        for most in (10.0, 5.0)
    ]
    assert off[1] < 0.005 * robot.length
    assert off[1] < 0.4 * off[0]


def test_tendons_of_stated_length_bend_a_free_robot_as_arcs_do() -> None:
    tendons = tuple(
        Tendon(name=f"t{k}", offset=3.0, angle=k * 2.0 * math.pi / 3.0, stiffness=1e5)
        for k in range(3)
    )
    robot = ContinuumRobot(
        (Section(length=60.0, tendons=tendons, radius=4.0, bending_stiffness=200.0),)
    )
    simulation = Simulation(build_tendon_chain(robot, np.eye(4)))
    bend = 0.6
    pulls = np.array([3.0 * bend * math.cos(k * 2.0 * math.pi / 3.0) for k in range(3)])
    for k in range(2000):
        simulation.step(np.append(0.0, -min(1.0, k / 1000.0) * pulls))
    angle = math.acos(float(simulation.tip_frame[2, 2]))
    assert angle == pytest.approx(bend, rel=0.01)
    arc = 60.0 / bend
    assert simulation.joints[0, 0] == pytest.approx(arc * (1.0 - math.cos(bend)), rel=0.01)
    assert simulation.joints[0, 2] == pytest.approx(arc * math.sin(bend), rel=0.01)


def test_contacts_past_the_entry_plane_count_unless_they_are_the_introducers() -> None:
    # A tract that comes back past its entry, and bends there where the body is too thick for it.
    hook = bend_curve(18.0, math.pi, 20.0)
    down = hook[-1] + np.arange(1.0, 16.0)[:, None] * [0.0, 0.0, -1.0]
    aside = bend_curve(12.0, 0.5 * math.pi, 0.0) * [1.0, 1.0, -1.0]
    field, line = tube_lumen(np.concatenate([hook, down, down[-1] + aside[1:]]), 6.0)
    plan = plan_insertion(field, line, scope=Scope(diameter=6.0, link_length=8.0), method="follow")
    assert plan.status == "complete", plan.reason
    thick = dataclasses.replace(plan, scope=Scope(diameter=11.0, link_length=8.0))
    found = Scenery(plan=thick, duct=field).run(FAST)
    table = found.list_contacts()
    places = np.stack([table["x_mm"], table["y_mm"], table["z_mm"]], axis=1)
    tube = plan.get_introducer()
    along = (places - tube.entry) @ tube.outward
    away = np.linalg.norm(places - tube.entry - along[:, None] * tube.outward, axis=1)
    past = along > 5.0
    assert table["normal_force_N"][past].max() > 0.01
    assert away[past].min() > 20.0
    wall = LumenWall(duct=field, introducer=tube)
    beside = tube.entry + 10.0 * tube.outward + [0.99 * tube.bore, 0.0, 0.0]
    assert wall.is_introducer(np.stack([beside, places[past][0]])).tolist() == [True, False]
