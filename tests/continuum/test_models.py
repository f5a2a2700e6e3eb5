"""A robot's own verbs, its results, and models that another package adds."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pandas
import pytest
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from bozzini.checks import quantity
from bozzini.cli.main import main
from bozzini.continuum import (
    CONTINUUM_MODELS,
    ArcModel,
    ContinuumModel,
    EnergyModel,
    RodModel,
    Shape,
    arc_frames,
    displacements_for,
    sample_workspace,
    solve_curve,
    solve_pose,
    solve_tip,
)
from bozzini.continuum.coupling import check_displacements, coupling_matrix
from bozzini.errors import GeometryError, InputError
from tests.continuum.robots import THIRD, make_robot

BENDS = np.array([[0.5, -0.2], [0.3, 0.6]])
ROBOT = make_robot(THIRD, (60.0, 180.0, 300.0), length=40.0)
PULLED = displacements_for(ROBOT, BENDS)


@dataclass(frozen=True)
class SoftArcs(ContinuumModel):
    """Arcs that take a share of what the tendons ask for."""

    share: float = quantity(help="Share.", low=0.0, high=1.0, default=0.5, kw_only=True)

    name = "soft"

    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes under tendon displacements."""
        commands = check_displacements(self.robot, displacements)
        inverse = np.linalg.pinv(coupling_matrix(self.robot, model=self.name))
        bends = (self.share * commands @ inverse.T).reshape(*commands.shape[:-1], -1, 2)
        return self.make_shape(
            commands,
            arc_length=self.robot.stations(),
            frames=arc_frames(self.robot, bends),
            section_parameters=bends,
        )


@pytest.fixture
def soft(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("soft", f"{__name__}:SoftArcs", "bozzini.continuum")
    monkeypatch.setattr(EntryPoint, "load", lambda self: SoftArcs)
    monkeypatch.setitem(CONTINUUM_MODELS.__dict__, "plugins", {"soft": point})


@pytest.mark.usefixtures("soft")
def test_a_model_of_another_package_stands_beside_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert list(CONTINUUM_MODELS) == ["arc", "linkage", "energy", "rod", "soft"]
    whole = ROBOT.forward(PULLED, model="soft", share=1.0)
    assert whole.tip == pytest.approx(ROBOT.forward(PULLED).tip)
    half = ROBOT.forward(PULLED, model="soft")
    assert half.section_parameters == pytest.approx(0.5 * BENDS)
    file = str(ROBOT.to_yaml(tmp_path / "robot.yaml"))
    asked = ",".join(f"{n}={d:.9f}" for n, d in zip(ROBOT.tendon_names, PULLED, strict=True))
    for command in (["models"], ["compare", file, "--displacement", asked]):
        assert main(["continuum", *command]) == 0
        assert "soft" in capsys.readouterr().out
    assert main(["continuum", "pose", file, "--displacement", asked, "--model", "soft"]) == 0
    with pytest.raises(InputError, match=r"share is 2: it must lie in \[0, 1\]"):
        ROBOT.forward(PULLED, model="soft", share=2.0)


@dataclass(frozen=True)
class WrongModel(ContinuumModel):
    """A model of one's own that goes wrong."""

    name = "wrong"

    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes of arcs with frames that are not finite."""
        commands = check_displacements(self.robot, displacements)
        right = ArcModel(self.robot).shape(commands)
        wrong = np.full(right.frames.shape, np.nan)
        return self.make_shape(commands, arc_length=right.arc_length, frames=wrong)


def test_frames_that_are_not_finite_are_refused() -> None:
    with pytest.raises(GeometryError, match="frames of the model wrong are not finite"):
        WrongModel(ROBOT).shape([PULLED, 0.5 * PULLED])


def test_forward_chooses_the_model_and_takes_names() -> None:
    assert ROBOT.forward(PULLED).tip.tolist() == ArcModel(ROBOT).shape(PULLED).tip.tolist()
    named = dict(zip(ROBOT.tendon_names, PULLED, strict=True))
    assert ROBOT.forward(named).tip.tolist() == ROBOT.forward(PULLED).tip.tolist()
    several = {name: [value, 0.5 * value] for name, value in named.items()}
    assert ROBOT.forward(several).tip.tolist() == ROBOT.forward([PULLED, 0.5 * PULLED]).tip.tolist()
    batch = ROBOT.forward([PULLED, 0.5 * PULLED], model="energy", segment="channel")
    channel = EnergyModel(ROBOT, segment="channel")
    assert batch.tip.tolist() == channel.shape([PULLED, 0.5 * PULLED]).tip.tolist()
    load = {"tip_force": (0.0, 0.01, 0.0), "tendon_stiffness": 1e4}
    assert ROBOT.forward(PULLED, **load).tip.tolist() == (
        RodModel(ROBOT, **load).shape(PULLED).tip.tolist()
    )


def test_names_of_a_table_are_those_of_the_tendons() -> None:
    mixed = ROBOT.tendon_names[::-1]
    table = pandas.DataFrame([PULLED, 0.5 * PULLED], columns=ROBOT.tendon_names)[list(mixed)]
    wanted = ROBOT.forward([PULLED, 0.5 * PULLED]).tip.tolist()
    assert ROBOT.forward(table).tip.tolist() == wanted
    assert ArcModel(ROBOT).shape(table).tip.tolist() == wanted
    assert ROBOT.forward(table.iloc[1]).tip == pytest.approx(np.array(wanted[1]), abs=1e-12)
    assert ROBOT.forward(pandas.DataFrame([PULLED])).tip.tolist() == wanted[:1]
    some = table[[mixed[0]]].to_dict("series")
    assert ROBOT.forward(table[[mixed[0]]]).tip.tolist() == ROBOT.forward(some).tip.tolist()
    with pytest.raises(InputError, match="there is no tendon 'a'"):
        ROBOT.forward(table.rename(columns={mixed[0]: "a"}))
    with pytest.raises(InputError, match="twice"):
        ROBOT.forward(table.rename(columns={mixed[0]: mixed[1]}))


def test_inverse_takes_a_place_a_pose_and_a_curve() -> None:
    shape = ROBOT.forward(PULLED)
    for target, solve in ((shape.tip, solve_tip), (shape.points[1:], solve_curve)):
        found = ROBOT.inverse(target, tolerance=0.01)
        assert found.converged
        assert found.bends.tolist() == solve(ROBOT, target, tolerance=0.01).bends.tolist()
    found = ROBOT.inverse(tip=shape.tip_frame, starts=8)
    assert found.bends.tolist() == solve_pose(ROBOT, shape.tip_frame, starts=8).bends.tolist()
    assert found.shape().tip == pytest.approx(found.tip)
    moved = ROBOT.jacobian(PULLED)
    # No cable stretches, so that this one can only be let out.
    eased = PULLED - 1e-3 * np.eye(len(ROBOT.tendons))[0]
    ends = [ROBOT.forward(pulled, model="energy").require().tip for pulled in (PULLED, eased)]
    assert moved.by_displacement[-1, 3:, 0] == pytest.approx((ends[0] - ends[1]) / 1e-3, abs=2e-3)
    assert ROBOT.jacobian(tensions=np.ones(len(ROBOT.tendons))).held == "tensions"
    with pytest.raises(InputError, match="the arc model has no derivatives"):
        ROBOT.jacobian(PULLED, model="arc")
    assert ROBOT.workspace(100, seed=3).sample.bends.tolist() == (
        sample_workspace(ROBOT, 100, seed=3).bends.tolist()
    )


def test_results_are_plain_values_tables_and_pictures() -> None:
    shape, found = ROBOT.forward(PULLED), ROBOT.inverse([10.0, 5.0, 75.0])
    space = ROBOT.workspace(200)
    assert shape.to_dict()["tip_mm"] == shape.tip.tolist()
    assert shape.to_frame()["x_mm"].tolist() == shape.points[:, 0].tolist()
    batch = ROBOT.forward([PULLED, -PULLED])
    assert len(batch.to_frame()) == 2 * len(shape.to_frame())
    assert batch.to_dict()["sections"][1]["bend_rad"] == pytest.approx([np.hypot(*BENDS[1])] * 2)
    stuck = ROBOT.forward([PULLED, np.full(len(PULLED), 9.0)])
    stations = len(stuck.arc_length)
    assert stuck.to_frame()["converged"].tolist() == [True] * stations + [False] * stations
    assert set(stuck.to_frame()["reason"]) == set(stuck.reason)
    far = ROBOT.inverse([0.0, 0.0, 700.0]).to_frame()
    assert not far["converged"].any() and far["reason"].str.contains("700 mm").all()
    assert found.to_frame()["displacement_mm"].tolist() == found.displacements.tolist()
    assert space.to_dict()["reach_mm"] == space.volume.reach
    assert shape == shape and shape != ROBOT.forward(PULLED)  # noqa: PLR0124  # by identity
    assert space.sample.to_frame()["tip_z_mm"].tolist() == space.sample.tips[:, 2].tolist()
    assert space.map.to_frame().equals(space.to_frame())
    assert space.volume.to_frame()["hull_mm3"].tolist() == [space.volume.hull]
    for result in (shape, found, space, space.sample, space.map, space.volume):
        assert {"converged", "reason"} <= set(result.to_dict())
    for result in (shape, found, space, space.sample, space.map, ROBOT):
        assert isinstance(result.plot(), Axes)
