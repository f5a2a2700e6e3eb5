"""A robot with sensors: what the windows are sent is what the estimator says, row by row."""

from __future__ import annotations

import asyncio
import io
import sys

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.cockpit.readings import BAND, LOOKS, SensedRobot
from bozzini.cockpit.session import Session
from bozzini.cockpit.wire import TISSUE
from bozzini.errors import InputError
from bozzini.study.estimating import ContinuumEstimating
from tests.continuum.test_estimation import MODEL, write_table
from tests.scene.decode_view import decode_view


@pytest.fixture
def task(tmp_path, monkeypatch) -> ContinuumEstimating:
    write_table(tmp_path / "table.csv")
    monkeypatch.setattr(sys, "stdin", io.StringIO((tmp_path / "table.csv").read_text()))
    robot = MODEL.robot.to_yaml(tmp_path / "robot.yaml")
    return ContinuumEstimating(robot=str(robot), table=str(tmp_path / "table.csv"))


def read_tubes(client) -> list[np.ndarray]:
    """Return the rings (stations, sides, 3) of the next shapes that come."""
    tubes = []
    while len(tubes) < len(LOOKS):
        data = client.recv(timeout=10)
        if isinstance(data, bytes) and int.from_bytes(data[:4], "little") == TISSUE:
            places = np.frombuffer(data, "<f4", offset=8).astype(float)
            tubes.append(places.reshape(-1, LOOKS[len(tubes)][3], 3))
    return tubes


def test_commanded_and_estimated_shape_and_its_band_are_shown(serve, task) -> None:
    session, found = Session(), list(task.follow())
    served = serve(session)
    live = ContinuumEstimating(robot=task.robot, table="-")
    asyncio.run(SensedRobot(live, session).run())
    (estimate,) = found[-1].estimates
    tubes = read_tubes(served.connect())  # a window that is opened later, too
    middles = [tube.mean(axis=1) for tube in tubes]
    for middle, line in zip(middles, (estimate.commanded, *[estimate.points] * 2), strict=True):
        np.testing.assert_allclose(middle, line, atol=1e-4)
    assert np.linalg.norm(estimate.tip - estimate.commanded[-1]) > 1e-3
    radii = [
        np.linalg.norm(tube - middle[:, None], axis=2).mean(axis=1)
        for tube, middle in zip(tubes, middles, strict=True)
    ]
    np.testing.assert_allclose(radii[1], MODEL.robot.radius, atol=1e-4)
    # The band holds the ellipsoid of two deviations, across the body, and no more than that.
    ways = estimate.frames[:, :3, 0], estimate.frames[:, :3, 1]
    spread = [
        BAND * np.sqrt(np.einsum("ki,kij,kj->k", way, estimate.covariance[:, 3:, 3:], way))
        for way in ways
    ]
    band = radii[2] - radii[1]
    assert (band > np.maximum(*spread) - 1e-4).all() and (band < np.hypot(*spread) + 1e-4).all()
    assert band[-1] > 0.01
    # The picture itself is that of the last row, and the words are.
    view = decode_view(served.get("/view.bin")[2])
    assert [one["name"] for one in view["surfaces"]] == ["base", *(look[0] for look in LOOKS)]
    # What moves is known by how many vertices it has.
    assert len({len(one["vertices"]) for one in view["surfaces"]}) == 1 + len(LOOKS)
    words = served.state()["readings"]
    assert words.startswith("Row 3, 2.00 s\nTip at ") and words.endswith("these are all the rows.")
    assert f"{estimate.tip[0]:.1f} ± {BAND * estimate.deviations[-1, 0]:.1f}" in words


def test_rows_of_a_file_come_in_their_time(task, monkeypatch) -> None:
    waits: list[float] = []

    async def sleep(delay: float) -> None:
        waits.append(delay)

    monkeypatch.setattr(asyncio, "sleep", sleep)
    session = Session()
    asyncio.run(SensedRobot(task, session).run())
    assert len(waits) == 3 and session.tissue_number == 3
    assert np.diff(waits) == pytest.approx(1.0, abs=0.9) and waits[0] < 0.01


def test_row_that_is_not_legal_ends_it_with_words_and_the_first_with_an_error(
    task, monkeypatch
) -> None:
    lines = (sys.stdin).read().splitlines()
    live = ContinuumEstimating(robot=task.robot, table="-")
    session = Session()
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join([*lines[:3], "-1" + lines[3][1:]])))
    asyncio.run(SensedRobot(live, session).run())
    assert session.describe()["readings"].endswith(
        "Ended: row 4: time -1 s is before the last row's."
    )
    monkeypatch.setattr(sys, "stdin", io.StringIO(lines[0].replace("displacement", "move") + "\n1"))
    with pytest.raises(InputError):
        asyncio.run(SensedRobot(live, Session()).run())


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ((), "--readings needs --robot"),
        (("--robot", "robot.yaml", "--rig", "demo"), "--rig cannot be used with --readings"),
        (("--robot", "robot.yaml", "tract.stl"), "INPUT cannot be used with --readings"),
        (("--robot", "robot.yaml", "--link", "5mm"), "--link cannot be used with --readings"),
        (("--robot", "robot.yaml"), "none.csv: there is no such file"),
    ],
)
def test_wrong_options_are_one_line(task, capsys, tmp_path, monkeypatch, more, words) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tract.stl").write_text("")
    given = ["--readings", "none.csv", *more, "--port", "0", "--no-browser"]
    assert main(["cockpit", *given]) == 2
    out, err = capsys.readouterr()
    assert not out and err.count("\n") == 1 and words in err
