"""A motion's own record: what it refuses to hold, its points in time, and its file."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bozzini.continuum import ArcModel, ContinuumRobot, Helix, Section, Tendon
from bozzini.continuum.coupling import find_limits
from bozzini.errors import FileFormatError, GeometryError, InputError
from bozzini.motion import FreeSpace
from bozzini.motion.actuate.actuate import FitJob, actuate_plan, check_robot
from bozzini.motion.actuate.actuation import Actuation, ArcCertificate
from tests.motion.actuate.motions import make_plan, make_robot, make_tube


@pytest.fixture(scope="module")
def moved():
    return actuate_plan(make_plan(), make_robot(20.0, 6), make_tube()[0])


@pytest.fixture
def edit(moved, tmp_path):
    """Save a motion, change what its file holds, and load that."""

    def load(arrays=None, **changes):
        path = moved.save(tmp_path / "robot.npz")
        with np.load(path) as data:
            held = {name: data[name] for name in data.files}
        record = json.loads(str(held["record"]))
        for key, value in changes.items():
            section, _, name = key.rpartition("__")
            (record[section] if section else record)[name] = value
        held |= {"record": np.array(json.dumps(record)), **(arrays or {})}
        np.savez_compressed(path, **held)
        return Actuation.load(path)

    return load


# --- points in time --------------------------------------------------------------------------


@pytest.mark.slow
def test_points_between_steps_lie_between(moved):
    body = moved.place_body([0.0, 20.0, 20.5, 21.0, moved.steps - 1.0])
    assert body.shape[0] == 5
    assert np.abs(body[2] - 0.5 * (body[1] + body[3])).max() < 0.1
    fine = moved.place_body([20.5], pitch=0.5)
    assert fine.shape[1] == 6 * 40 + 1  # sections of 20 mm
    assert fine[0, ::4] == pytest.approx(body[2], abs=1e-9)


@pytest.mark.parametrize(
    ("times", "pitch", "words"),
    [
        ([0.0, math.nan], 2.0, r"times\[1\] is nan"),
        ([-1.0], 2.0, r"times\[0\] is -1 steps: it must lie in \[0, "),
        ([1e9], 2.0, r"times\[0\] is 1e\+09 steps"),
        (3.0, 2.0, r"times has shape \(\): it must be \(n,\)"),
        ("now", 2.0, "times is 'now'"),
        ([0.0], 0.0, r"pitch is 0 mm: it must lie in \[0.001, inf\) mm"),
        ([0.0], math.nan, "pitch is nan mm"),
        ([0.0], -1.0, "pitch is -1 mm"),
    ],
)
def test_times_outside_the_motion_are_refused(moved, times, pitch, words):
    with pytest.raises(InputError, match=words):
        moved.place_body(times, pitch=pitch)


# --- what is refused -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("displacements", lambda a: a * math.nan, r"displacements\[0, 0\] is nan"),
        ("displacements", lambda a: a + 0.01, "displacements miss those of the bends by 0.01 mm"),
        ("displacements", lambda a: a[:, 1:], r"displacements has shape \(\d+, 17\)"),
        ("bends", lambda a: a + 0.1, "miss those of the bends"),
        ("base_advance", lambda a: a + 1e3, r"base_advance\[0\] is 1000 mm: .*\[0, 120\] mm"),
        ("fit_rms", lambda a: -1.0 - a, r"fit_rms\[0\] is -1.* mm"),
        ("clearance", lambda a: a * math.nan, r"clearance\[0\] is nan"),
        ("frame", lambda a: 0.0 * a, "frame is no frame: its axes miss being orthonormal by 1"),
        ("frame", lambda a: a @ np.diag([1.0, 1.0, -1.0, 1.0]), "left-handed"),
        ("head_arc_length", lambda a: a[:0], r"head_arc_length has shape \(0,\)"),
        ("status", lambda _: "done", "status is 'done'"),
        ("status", lambda _: "stopped", "reason_code is '' and reason '' with status 'stopped'"),
        ("reason", lambda _: None, "reason is None: it must be a text"),
        ("reason_code", lambda _: "WALL", "with status 'complete'"),
        ("meta", lambda _: None, "meta is None: it must be a mapping"),
        ("robot", lambda _: "arm", "robot is of type str"),
        ("certificate", lambda _: {}, "certificate is a dict"),
    ],
)
def test_a_motion_that_does_not_hold_together_is_not_built(moved, name, change, words):
    with pytest.raises(InputError, match=words) as caught:
        replace(moved, **{name: change(getattr(moved, name))})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("clearance", 5.0, "clearance is 5 mm: it cannot be more than the smallest value found"),
        ("clearance", math.nan, "clearance is nan"),
        ("clearance", "x", "clearance is 'x'"),
        ("found", None, "found is None"),
        ("step", -1.0, "step is -1"),
        ("section", 0.5, "section is 0.5: it must be a whole number"),
        ("place", [0.0, 1.0], "place has shape"),
        ("place", [0.0, math.inf, 0.0], "not finite"),
        ("resolved", "yes", "resolved is 'yes'"),
        ("wall", 3, "wall is 3: it must be a text"),
    ],
)
def test_a_certificate_is_checked(moved, name, value, words):
    with pytest.raises(InputError, match=words):
        replace(moved.certificate, **{name: value})


def test_a_certificate_belongs_to_its_motion(moved):
    for name, value in (("step", 1e4), ("section", 6), ("arc_length", 121.0)):
        proof = replace(moved.certificate, **{name: value})
        with pytest.raises(InputError, match=f"certificate {name} is"):
            replace(moved, certificate=proof)
    with pytest.raises(InputError, match="a certificate of arcs: certificate has no 'step'"):
        ArcCertificate.from_description({"clearance_mm": 1.0})
    with pytest.raises(InputError, match="a certificate of arcs: certificate is None"):
        ArcCertificate.from_description(None)


# --- the file --------------------------------------------------------------------------------


def test_a_file_that_is_whole_loads(edit, moved):
    assert edit().to_dict() == moved.to_dict()
    assert edit(status="stopped", reason="told so", reason_code="WALL").fits is False


@pytest.mark.parametrize(
    "changes",
    [
        {"arrays": {"displacements": np.full((3, 3), math.nan)}},
        {"arrays": {"frame": np.zeros((4, 4))}},
        {"arrays": {"clearance": np.array("text")}},
        {"arrays": {"bends": np.array([None])}},
        {"certificate__clearance_mm": 5.0},
        {"certificate__clearance_mm": "x"},
        {"certificate__place_mm": None},
        {"certificate": None},
        {"meta": None},
        {"meta": "x"},
        {"reason": None},
        {"status": ["complete"]},
        {"robot": {}},
        {"robot": None},
        {"format": "bozzini-actuation-0"},
    ],
)
def test_a_damaged_file_is_one_line(edit, changes):
    with pytest.raises(FileFormatError) as caught:
        edit(**changes)
    assert "robot.npz is not a" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_cut_short_is_one_line(moved, tmp_path):
    whole = moved.save(tmp_path / "robot.npz").read_bytes()
    part = tmp_path / "part.npz"
    random = np.random.default_rng(0)
    for _ in range(40):
        data = bytearray(whole)
        if random.random() < 0.5:
            data = data[: int(random.integers(len(data)))]
        else:
            for place in random.integers(0, len(data), 200):
                data[place] ^= 0xFF
        part.write_bytes(bytes(data))
        with pytest.raises(FileFormatError):
            Actuation.load(part)


# --- names and limits ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["head_arc_length", "base_advance"])
def test_a_tendon_called_like_a_column_is_refused(name):
    tendons = [
        Tendon(name=n, offset=1.0, angle=k) for k, n in ((0.0, name), (2.0, "b"), (4.0, "c"))
    ]
    robot = ContinuumRobot([Section(length=20.0, radius=2.0, tendons=tendons)])
    with pytest.raises(InputError, match="robot is of type str"):
        check_robot("arm")
    with pytest.raises(InputError, match=f"tendon '{name}' .* call it otherwise than head_arc"):
        check_robot(robot)


def test_columns_differ_whatever_tendons_are_called(moved):
    assert len(set(moved.columns)) == len(moved.columns)


def test_tendons_that_turn_are_refused_without_advice_that_does_not_help():
    helix = Tendon(name="h", offset=1.5, angle=Helix(turns=1.0), end=20.0)
    robot = ContinuumRobot([Section(length=20.0, radius=2.0, tendons=[helix])])
    with pytest.raises(GeometryError, match="a motion along a plan takes sections that bend in"):
        check_robot(robot)


def test_sections_are_not_bent_until_their_discs_meet():
    """A path with a corner asks for more than discs leave; what is told the model then takes."""
    plan, duct = make_plan(), make_tube()[0]
    arc = np.linspace(0.0, 100.0, 401)
    introducer = plan.introducer
    way = -introducer.outward
    aside = np.cross(way, np.roll(way, 1))
    aside /= np.linalg.norm(aside)
    corner = (
        np.clip(arc, 0.0, 40.0)[:, None] * way + np.clip(arc - 40.0, 0.0, None)[:, None] * aside
    )
    cornered = replace(
        plan, path=introducer.entry + corner, path_arc_length=arc, path_radius=np.full(401, 9.0)
    )
    robot = make_robot(4.0, 30, radius=5.0)
    job = FitJob(cornered, check_robot(robot), FreeSpace(duct, introducer=introducer))
    assert job.limits == pytest.approx(find_limits(robot).discs)
    free, held = (job.fit(-robot.radius, limited=limited) for limited in (False, True))
    assert free.angles.max() > 0.8 > held.angles.max()  # 4 mm / 5 mm
    model = ArcModel(robot)
    assert not model.shape(free.displacements).converged.all()
    assert model.shape(held.displacements).converged.all()


def test_an_actuation_is_a_result_with_a_table_and_a_picture(moved):
    frame = moved.to_frame()
    assert tuple(frame.columns) == moved.columns and len(frame) == moved.steps
    assert np.array_equal(frame.iloc[:, 3:].to_numpy(), moved.displacements)
    assert moved.converged == (moved.status == "complete")
    assert moved.residual == moved.fit_max.max()
    axes = moved.plot()
    assert moved.plot(axes) is axes and "displacement" in axes.get_ylabel()
    assert moved.columns[0] in moved._repr_html_()
