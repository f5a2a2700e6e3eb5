"""Logs of motions: what is written is what is read, in metres."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from bozzini.continuum import simulate, write_mcap
from bozzini.errors import OutputError
from tests.continuum.test_dynamics import make_arm


def test_a_log_has_the_motion(tmp_path) -> None:
    times = np.linspace(2.0, 2.05, 6)
    pulls = np.outer(times - 2.0, [20.0, 0.0, 0.0, 10.0, 0.0, 0.0])
    moved = simulate(make_arm(), times, tensions=pulls)
    path = write_mcap(moved, tmp_path / "motion.mcap")
    with path.open("rb") as file:
        read = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    assert [one.channel.topic for one in read[:3]] == ["/shape", "/tendons", "/wall_force"]
    shapes, tendons = (
        [one for one in read if one.channel.topic == topic] for topic in ("/shape", "/tendons")
    )
    assert [one.message.log_time for one in shapes] == [2 * 10**9 + k * 10**7 for k in range(6)]
    last = shapes[-1].decoded_message
    assert last.header.stamp.sec == 2 and last.header.stamp.nanosec == 5 * 10**7
    assert last.header.frame_id == "world"
    poses = [one.pose for one in last.poses]
    places = [[one.position.x, one.position.y, one.position.z] for one in poses]
    np.testing.assert_allclose(np.array(places), 1e-3 * moved.points[-1], atol=1e-12)
    turns = [[getattr(one.orientation, axis) for axis in "xyzw"] for one in poses]
    np.testing.assert_allclose(
        Rotation.from_quat(turns).as_matrix(), moved.frames[-1, :, :3, :3], atol=1e-9
    )
    pulled = [one.decoded_message for one in tendons]
    assert list(pulled[0].name) == list(moved.robot.tendon_names)
    np.testing.assert_allclose([one.effort for one in pulled], moved.tensions)
    np.testing.assert_allclose([one.position for one in pulled], 1e-3 * moved.displacements)


def test_another_ending_is_refused(tmp_path) -> None:
    moved = simulate(make_arm(), [0.0, 1e-3])
    with pytest.raises(OutputError, match=r"\.mcap"):
        write_mcap(moved, tmp_path / "motion.bag")
    assert not list(tmp_path.iterdir())


def test_times_before_zero_are_told_from_the_first_on(tmp_path) -> None:
    path = write_mcap(simulate(make_arm(), [-1.0, -0.99]), tmp_path / "motion.mcap")
    with path.open("rb") as file:
        stamps = {message.log_time for _, _, message in make_reader(file).iter_messages()}
    assert stamps == {0, 10**7}
