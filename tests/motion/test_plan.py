"""Plans and scopes: checked when built, and a file that others can open."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.errors import FileFormatError, OutputError
from bozzini.motion import Plan, Scope, verify_plan


def make_plan(steps=4, count=3, **changes):
    random = np.random.default_rng(7)
    values: dict = {
        "joints": random.normal(size=(steps, count, 3)),
        "head_arc_length": np.arange(float(steps)),
        "clearance": random.normal(size=(steps, count - 1)),
        "path": random.normal(size=(5, 3)),
        "path_arc_length": np.arange(5.0),
        "path_radius": np.ones(5),
        "method": "thesis",
        "status": "stopped",
        "reason_code": "LINK_LOCKED",
        "reason": "link 2 locks",
        "scope": Scope(diameter=5.0, link_length=2.0),
        "more": {"text": "naïve µm"},
    }
    return Plan(**{**values, **changes})


@given(steps=st.integers(1, 6), joints=st.integers(2, 6))
def test_a_saved_plan_comes_back_whole(tmp_path_factory, steps, joints):
    plan = make_plan(steps, joints)
    path = tmp_path_factory.mktemp("plan") / "plan.npz"
    assert plan.save(path) == path
    back = Plan.load(path)
    for name in ("joints", "head_arc_length", "clearance", "path", "path_radius"):
        assert np.array_equal(getattr(back, name), getattr(plan, name))
    assert (back.status, back.reason, back.method) == (plan.status, plan.reason, plan.method)
    assert back.more["text"] == "naïve µm"
    assert (back.steps, back.links) == (steps, joints - 1)


def test_the_file_opens_with_numpy_alone(tmp_path):
    path = make_plan().save(tmp_path / "plan.npz")
    with np.load(path, allow_pickle=False) as data:
        meta = json.loads(str(data["meta"]))
        assert data["joints"].shape == (4, 3, 3)
    assert meta["scope"]["diameter_mm"] == 5.0
    assert meta["format"].startswith("bozzini-plan")


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04broken"])
def test_a_file_that_is_no_plan_is_refused(tmp_path, content):
    path = tmp_path / "plan.npz"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="is not a Bozzini plan"):
        Plan.load(path)
    with pytest.raises(FileFormatError, match="no such file"):
        Plan.load(tmp_path / "other.npz")
    np.savez(tmp_path / "some.npz", a=np.zeros(3))
    with pytest.raises(FileFormatError, match="is not a Bozzini plan"):
        Plan.load(tmp_path / "some.npz")


def test_a_plan_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(OutputError, match="cannot write"):
        make_plan().save(tmp_path / "missing" / "plan.npz")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("length", [None, 60.0])
def test_the_scope_is_the_same_in_the_file(tmp_path, length):
    plan = make_plan()
    scope = Scope(diameter=5.0, link_length=8.0, length=length)
    again = Plan.load(replace(plan, scope=scope).save(tmp_path / "plan.npz"))
    assert again.scope == scope
    assert ("length_mm" in again.meta["scope"]) == (length is not None)


@given(length=st.floats(1.0, 50.0), path=st.floats(1.0, 900.0))
def test_a_scope_reaches_the_end_of_its_path(length, path):
    links = Scope(diameter=1.0, link_length=length).count_links(path)
    assert links * length >= path * (1 - 1e-9)
    assert (links - 1) * length < path or links == 1


OLD = Path(__file__).parents[1] / "data"


@pytest.mark.parametrize("name", ["best", "soft", "stopped"])
def test_a_file_of_version_0_1_says_the_same_when_it_is_written_again(tmp_path, name):
    source = OLD / f"plan_0_1_{name}.npz"
    plan = Plan.load(source)
    again = plan.save(tmp_path / "plan.npz")
    with np.load(source) as old, np.load(again) as new:
        assert set(old.files) == set(new.files)
        for array in set(old.files) - {"meta"}:
            assert np.array_equal(old[array], new[array])
        stated, written = (json.loads(str(data["meta"])) for data in (old, new))
    assert written == stated
    assert plan.scope.diameter == stated["scope"]["diameter_mm"]
    assert plan.introducer.bore == stated["introducer"]["bore_mm"]
    assert plan.certified == stated["certified"]
    assert plan.input.voxel == stated["input"]["voxel_mm"]
    assert plan.options.route == tuple(stated["options"]["route"])
    assert (plan.refusal is None) == ("refusal" not in stated)
    assert all(check.ok for check in verify_plan(plan).checks)


def test_a_plan_is_a_result_with_a_table_and_a_picture():
    for name, complete in (("best", True), ("stopped", False)):
        plan = Plan.load(OLD / f"plan_0_1_{name}.npz")
        assert plan.converged is complete and (plan.residual < 0.01) is complete
        frame = plan.to_frame()
        assert len(frame) == plan.steps
        assert np.array_equal(frame["head_arc_length_mm"], plan.head_arc_length)
        assert frame["clearance_mm"].min() == plan.clearance_min
        assert json.loads(json.dumps(plan.to_dict()))["reason_code"] == plan.reason_code
        assert "head_arc_length_mm" in plan._repr_html_()
        axes = plan.plot()
        assert plan.plot(axes) is axes and "clearance" in axes.get_ylabel()
