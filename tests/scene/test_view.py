"""A view keeps what it is made of to its stated steps, and the page holds it alone."""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bozzini import Effector, anatomy, duct
from bozzini.continuum import ContinuumRobot, sample_workspace
from bozzini.errors import GeometryError, InputError
from bozzini.motion.plan import FieldSummary
from bozzini.scene import make_view as views
from bozzini.scene.make_view import draw_wall, join_views, make_view, measure_angles, view_plan
from bozzini.scene.page import MODULES, bundle_scripts, read_web, render_page
from bozzini.scene.view import (
    CLEARANCE_STEP,
    JOINT_STEP,
    VERTEX_STEP,
    Body,
    Surface,
    View,
    encode_view,
)  # fmt: skip
from tests.plot.fake_motion import END, START, make_field, make_plan, make_stopped
from tests.scene.decode_view import decode_view

CORNER = Surface(vertices=np.eye(3), faces=np.array([[0, 1, 2]]))


def read_page(text):
    packed = re.search(r'id="view">([^<]*)<', text)
    assert packed is not None
    return decode_view(gzip.decompress(base64.b64decode(packed[1], validate=True)))


@given(
    arrays(np.float64, (4, 5, 3), elements=st.floats(-5e3, 5e3)),
    arrays(np.float64, (4, 4), elements=st.floats(-300, 300) | st.just(np.nan)),
)
def test_a_body_comes_back_to_the_stated_steps(joints, clearance):
    view = View(title="x", bodies=(Body(joints=joints, radius=2.0, clearance=clearance),))
    body = decode_view(encode_view(view))["bodies"][0]
    assert np.abs(body["joints"] - joints).max() <= 0.5 * JOINT_STEP + 1e-9
    np.testing.assert_array_equal(np.isnan(body["clearance"]), np.isnan(clearance))
    gaps = np.abs(body["clearance"] - clearance)[~np.isnan(clearance)]
    assert gaps.max(initial=0.0) <= 0.5 * CLEARANCE_STEP + 1e-9


@given(arrays(np.float64, (7, 3), elements=st.floats(-1e3, 1e3)), st.randoms())
def test_a_surface_comes_back_face_by_face(vertices, random):
    faces = np.array([[random.randrange(7) for _ in range(3)] for _ in range(9)])
    view = View(title="x", surfaces=(Surface(vertices=vertices, faces=faces),))
    found = decode_view(encode_view(view))["surfaces"][0]
    np.testing.assert_array_equal(found["faces"], faces)
    assert np.abs(found["vertices"] - vertices).max() <= 0.5 * VERTEX_STEP + 1e-9


def test_far_places_get_coarser_steps_and_no_overflow():
    joints = np.array([[[0.0, 0, 0], [1e9, 0, 0]]])
    body = decode_view(encode_view(View(title="x", bodies=(Body(joints=joints, radius=1.0),))))
    np.testing.assert_allclose(body["bodies"][0]["joints"], joints, atol=1.0)


def test_the_same_view_gives_the_same_page():
    plan, field = make_plan(), make_field()
    assert render_page(view_plan(plan, field)) == render_page(view_plan(plan, field))


def test_a_plan_is_all_there():
    plan = make_plan(dent=5.25)
    view = view_plan(plan, make_field())
    data = read_page(render_page(view))
    scope, way = data["bodies"]
    assert np.abs(scope["joints"] - plan.joints).max() <= JOINT_STEP
    np.testing.assert_allclose(scope["insertion"], plan.head_arc_length)
    outside = np.isinf(plan.clearance)
    assert np.isnan(scope["clearance"][outside]).all()
    np.testing.assert_allclose(
        scope["clearance"][~outside], plan.clearance[~outside], atol=CLEARANCE_STEP
    )
    assert way["role"] == "line" and np.abs(way["joints"][0] - plan.path).max() <= JOINT_STEP
    least, angle = data["charts"]
    # What is charted is what is drawn: the least of the links of each step.
    for value, row in zip(least["values"], scope["clearance"], strict=True):
        known = row[~np.isnan(row)]
        assert (value is None) == (known.size == 0)
        assert value is None or value == pytest.approx(known.min(), abs=CLEARANCE_STEP)
    assert max(angle["values"]) == pytest.approx(0.0, abs=1e-6)  # it slides down straight
    tight = next(mark for mark in data["marks"] if mark["kind"] == "tight")
    assert least["values"][tight["step"]] == pytest.approx(plan.clearance_min)
    # At the dent, which the link over 40 mm meets.
    along = (np.array(tight["place"]) - START) @ (END - START) / np.linalg.norm(END - START)
    assert abs(along - 40.0) <= 8.0
    assert data["patient"] and [axis["letter"] for axis in data["axes"]] == list("RLAPSI")


def test_a_plan_in_a_wall_that_is_drawn_is_that_in_the_wall():
    plan, field = make_plan(), make_field().inflate(1.0)
    plan = replace(plan, field=FieldSummary(kind="sampled", inflation=1.0))
    whole, drawn = view_plan(plan, field), view_plan(plan, make_view(field))
    assert encode_view(whole) == encode_view(drawn)
    # Of another wall it is said that it is not the plan's; of the plan's own it is not.
    assert any("outwards" in note for note in view_plan(plan, make_field()).notes)
    assert not any("outwards" in note for note in drawn.notes)


def test_a_refusal_is_marked_where_it_is():
    plan = make_stopped()
    view = view_plan(plan)
    mark = next(mark for mark in view.marks if mark.kind == "refused")
    np.testing.assert_allclose(np.linalg.norm(mark.place - START), 70.0)
    rest = view.bodies[-1].joints[0]
    for surface in view.surfaces:  # the tubes turn outwards, away from the tract's straight middle
        a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
        out = (a + b + c) / 3.0 - START
        out[:, 2] = 0.0
        assert ((np.cross(b - a, c - a) * out).sum(axis=1) >= -1e-9).all()
    np.testing.assert_allclose(rest[0], plan.joints[-1, 0], atol=0.1)
    np.testing.assert_allclose(rest[-1], END, atol=1e-9)
    assert any("not known" in note for note in view.notes)


def test_long_motions_are_thinned_aloud_and_keep_the_tightest(monkeypatch):
    monkeypatch.setattr(views, "MOST_JOINTS", 11 * 7)
    plan = make_plan(dent=5.25)
    view = view_plan(plan)
    steps = len(view.bodies[0].joints)
    assert steps < plan.steps and view.notes[0].startswith(f"{steps} of {plan.steps} steps")
    assert np.nanmin(view.bodies[0].clearance) == plan.clearance_min
    assert len(view.charts[0].values) == len(view.bodies[0].insertion) == steps


def test_the_wall_lies_where_the_distance_is_zero():
    for field in (make_field(), make_field(inflation=2.0), make_field(spacing=(1.0, 2.0, 1.5))):
        mesh, notes = draw_wall(field)
        assert np.abs(field.signed_distance(mesh.vertices)).max() < 0.3
        assert "grid" in notes[0]
        outside = mesh.vertices + 1.0 * mesh.normals
        assert (field.signed_distance(outside) > 0.5).all()
    mesh, notes = draw_wall(make_field(), most_faces=500)
    assert len(mesh.faces) <= 600 and "simplified" in notes[-1]


def test_the_wall_of_shapes_and_of_labels_is_where_they_are():
    shapes = duct.RoundCones(np.array([[0.0, 0, 0], [40.0, 0, 0], [60.0, 0, 0]]), np.full(3, 5.0))
    mesh, _ = draw_wall(shapes)
    assert np.abs(shapes.signed_distance(mesh.vertices)).max() < 0.4
    labels = anatomy.make_phantom(seed=0).to_labels(voxel=4.0)
    mesh, _ = draw_wall(labels)
    inside = mesh.faces.size and abs(_measure_volume(mesh) / labels.volume - 1.0)
    assert inside < 0.05
    with pytest.raises(GeometryError, match="planar"):
        draw_wall(duct.Polygon(np.array([[0.0, 0], [1.0, 0], [1.0, 1.0]])))


def _measure_volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def test_angles_are_those_between_links():
    bend = np.array([0.3, 1.2, 3.0])
    turn = np.concatenate([[0.0], np.cumsum(bend)])
    links = np.stack([np.cos(turn), np.sin(turn), np.zeros(4)], axis=1)
    joints = np.concatenate([np.zeros((1, 3)), np.cumsum(2.5 * links, axis=0)])
    np.testing.assert_allclose(measure_angles(joints), bend, atol=1e-12)
    np.testing.assert_allclose(measure_angles(joints[::-1].copy())[::-1], bend, atol=1e-12)


def test_a_robot_is_shown_with_its_tendons_and_its_reach():
    robot = ContinuumRobot.from_yaml("examples/two_sections.yaml")
    view = make_view(robot)
    body, *tendons = view.bodies
    assert len(tendons) == len(robot.tendons)
    straight = robot.forward(np.zeros(len(robot.tendons)))
    np.testing.assert_allclose(body.joints[0], straight.world_points)
    reach = np.linalg.norm(view.points[0].points - body.joints[0, 0], axis=1)
    assert reach.max() <= robot.length + 1e-9
    np.testing.assert_allclose(  # a tendon of the straight robot is as long as the robot
        np.linalg.norm(np.diff(tendons[-1].joints[0], axis=0), axis=1).sum(), robot.length
    )
    sample = make_view(sample_workspace(robot, 50))
    assert sample.points[0].points.shape == (50, 3)


def test_an_effector_is_shown_with_its_head_first():
    effector = Effector.from_preset("thesis")
    view = make_view(effector)
    chain = view.bodies[0].joints[0]
    np.testing.assert_allclose(chain[-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(chain[0], [0, 0, effector.design.backbone_length], atol=1e-9)
    tips = view.points[0].points
    assert (np.linalg.norm(tips, axis=1) <= effector.design.backbone_length + 1e-6).all()


def test_views_are_joined_and_what_has_no_view_is_refused():
    one, other = View(title="a", surfaces=(CORNER,)), make_view(make_field())
    both = join_views([one, other])
    assert both.title == "a" and both.surfaces == (*one.surfaces, *other.surfaces)
    assert both.notes == other.notes
    with pytest.raises(InputError, match="no view of a str"):
        make_view("scan")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: View(title="x"), "the view is empty"),
        (lambda: Surface(vertices=np.eye(3), faces=np.array([[0, 1, 3]])), r"indices in \[0, 2\]"),
        (lambda: Surface(vertices=np.eye(3), faces=np.zeros((1, 2), int)), r"shape \(1, 2\)"),
        (lambda: Body(joints=np.zeros((1, 1, 3)), radius=1.0), r"shape \(1, 1, 3\)"),
        (lambda: Body(joints=np.zeros((1, 2, 3)), radius=-1.0), "radius of scope is -1"),
        (lambda: Body(joints=np.zeros((1, 2, 3)), radius=1.0, color="red"), "color is 'red'"),
        (lambda: View(title="x", surfaces=(CORNER,), axes="RAX"), "frame is 'RAX'"),
    ],
)
def test_wrong_parts_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_the_page_loads_nothing_and_allows_its_own_script_alone():
    text = render_page(View(title="</title><script>", surfaces=(CORNER,)))
    policy = re.search(r'Security-Policy" content="([^"]*)"', text)
    assert policy is not None and policy[1].startswith("default-src 'none'")
    assert "unsafe" not in policy[1] and "http" not in policy[1]
    scripts = re.findall(r"<script>(.*?)</script>", text, re.S)
    style = re.search(r"<style>(.*?)</style>", text, re.S)
    assert len(scripts) == 1 and style is not None
    for part in (scripts[0], style[1]):
        digest = base64.b64encode(hashlib.sha256(part.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy[1]
    assert not re.search(r"https?:|fetch\(|innerHTML|eval\(", text)
    assert "</title><script>" not in text


def test_the_scripts_are_small_documented_and_can_be_joined():
    texts = {name: read_web(name) for name in MODULES}
    assert sum(len(text.encode()) for text in texts.values()) <= 46_000
    names: list[str] = []
    for text in texts.values():
        assert text.startswith("/** ")
        names += re.findall(r"(?m)^(?:export )?(?:async )?(?:const|let|function) (\w+)", text)
    assert len(names) == len(set(names)), "two modules use one name"
    script = bundle_scripts()
    assert not re.search(r"(?m)^(import|export)\b", script)
    for text in texts.values():  # nothing is lost but those lines
        body = re.sub(r"(?ms)^import .*?;\n", "", text)
        assert body.replace("export ", "") in script.replace("export ", "")
