"""Steps of a motion by their error, and drives that follow commands at a limited speed."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from bozzini.cli.main import main
from bozzini.continuum import ContactOptions, DynamicsOptions, PointLoad, simulate
from bozzini.continuum.dynamics import _limit_rate
from bozzini.errors import InputError
from tests.continuum.test_capstan import Tub, make_arm

OPTIONS = DynamicsOptions(segment="channel", damping_time=3e-3, max_step=0.05)
TIMES = np.array([0.0, 0.5, 0.52, 0.6, 0.7])
"""Nothing happens, then tendons are pulled within 20 ms."""


def pull(given: str, friction: float, options: DynamicsOptions):
    rows = np.zeros((5, 2)) + (0.3 if given == "tensions" else 0.0)
    rows[2:, 0] += 3.0 if given == "tensions" else 1.5
    moved = simulate(make_arm(friction), TIMES, **{given: rows}, options=options)
    assert moved.converged
    return moved


@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("given", ["tensions", "displacements"])
def test_the_error_follows_the_tolerance(given: str, friction: float) -> None:
    exact = pull(given, friction, dataclasses.replace(OPTIONS, max_step=5e-5))
    errors, counts = [], []
    for tolerance in (1e-3, 1e-5):
        moved = pull(given, friction, dataclasses.replace(OPTIONS, step_tolerance=tolerance))
        errors.append(np.linalg.norm(moved.tip - exact.tip, axis=-1)[2:])
        counts.append(moved.iterations)
    # A step errs by its third power, a motion by the second: by the 2/3 power of the tolerance.
    assert 8.0 < errors[0][0] / errors[1][0] < 50.0
    assert errors[0].max() < 0.05 and errors[1].max() < 2e-3
    for count in counts:
        assert count[1] < 20 < count[2]  # 0.5 s in which nothing happens
    assert counts[1].sum() > 1.5 * counts[0].sum()
    fixed = pull(given, friction, dataclasses.replace(OPTIONS, max_step=2e-4))
    assert fixed.iterations.sum() > 2.0 * counts[1].sum()


def test_steps_by_their_error_among_walls() -> None:
    times = np.array([0.0, 0.5, 1.0, 2.0])
    pulls = np.outer([0.0, 3.0, 5.0, 5.0], [1.0, 0.0])
    known = {"tensions": pulls, "duct": Tub(), "contact": ContactOptions(wall_stiffness=0.5)}
    tips = [
        simulate(make_arm(), times, options=options, **known).tip[-1]
        for options in (
            dataclasses.replace(OPTIONS, max_step=1e-3),
            dataclasses.replace(OPTIONS, max_step=5e-3, step_tolerance=1e-3),
        )
    ]
    assert np.linalg.norm(tips[0] - tips[1]) < 0.05


def test_a_drive_follows_at_its_speed() -> None:
    times = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    wanted = np.array([[0.0, 2.0, 0.2, 0.2, 1.0], [0.0, 0.5, 1.5, -1.5, -1.5]]).T
    turns, places = _limit_rate(times, wanted, wanted[0], 1.0)
    assert set(times) <= set(turns.tolist())
    fine = np.linspace(0.0, 4.0, 40001)
    for column in range(2):
        follows = np.zeros(len(fine))  # a drive in small steps
        aims = np.interp(fine, times, wanted[:, column])
        for k in range(1, len(fine)):
            follows[k] = follows[k - 1] + np.clip(aims[k] - follows[k - 1], -1e-4, 1e-4)
        np.testing.assert_allclose(np.interp(fine, turns, places[:, column]), follows, atol=3e-4)


def test_a_motion_with_slow_drives_is_that_of_their_ways() -> None:
    robot, times = make_arm(0.2), np.linspace(0.0, 0.6, 7)
    wanted = np.zeros((7, 2))
    wanted[2:4] = [2.0, -1.0]
    turns, places = _limit_rate(times, wanted, wanted[0], 8.0)
    assert 7 < len(turns) < 12

    def shake(rows):
        base = np.tile(np.eye(4), (7, 1, 1))
        base[:, :3, 3] = 2.0 * np.sin(np.outer(times, [13.0, 17.0, 8.0]))
        vectors = 0.2 * np.sin(np.outer(times, [5.0, 0.0, 0.0]))
        moved = np.tile(np.eye(4), (len(rows), 1, 1))
        moved[:, :3, 3] = CubicSpline(times, base[:, :3, 3])(rows)
        moved[:, :3, :3] = Rotation.from_rotvec(CubicSpline(times, vectors)(rows)).as_matrix()
        return moved

    factors = np.cos(20.0 * times)[:, None]
    known = {"loads": [PointLoad(force=(0.0, 0.05, 0.0))]}
    options = DynamicsOptions(segment="channel", damping_time=5e-3)
    slow = simulate(
        robot, times, displacements=wanted, base=shake(times), load_factors=factors,
        drive_rate=8.0, options=options, **known,
    )  # fmt: skip
    told = simulate(
        robot, turns, displacements=places, base=shake(turns), options=options,
        load_factors=np.interp(turns, times, factors[:, 0])[:, None], **known,
    )  # fmt: skip
    own = np.searchsorted(turns, times)
    np.testing.assert_allclose(slow.tip, told.tip[own], atol=1e-6)
    np.testing.assert_allclose(slow.displacements, places[own], atol=1e-9)
    assert slow.iterations.sum() == told.iterations.sum()
    # What comes after it begins where the drives are.
    following = {"drive_rate": 2.0, "options": options, "initial": slow}
    then = simulate(robot, [0.6, 0.7], displacements=[[1.0, 0.0]] * 2, **following)
    np.testing.assert_allclose(then.displacements[:, 0], [0.0, 0.2], atol=1e-9)
    with pytest.raises(InputError, match="displacements must be commanded"):
        simulate(robot, [0.0, 1.0], tensions=[0.0, 0.0], drive_rate=2.0)
    with pytest.raises(InputError, match="drive_rate"):
        simulate(robot, [0.0, 1.0], displacements=[0.0, 0.0], drive_rate=0.0)


def test_simulate_command_has_slow_drives_and_friction(tmp_path, capsys) -> None:
    make_arm(0.2).to_yaml(tmp_path / "arm.yaml")
    (tmp_path / "pulls.csv").write_text(
        "time [s],A displacement [mm],B displacement [mm]\n0,0,0\n0.1,2,-2\n0.2,2,-2\n"
    )
    words = ["continuum", "simulate", str(tmp_path / "arm.yaml"), str(tmp_path / "pulls.csv")]
    options = ["--drive-rate", "5mm/s", "--step-tolerance", "0.01mm", "--damping-time", "5ms"]
    assert main([*words, *options, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["tendons"]["A"]["displacement_mm"] == pytest.approx([0.0, 0.5, 1.0])
    assert found["energy"]["friction_N_mm"][-1] > 0.0
    assert main([*words, "--drive-rate", "-1mm/s"]) == 2
    assert "drive" in capsys.readouterr().err
