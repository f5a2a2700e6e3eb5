"""A distal head by itself: sizes, files, view, gaps, instruments."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.effector import change_design
from bozzini.errors import FileFormatError, InputError
from bozzini.head import (
    EndCap,
    Head,
    HeadCamera,
    Instrument,
    PlacedEffector,
    check_head,
    lay_out,
    read_head,
    view_head,
    write_head,
)
from bozzini.head.shape import Capsules, is_hidden, make_chains, measure_gaps, see_places

SLIM = {
    "muscle.outer_radius": 0.4, "muscle.inner_radius": 0.2, "offset": 1.9, "holder_diameter": 4.6,
    "bore_diameter": 1.2, "hole_diameter": 1.1, "coil_diameter": 1.6, "flexural_rigidity": 60.0,
}  # fmt: skip
THIN = Instrument(diameter=1.0, rigidity=20.0)


def make_pair() -> Head:
    """Return two slim end-effectors that half a turn carries into each other."""
    return Head(
        diameter=14.0,
        effectors=tuple(
            PlacedEffector(changes=SLIM, x=x, y=0.0, turn=turn, instrument=THIN)
            for x, turn in ((3.2, 0.3), (-3.2, 0.3 + math.pi))
        ),
    )


def test_a_file_reads_back_exactly(tmp_path) -> None:
    heads = (Head(), make_pair(), Head(camera=HeadCamera(view=2.0, far=70.0), cap=EndCap(wall=0.2)))
    for head in heads:
        for name in ("head.yaml", "head.json"):
            file = write_head(tmp_path / name, head)
            assert read_head(file) == head
            text = file.read_text(encoding="utf-8")  # of a default, too, lest that changes
            assert text.count("preset") == text.count("fit") == len(head.effectors)
    assert read_head(None) == Head()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("kind: bozzini-head\ndiameter: 2 m\n", "diameter is 2000 mm: it must lie in [1, 100] mm"),
        ("camera: {view: 400 deg}\n", "camera.view is 6.98132 rad"),
        ("effectors:\n- {preset: none}\n", "preset is 'none': it must be one of measured"),
        ("effectors: []\n", "the head has 0 end-effectors: it must have 1 to 3"),
        ("effectors:\n- {instrument: {diameter: 4 mm}}\n", "at most 3.5 mm, the bore"),
        ("effectors:\n- {changes: {widths: 1}}\n", "there is no parameter 'widths'"),
        ("camera: {diameter: 12 mm}\n", "it must be more than 12.6 mm"),
        ("camera: {near: 9 mm, far: 3 mm}\n", "far is 3 mm: it must lie in [9,"),
        ("kind: bozzini-robot\n", "kind is 'bozzini-robot': choose one of bozzini-head"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path, capsys, text: str, said: str) -> None:
    file = tmp_path / "head.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError):
        read_head(file)
    assert main(["head", "show", "--head", str(file)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_without_rigidity_an_instrument_bends_nothing() -> None:
    bends = Head().effectors[0].list_bends(50)
    none, soft, integrated, separate = (
        replace(PlacedEffector(), instrument=Instrument(**given))
        for given in (
            {"fit": "none"},
            {"rigidity": 0.0},
            {"fit": "integrated"},
            {"fit": "separate"},
        )
    )
    pressure = {"G": 0.6}
    poses = [
        one.effector.forward(pressure).holder_tip for one in (none, soft, integrated, separate)
    ]
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-12)
    off = [float(np.hypot(*pose[:2])) for pose in poses]
    assert off[1] > off[2] > off[3]
    np.testing.assert_allclose(none.shape(bends).tip, none.shape(bends).holder_tip)
    out = np.linalg.norm(soft.shape(bends).tip - soft.shape(bends).holder_tip, axis=1)
    np.testing.assert_allclose(out, soft.instrument.out)


def test_the_forceps_of_the_thesis() -> None:
    """Fig. 4.15: 22.4 mm at the holder's end, 26.5 mm at the tip, at 827 kPa.

    The two say that the tip stood 5.3 mm out, whatever the stiffness: 20 mm out would be 37.8 mm.
    """
    forceps = Instrument(out=5.3)
    pose = Head(effectors=(PlacedEffector(x=0.0, y=0.0, instrument=forceps),)).forward(
        [{"G": 0.827}]
    )
    holder, tip = (float(np.hypot(*end[:2])) for end in (pose.bodies[0][-1], pose.tip[0]))
    assert holder == pytest.approx(22.4, abs=0.05)
    assert tip == pytest.approx(26.5, abs=0.1)
    known = {(row.fit): row for row in lay_out(Head()).rows}
    assert known["separate"].holder == pytest.approx(22.4, abs=0.05)
    assert known["separate"].tip == pytest.approx(37.8, abs=0.1)
    # The preset that is fitted to nothing of this, without any added rigidity.
    loose = PlacedEffector(preset="prototype", instrument=Instrument(rigidity=0.0, out=5.3))
    rows = lay_out(Head(effectors=(loose,))).rows
    assert rows[0].holder == pytest.approx(22.4, abs=2.0)
    assert rows[0].tip == pytest.approx(26.5, abs=2.0)


def test_an_instrument_is_steered_by_its_tip() -> None:
    head = make_pair()
    for k, placed in enumerate(head.effectors):
        wanted = placed.place[:2] + np.array([[4.0, -7.0], [0.0, 0.0], [-9.0, 1.0]])
        found = placed.inverse(wanted)
        assert found.converged.all()
        for place, pressures in zip(wanted, found.pressures, strict=True):
            given = [np.zeros(3), np.zeros(3)]
            given[k] = pressures
            assert head.forward(given).tip[k, :2] == pytest.approx(place, abs=1e-3)
        far = placed.inverse(placed.place[:2] + [0.0, 500.0])
        assert not far.converged


def test_a_load_bends_section_and_instrument_as_beams() -> None:
    force, out = 0.01, 20.0
    placed = PlacedEffector(instrument=Instrument(out=out, rigidity=150.0))
    design = placed.effector.design
    straight = placed.shape(np.zeros((1, 2)))
    moved = placed.deflect(straight, [force, 0.0, 0.0])[0]
    length, beyond = design.backbone_length, design.holder_length + out
    section = length**3 / 3.0 + length**2 * beyond + length * beyond**2
    wanted = force * (section / design.rigidity + out**3 / (3.0 * 150.0))
    assert moved == pytest.approx([wanted, 0.0, 0.0], rel=1e-3)
    stiff = replace(placed, changes={"flexural_rigidity": 1e9})
    alone = stiff.deflect(straight, [force, 0.0, 0.0])[0, 0]
    assert alone == pytest.approx(force * out**3 / 450.0, rel=1e-3)
    assert placed.deflect(straight, [0.0, 0.0, 1.0]) == pytest.approx(np.zeros((1, 3)), abs=1e-9)
    with pytest.raises(InputError, match="rigidity is 0"):
        replace(placed, instrument=Instrument(rigidity=0.0)).deflect(straight, [1.0, 0.0, 0.0])


def test_what_a_cone_sees_by_counting_and_by_its_formulas() -> None:
    rng = np.random.default_rng(3)
    camera = HeadCamera(view=math.radians(80.0), near=2.0, far=7.0)
    housing = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 1.0]])
    places = housing[1] + rng.uniform(-10.0, 10.0, (400_000, 3))
    in_cone, in_focus = see_places(camera, housing, places)
    inside = np.linalg.norm(places - housing[1], axis=1) < 10.0
    share = 0.5 * (1.0 - math.cos(math.radians(40.0)))
    assert in_cone[inside].mean() == pytest.approx(share, rel=0.02)
    slope = math.tan(math.radians(40.0))
    volume = math.pi * slope**2 * (7.0**3 - 2.0**3) / 3.0
    assert (in_cone & in_focus).mean() == pytest.approx(volume / 20.0**3, rel=0.02)


def test_the_cone_is_the_circle_of_the_picture() -> None:
    head = Head()
    picture = head.look(300)
    places = np.random.default_rng(1).uniform(-80.0, 80.0, (5000, 3))
    in_cone, _ = see_places(head.camera, head.lay_arm()[1], places)
    off = np.linalg.norm(picture.project(places) - 149.5, axis=1)
    np.testing.assert_array_equal(in_cone, np.nan_to_num(off, nan=np.inf) <= 150.0)


def test_a_view_counts_what_single_poses_see() -> None:
    head = make_pair()
    found = view_head(head, number=2, samples=60)
    placed = head.effectors[1]
    bends = placed.list_bends(60)
    pressures = placed.effector.inverse(bends).pressures
    poses = [head.forward([np.zeros(3), one]) for one in pressures]
    seen = np.array([pose.in_view[1] for pose in poses])
    free = np.array([pose.gap >= 0.0 for pose in poses])
    np.testing.assert_array_equal(seen, found.in_cone & found.in_focus & ~found.hidden)
    np.testing.assert_array_equal(free, found.free)
    assert found.share_seen == seen.mean()
    assert found.share_used == (seen & free).mean()
    assert 0.0 < found.share_used < found.share_seen < 1.0


def test_a_deeper_and_wider_view_sees_no_less() -> None:
    head = Head()
    narrow = replace(head, camera=replace(head.camera, view=1.2, far=35.0))
    wide, less = view_head(head, samples=200), view_head(narrow, samples=200)
    assert less.share_in_cone < wide.share_in_cone
    assert less.share_in_focus < wide.share_in_focus
    assert not (less.in_cone & ~wide.in_cone).any()
    np.testing.assert_array_equal(less.hidden, wide.hidden)


def test_half_a_turn_carries_two_end_effectors_into_each_other() -> None:
    head = make_pair()
    one, other = (placed.shape(placed.list_bends(100)) for placed in head.effectors)
    turned = one.tip * [-1.0, -1.0, 1.0]
    np.testing.assert_allclose(other.tip, turned, atol=1e-9)
    rows = lay_out(head).rows
    for first, second in zip(rows[:3], rows[3:], strict=True):
        assert (second.fit, second.rigidity) == (first.fit, first.rigidity)
        assert (second.tip, second.around) == pytest.approx((first.tip, first.around))
    found = check_head(head, samples=50)
    assert found.converged
    assert found.share_free < 1.0  # both can lean to where the other is


def test_a_tip_on_the_end_of_a_body_is_seen_from_ahead() -> None:
    draw = np.random.default_rng(0)
    way = draw.normal(size=(500, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    tips, lens = draw.normal(scale=10.0, size=(500, 3)), np.zeros(3)
    lines = tips[:, None] - np.array([40.0, 4.5])[:, None] * way[:, None]
    depth = ((lens - tips) * way).sum(axis=1)  # of the lens before the plane of the end
    hidden = is_hidden(lens, tips, [Capsules(lines, 4.5)])
    assert not hidden[depth > 1.0].any()
    assert hidden[depth < -1.0].mean() > 0.9  # not where the lens is in the body


@pytest.mark.parametrize("out", [0.0, 0.5, 1.25, 20.0])
def test_an_instrument_s_round_end_reaches_as_far_as_its_tip(out: float) -> None:
    placed = PlacedEffector(instrument=Instrument(out=20.0))
    pose = placed.shape(np.array([[6.0, 2.0], [0.0, 0.0]]))
    pose = replace(pose, tip=pose.holder_tip + out * pose.direction)
    rod = make_chains(placed, pose)[1]
    ball = (Capsules(pose.tip[:, None] + 3.0 * pose.direction[:, None] * [[1.0], [1.001]], 1.0),)
    gaps = np.diagonal(measure_gaps((rod,), ball))
    assert gaps == pytest.approx([2.0, 2.0])


def test_gaps_are_those_of_dense_points() -> None:
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(4, 5, 3)), rng.normal(size=(3, 4, 3)) + 1.0
    gaps = measure_gaps((Capsules(one, 0.1),), (Capsules(other, 0.2),))

    def fill(lines):
        share = np.linspace(0.0, 1.0, 200)[:, None]
        parts = lines[:, :-1, None] + share * np.diff(lines, axis=1)[:, :, None]
        return parts.reshape(len(lines), -1, 3)

    dense, second = fill(one), fill(other)
    away = np.linalg.norm(dense[:, None, :, None] - second[None, :, None], axis=-1)
    np.testing.assert_allclose(gaps, away.min(axis=(2, 3)) - 0.3, atol=0.02)
    line = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
    apart = measure_gaps((Capsules(line, 0.0),), (Capsules(line + [0.0, 3.0, 5.0], 0.0),))
    assert apart[0, 0] == pytest.approx(5.0)  # side by side, one after the other


def test_an_arm_is_an_arc_after_an_arc() -> None:
    camera = HeadCamera()
    arm, housing = camera.lay_arm(5.0, free=True)
    steps = np.linspace(0.0, camera.rise_length + camera.fall_length, 20_001)
    lean = np.interp(
        steps,
        [0.0, camera.rise_length, steps[-1]],
        [0.0, camera.rise_angle, camera.rise_angle - camera.fall_angle],
    )
    end = np.trapezoid([np.sin(lean), np.cos(lean)], steps)
    assert arm[-1] == pytest.approx([0.0, 5.0 + end[0], end[1]], abs=1e-5)
    assert np.linalg.norm(housing[1] - housing[0]) == pytest.approx(camera.length)
    straight, under = camera.lay_arm(5.0, free=False)
    assert under[1, 2] == pytest.approx(camera.straight_length)
    assert np.ptp(straight[:, :2], axis=0) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (Head(diameter=11.0), "under the cap: camera and end-effector 1 lack 0.49 mm"),
        (Head(cap=EndCap(length=50.0)), "under the cap: cap's front and end-effector 1 lack 5.00"),
        (Head(cap=EndCap(stroke=40.0)), "cap and face, pulled back lack 16.00 mm"),
        (Head(camera=HeadCamera(strain_limit=0.01)), "the arm strains by 1.57 %"),
        (Head(effectors=(PlacedEffector(y=0.0),)), "camera and end-effector 1 lack 0.89 mm"),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, capsys, head: Head, said: str) -> None:
    assert said in check_head(head, samples=20).reason
    file = str(write_head(tmp_path / "head.yaml", head))
    assert main(["head", "check", "--head", file, "--samples", "20"]) == 1
    assert said in capsys.readouterr().out


def test_the_default_fits_as_the_command_says(tmp_path, capsys) -> None:
    file, picture = tmp_path / "gaps.csv", tmp_path / "head.png"
    assert main(["head", "check", "--samples", "50", "--json", "--out", str(file)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["converged"]
    assert answer["least_gap_mm"] == pytest.approx(0.0, abs=1e-9)
    assert len(file.read_text().splitlines()) == len(answer["rows"]) + 1
    assert {"state", "bodies", "gap_mm", "share_free"} == set(answer["rows"][0])
    assert main(["head", "show", "--json", "--out", str(picture)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [row["fit"] for row in answer["rows"]] == ["separate", "integrated", "none"]
    assert picture.exists()
    assert main(["head", "view", "--samples", "50", "--fall-angle", "80deg", "--json"]) == 0
    assert 0.0 < json.loads(capsys.readouterr().out)["share_seen"] < 1.0
    assert main(["head", "view", "--effector", "2"]) == 2
    assert "end-effector is 2: it must lie in [1, 1]" in capsys.readouterr().err


def test_changes_are_those_of_a_design() -> None:
    placed = PlacedEffector(changes={"length": 40.0, "offset": 3.0})
    wanted = change_design(PlacedEffector().effector.design, {"length": 40.0, "offset": 3.0})
    assert placed.effector.design == wanted
    assert placed.length == 50.0
