"""The animated scene: the file is read back and played by code that knows only the glTF rules."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from bozzini.errors import InputError, OutputError
from bozzini.scene.gltf import choose_keys, compute_bone_rotations, convert_to_matrices
from bozzini.scene.scene import SceneInfo, SceneOptions, write_scene

DIAMETER = 5.0
TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
# World (x right, y anterior, z superior) to glTF (y up): written here on its own, as a rule.
UPRIGHT = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


def wind(steps: int = 60, links: int = 12, length: float = 6.0) -> np.ndarray:
    """Return a chain that winds and turns in space, with exact link lengths."""
    time = np.linspace(0, 1, steps)[:, None]
    link = np.arange(links)[None]
    tilt = 0.4 + 0.8 * np.sin(2.5 * time + 0.21 * link)
    turn = 1.7 * time + 0.3 * link
    step = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], -1)
    head = np.stack([5 * time, 3 * time**2, -60 * time], axis=-1)
    return np.concatenate([head, head + length * np.cumsum(step, axis=1)], axis=1)


def tube() -> trimesh.Trimesh:
    return trimesh.creation.cylinder(radius=15.0, height=120.0, sections=32)


def write_tube_scene(path: Path, joints: np.ndarray) -> SceneInfo:
    surface = tube()
    return write_scene(
        path,
        surface=(surface.vertices, surface.faces),
        joints=joints,
        diameter=DIAMETER,
        path=joints[:, 0],
        options=SceneOptions(duration=9.0, keys=25),
    )


class Scene:
    """A scene file, opened."""

    def __init__(self, path: Path) -> None:
        self.path = path
        data = path.read_bytes()
        (size,) = struct.unpack_from("<I", data, 12)
        self.json = json.loads(data[20 : 20 + size])
        self.binary = data[28 + size :]

    def array(self, index: int) -> np.ndarray:
        accessor = self.json["accessors"][index]
        view = self.json["bufferViews"][accessor["bufferView"]]
        kind, width = np.dtype(TYPES[accessor["componentType"]]), WIDTHS[accessor["type"]]
        start = view["byteOffset"] + accessor.get("byteOffset", 0)
        values = np.frombuffer(self.binary, kind, accessor["count"] * width, start)
        return values.reshape(-1, width)

    def node(self, name: str) -> int:
        (index,) = (i for i, node in enumerate(self.json["nodes"]) if node["name"] == name)
        return index

    def mesh(self, name: str) -> dict[str, np.ndarray]:
        primitive = self.json["meshes"][self.json["nodes"][self.node(name)]["mesh"]]["primitives"][
            0
        ]
        arrays = {key: self.array(index) for key, index in primitive["attributes"].items()}
        return {**arrays, "faces": self.array(primitive["indices"]).reshape(-1, 3).astype(int)}

    @cached_property
    def parents(self) -> dict[int, int]:
        nodes = enumerate(self.json["nodes"])
        return {child: i for i, node in nodes for child in node.get("children", [])}

    @cached_property
    def times(self) -> np.ndarray:
        return self.array(self.json["animations"][0]["samplers"][0]["input"]).ravel()

    @cached_property
    def tracks(self) -> dict[tuple[int, str], np.ndarray]:
        animation = self.json["animations"][0]
        tracks = {}
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            assert sampler["interpolation"] == "LINEAR"
            key = (channel["target"]["node"], channel["target"]["path"])
            tracks[key] = self.array(sampler["output"]).astype(float)
        return tracks

    def place(self, node: int, key: int | None = None) -> np.ndarray:
        """Global matrix of a node, in its own pose or at a key of the animation."""
        item = self.json["nodes"][node]
        rotation = item.get("rotation", [0, 0, 0, 1])
        translation = item.get("translation", [0, 0, 0])
        if key is not None and (node, "rotation") in self.tracks:
            rotation = self.tracks[node, "rotation"][key]
            translation = self.tracks[node, "translation"][key]
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(rotation).as_matrix()
        matrix[:3, 3] = translation
        return self.place(self.parents[node], key) @ matrix if node in self.parents else matrix

    @cached_property
    def bones(self) -> list[int]:
        return self.json["skins"][0]["joints"]

    @cached_property
    def inverse_bind(self) -> np.ndarray:
        columns = self.array(self.json["skins"][0]["inverseBindMatrices"])
        return np.swapaxes(columns.reshape(-1, 4, 4), 1, 2)

    def skin(self, key: int | None) -> np.ndarray:
        """Vertices of the scope's skin by linear blending, in metres, glTF's frame."""
        mesh = self.mesh("scope_skin")
        matrices = np.stack([self.place(bone, key) for bone in self.bones]) @ self.inverse_bind
        points = np.c_[mesh["POSITION"], np.ones(len(mesh["POSITION"]))]
        blended = np.einsum("vw,vwij->vij", mesh["WEIGHTS_0"], matrices[mesh["JOINTS_0"]])
        return np.einsum("vij,vj->vi", blended, points)[:, :3]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a scene, its info and the joints it was made from [mm]."""
    joints = wind()
    path = tmp_path_factory.mktemp("scene") / "scene.glb"
    info = write_tube_scene(path, joints)
    return Scene(path), info, joints


def find_distance_to_links(points, joints, links):
    """Distance of each point to the segment of its own link."""
    start, end = joints[links], joints[links + 1]
    along = np.sum((points - start) * (end - start), 1) / np.sum((end - start) ** 2, 1)
    return np.linalg.norm(points - start - np.clip(along, 0, 1)[:, None] * (end - start), axis=1)


def test_every_accessor_lies_in_its_view_and_is_aligned(written):
    scene, info, _ = written
    assert len(scene.binary) == scene.json["buffers"][0]["byteLength"]
    for index, accessor in enumerate(scene.json["accessors"]):
        view = scene.json["bufferViews"][accessor["bufferView"]]
        size = np.dtype(TYPES[accessor["componentType"]]).itemsize
        start = accessor.get("byteOffset", 0)
        assert (view["byteOffset"] + start) % 4 == 0
        values = scene.array(index)
        assert start + values.size * size <= view["byteLength"]
        assert view["byteOffset"] + view["byteLength"] <= len(scene.binary)
        assert np.all(np.isfinite(values))
        if "min" in accessor:
            assert accessor["min"] == values.min(axis=0).tolist()
            assert accessor["max"] == values.max(axis=0).tolist()
    assert info.bytes == scene.path.stat().st_size


def test_the_animation_has_the_first_and_last_step_and_the_right_clock(written):
    scene, info, joints = written
    assert [item["name"] for item in scene.json["animations"]] == ["insertion"]
    assert len(scene.times) == info.keys == 25
    assert scene.times[0] == 0.0 and scene.times[-1] == 9.0
    assert np.all(np.diff(scene.times) > 0)
    for channel in scene.tracks.values():
        assert len(channel) == 25
    clock = scene.json["accessors"][scene.json["animations"][0]["samplers"][0]["input"]]
    assert clock["min"] == [0.0] and clock["max"] == [9.0]


def test_playing_the_keys_gives_the_joints_back(written):
    scene, info, joints = written
    steps = np.rint(scene.times / 9.0 * (len(joints) - 1)).astype(int)
    assert steps[0] == 0 and steps[-1] == len(joints) - 1
    assert info.bones == len(scene.bones) == joints.shape[1] - 1
    for key, step in enumerate(steps):
        wanted = 1e-3 * joints[step] @ UPRIGHT.T
        places = np.stack([scene.place(bone, key) for bone in scene.bones])
        lengths = np.linalg.norm(np.diff(joints[-1], axis=0), axis=1) * 1e-3
        np.testing.assert_allclose(places[:, :3, 3], wanted[:-1], atol=1e-7)
        tails = places[:, :3, 3] + places[:, :3, 2] * lengths[:, None]
        np.testing.assert_allclose(tails, wanted[1:], atol=1e-7)


def test_the_file_rests_in_the_last_pose_and_is_bound_there(written):
    scene, _, _ = written
    for bone, inverse in zip(scene.bones, scene.inverse_bind, strict=True):
        np.testing.assert_allclose(scene.place(bone), scene.place(bone, -1), atol=1e-7)
        np.testing.assert_allclose(inverse @ scene.place(bone), np.eye(4), atol=1e-6)
    np.testing.assert_allclose(scene.skin(None), scene.mesh("scope_skin")["POSITION"], atol=1e-7)


def test_weights_are_a_partition_and_unused_slots_name_bone_zero(written):
    mesh = written[0].mesh("scope_skin")
    np.testing.assert_allclose(mesh["WEIGHTS_0"].sum(axis=1), 1.0, atol=1e-7)
    assert np.all(mesh["JOINTS_0"][mesh["WEIGHTS_0"] == 0] == 0)
    assert mesh["JOINTS_0"].max() == len(written[0].bones) - 1


@pytest.mark.parametrize("key", [0, 7, 12, 24])
def test_the_skin_is_the_capsule_of_each_link_at_every_key(written, key):
    scene, _, joints = written
    step = int(np.rint(scene.times[key] / 9.0 * (len(joints) - 1)))
    chain = 1e-3 * joints[step] @ UPRIGHT.T
    mesh, points = scene.mesh("scope_skin"), scene.skin(key)
    links = mesh["JOINTS_0"][:, 0].astype(int)
    rigid = mesh["WEIGHTS_0"][:, 0] == 1.0
    rigid[-1] = False  # the centre of the tail's disc
    radius = 0.5e-3 * DIAMETER
    distance = find_distance_to_links(points, chain, links)
    np.testing.assert_allclose(distance[rigid], radius, rtol=1e-4)
    blended = ~rigid
    blended[-1] = False
    gap = np.linalg.norm(points[blended] - chain[links[blended] + 1], axis=1)
    assert gap.max() <= radius * (1 + 1e-4)
    assert gap.min() > 0.8 * radius
    # The rounded head reaches one radius before joint 0, and nothing passes the tail.
    ahead = (chain[0] - chain[1]) / np.linalg.norm(chain[0] - chain[1])
    assert np.max((points - chain[0]) @ ahead) == pytest.approx(radius, rel=1e-4)


def test_the_skin_is_closed_and_turned_outwards(tmp_path):
    joints = np.zeros((1, 21, 3))
    joints[0, :, 2] = np.arange(21) * 5.0
    surface = tube()
    write_scene(
        tmp_path / "a.glb",
        surface=(surface.vertices, surface.faces),
        joints=joints,
        diameter=DIAMETER,
    )
    skin = Scene(tmp_path / "a.glb").mesh("scope_skin")
    mesh = trimesh.Trimesh(skin["POSITION"].astype(float) * 1e3, skin["faces"], process=False)
    assert np.all(np.sum(mesh.face_normals * skin["NORMAL"][mesh.faces].mean(axis=1), 1) > 0.5)
    np.testing.assert_allclose(np.linalg.norm(skin["NORMAL"], axis=1), 1.0, atol=1e-6)
    mesh.merge_vertices(merge_norm=True, merge_tex=True, digits_vertex=6)
    assert mesh.is_watertight
    radius = 0.5 * DIAMETER
    exact = np.pi * radius**2 * 100.0 + 2 / 3 * np.pi * radius**3
    assert 0.96 * exact < mesh.volume < exact


def test_the_tract_is_drawn_once_for_each_side(written):
    scene, info, _ = written
    outside, inside = scene.mesh("tract_outside"), scene.mesh("tract_inside")
    np.testing.assert_array_equal(outside["faces"], inside["faces"][:, ::-1])
    np.testing.assert_array_equal(outside["NORMAL"], -inside["NORMAL"])
    assert info.faces == len(outside["faces"]) == len(tube().faces)
    mesh = trimesh.Trimesh(outside["POSITION"].astype(float) * 1e3, outside["faces"])
    assert mesh.volume == pytest.approx(tube().volume, rel=1e-5)
    np.testing.assert_allclose(mesh.bounds, tube().bounds, rtol=1e-6)
    materials = {item["name"]: item for item in scene.json["materials"]}
    assert materials["tract_outside"]["alphaMode"] == "BLEND"
    assert materials["tract_inside"].get("alphaMode", "OPAQUE") == "OPAQUE"
    for name in ("tract_outside", "tract_inside"):
        assert not materials[name].get("doubleSided", False)


@settings(max_examples=30, deadline=None)
@given(steps=st.integers(1, 9), links=st.integers(1, 9), seed=st.integers(0, 10**6))
def test_bones_point_along_links_and_turn_least(steps, links, seed):
    joints = np.random.default_rng(seed).normal(size=(steps, links + 1, 3)).cumsum(axis=1)
    quaternions = compute_bone_rotations(joints)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1.0, atol=1e-12)
    back = np.diff(joints, axis=1)
    back /= np.linalg.norm(back, axis=-1, keepdims=True)
    matrices = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()
    matrices = matrices.reshape(steps, links, 3, 3)
    np.testing.assert_allclose(convert_to_matrices(quaternions), matrices, atol=1e-12)
    np.testing.assert_allclose(matrices[..., 2], back, atol=1e-7)
    # Sign-continuous, and each turn is no larger than the turn of the link's own direction.
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=-1) >= 0)
    turns = matrices[1:] @ np.swapaxes(matrices[:-1], -1, -2)
    angle = Rotation.from_matrix(turns.reshape(-1, 3, 3)).magnitude() if steps > 1 else []
    wanted = np.arctan2(
        np.linalg.norm(np.cross(back[1:], back[:-1]), axis=-1), np.sum(back[1:] * back[:-1], -1)
    )
    np.testing.assert_allclose(angle, wanted.ravel(), atol=1e-6)


def test_a_link_that_turns_right_round_stays_finite_and_exact():
    joints = np.array(
        [[[0, 0, 0], [0, 0, 1.0]], [[0, 0, 0], [0, 0, -1.0]], [[0, 0, 0], [1.0, 0, 0]]]
    )
    matrices = convert_to_matrices(compute_bone_rotations(joints))
    np.testing.assert_allclose(matrices[:, 0, :, 2], joints[:, 1], atol=1e-12)


def test_halfway_between_keys_a_viewer_sees_no_roll(written):
    scene, _, _ = written
    for bone in scene.bones[:3]:
        turns = Rotation.from_quat(scene.tracks[bone, "rotation"])
        between = Slerp(scene.times, turns)(0.5 * (scene.times[1:] + scene.times[:-1]))
        for before, middle in zip(turns[:-1], between, strict=True):
            roll = (middle * before.inv()).as_rotvec() @ before.as_matrix()[:, 2]
            assert abs(roll) < 1e-6


def test_neighbouring_bones_are_not_twisted_in_the_first_key():
    joints = wind(steps=1, links=30)
    matrices = convert_to_matrices(compute_bone_rotations(joints))[0]
    turns = Rotation.from_matrix(matrices[1:] @ np.swapaxes(matrices[:-1], -1, -2)).as_rotvec()
    np.testing.assert_allclose(np.sum(turns * matrices[:-1, :, 2], axis=1), 0.0, atol=1e-9)


def test_the_tip_camera_and_lamp_ride_on_the_head(written):
    scene, _, joints = written
    for name in ("tip_camera", "tip_lamp"):
        node = scene.node(name)
        assert scene.parents[node] == scene.bones[0]
        for key in (0, 11, 24):
            step = int(np.rint(scene.times[key] / 9.0 * (len(joints) - 1)))
            head, neck = 1e-3 * joints[step, :2] @ UPRIGHT.T
            ahead = (head - neck) / np.linalg.norm(head - neck)
            place = scene.place(node, key)
            np.testing.assert_allclose(-place[:3, 2], ahead, atol=1e-5)
            offset = (place[:3, 3] - head) @ ahead
            assert 1.0 < offset / (0.5e-3 * DIAMETER) < 1.2
    camera = scene.json["cameras"][scene.json["nodes"][scene.node("tip_camera")]["camera"]]
    assert 0 < camera["perspective"]["znear"] < 0.1e-3 * DIAMETER
    assert scene.json["extensionsUsed"] == ["KHR_materials_unlit", "KHR_lights_punctual"]
    assert "extensionsRequired" not in scene.json


def test_the_overview_camera_sees_everything_with_the_head_up(written):
    scene, _, _ = written
    node = scene.node("overview")
    camera = scene.json["cameras"][scene.json["nodes"][node]["camera"]]["perspective"]
    tract = scene.mesh("tract_outside")["POSITION"] @ UPRIGHT.T
    points = np.concatenate([tract, scene.mesh("scope_skin")["POSITION"]])
    place = scene.place(node)
    seen = (points - place[:3, 3]) @ place[:3, :3]
    assert camera["znear"] < (-seen[:, 2]).min() and (-seen[:, 2]).max() < camera["zfar"]
    assert np.max(np.abs(seen[:, :2]) / -seen[:, 2:]) < np.tan(camera["yfov"] / 2)
    np.testing.assert_allclose(place[:3, :3] @ [0, 1, 0], [0, 1, 0], atol=1e-6)
    # Seen from the front: the patient's right (+x in RAS) is on the left of the picture.
    assert (place[:3, :3].T @ UPRIGHT @ [1, 0, 0])[0] == pytest.approx(-1.0)


def test_the_same_input_gives_the_same_bytes(written, tmp_path):
    scene, info, joints = written
    assert write_tube_scene(tmp_path / "again.glb", joints) == info
    assert (tmp_path / "again.glb").read_bytes() == scene.path.read_bytes()


def test_the_path_is_drawn_as_given(written):
    scene, _, joints = written
    (mesh,) = (item for item in scene.json["meshes"] if item["name"] == "path")
    assert mesh["primitives"][0]["mode"] == 3
    points = scene.array(mesh["primitives"][0]["attributes"]["POSITION"])
    np.testing.assert_allclose(1e3 * points, joints[:, 0], atol=1e-5)


def test_trimesh_opens_it_and_finds_tract_and_scope_in_one_place(written):
    scene, _, joints = written
    loaded = trimesh.load(scene.path, force="scene")
    transform, geometry = loaded.graph["tract_outside"]
    found = trimesh.transform_points(loaded.geometry[geometry].vertices, transform)
    wanted = 1e-3 * tube().vertices @ UPRIGHT.T
    np.testing.assert_allclose(found.min(axis=0), wanted.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(found.max(axis=0), wanted.max(axis=0), atol=1e-6)
    transform, geometry = loaded.graph["scope_skin"]
    skin = trimesh.transform_points(loaded.geometry[geometry].vertices, transform)
    chain = 1e-3 * joints[-1] @ UPRIGHT.T
    radius = 0.5e-3 * DIAMETER
    assert np.all(np.abs(skin.min(axis=0) - chain.min(axis=0)) <= 1.001 * radius)
    assert np.all(np.abs(skin.max(axis=0) - chain.max(axis=0)) <= 1.001 * radius)


@given(steps=st.integers(1, 5000), keys=st.integers(2, 300))
def test_keys_are_spread_evenly_from_first_to_last(steps, keys):
    chosen = choose_keys(steps, keys)
    assert chosen[0] == 0 and chosen[-1] == steps - 1
    assert len(chosen) == min(steps, keys)
    gaps = np.diff(chosen)
    assert len(gaps) == 0 or (gaps.min() >= 1 and gaps.max() - gaps.min() <= 1)


def test_a_surface_turned_inwards_or_cut_in_loose_triangles_gives_the_same_outside(tmp_path):
    surface = tube()
    loose = surface.vertices[surface.faces].reshape(-1, 3)
    inputs = {
        "as_is": (surface.vertices, surface.faces),
        "inwards": (surface.vertices, surface.faces[:, ::-1]),
        "loose": (loose, np.arange(len(loose)).reshape(-1, 3)),
    }
    for name, given_surface in inputs.items():
        path = tmp_path / f"{name}.glb"
        write_scene(path, surface=given_surface, joints=wind(3, 2), diameter=DIAMETER)
        mesh = Scene(path).mesh("tract_outside")
        assert len(mesh["POSITION"]) == len(surface.vertices)
        volume = trimesh.Trimesh(mesh["POSITION"].astype(float) * 1e3, mesh["faces"]).volume
        assert volume == pytest.approx(surface.volume, rel=1e-5)


def test_a_fine_surface_is_decimated_but_keeps_its_shape_and_place(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=40.0)
    ball.apply_translation([500.0, -300.0, 900.0])
    info = write_scene(
        tmp_path / "a.glb",
        surface=(ball.vertices, ball.faces),
        joints=wind(3, 2),
        diameter=DIAMETER,
        options=SceneOptions(max_faces=2000),
    )
    assert 1800 < info.faces <= 2000 < len(ball.faces)
    mesh = Scene(tmp_path / "a.glb").mesh("tract_outside")
    radius = np.linalg.norm(1e3 * mesh["POSITION"] - [500.0, -300.0, 900.0], axis=1)
    assert np.abs(radius - 40.0).max() < 0.4


def test_links_that_do_not_keep_their_length_are_reported(tmp_path):
    joints = wind(10, 4)
    surface = tube()
    common = {"surface": (surface.vertices, surface.faces), "diameter": DIAMETER}
    info = write_scene(tmp_path / "a.glb", joints=joints, **common)
    assert info.link_length_change < 1e-9
    joints[3, 4] += 0.5 * (joints[3, 4] - joints[3, 3]) / 6.0
    info = write_scene(tmp_path / "b.glb", joints=joints, **common)
    assert info.link_length_change == pytest.approx(0.5)


BAD = {
    "nan joints": ({"joints": np.full((2, 3, 3), np.nan)}, "joints has 6 point"),
    "flat joints": ({"joints": np.zeros((4, 3))}, r"joints has shape \(4, 3\)"),
    "2-D joints": ({"joints": np.ones((2, 4, 2))}, "joints has shape"),
    "one joint": ({"joints": np.ones((2, 1, 3))}, "joints has shape"),
    "no step": ({"joints": np.ones((0, 4, 3))}, "joints has shape"),
    "no length": ({"joints": np.ones((2, 4, 3))}, "link 0 is 0 mm long"),
    "no diameter": ({"diameter": 0.0}, "diameter is 0 mm"),
    "negative diameter": ({"diameter": -5.0}, "diameter is -5 mm"),
    "nan diameter": ({"diameter": float("nan")}, "diameter is nan"),
    "no time": ({"options": {"duration": 0.0}}, "duration is 0 s"),
    "one key": ({"options": {"keys": 1}}, "keys is 1"),
    "no faces": ({"options": {"max_faces": 0}}, "max_faces is 0"),
    "empty surface": ({"surface": (np.zeros((0, 3)), np.zeros((0, 3), int))}, "surface has 0"),
    "no pair": ({"surface": np.zeros((5, 3))}, "surface must be a pair"),
    "quads": ({"surface": (np.eye(3), np.zeros((2, 4), int))}, "surface faces has shape"),
    "float faces": ({"surface": (np.eye(3), np.zeros((2, 3)))}, "surface faces has shape"),
    "index out": ({"surface": (np.eye(3), np.array([[0, 1, 3]]))}, "indices 0 to 3"),
    "nan vertex": (
        {"surface": (np.full((3, 3), np.nan), np.array([[0, 1, 2]]))},
        "surface vertices has 3 point",
    ),
    "no area": ({"surface": (np.eye(3), np.array([[0, 1, 1]]))}, "zero area"),
    "short path": ({"path": np.zeros((1, 3))}, "path has shape"),
}


@pytest.mark.parametrize("case", list(BAD))
def test_wrong_input_is_one_clear_line_and_no_file(case, tmp_path):
    change, message = BAD[case]
    surface = tube()
    given = {"surface": (surface.vertices, surface.faces), "joints": wind(3, 3), "diameter": 5.0}
    given |= change
    with pytest.raises(InputError, match=message) as caught:
        write_scene(
            tmp_path / "a.glb", **{**given, "options": SceneOptions(**given.get("options", {}))}
        )
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_is_not_there_is_an_output_error(tmp_path):
    surface = tube()
    with pytest.raises(OutputError):
        write_scene(
            tmp_path / "no" / "a.glb",
            surface=(surface.vertices, surface.faces),
            joints=wind(3, 3),
            diameter=5.0,
        )


def test_khronos_validator_has_nothing_to_say():
    """Run where Node and its package gltf-validator are found (set NODE_PATH); else skipped."""
    node = shutil.which("node")
    found = node and subprocess.run(
        [node, "-e", "require('gltf-validator')"], capture_output=True, env=os.environ
    )
    if not found or found.returncode:
        pytest.skip("Node with the package gltf-validator is not installed")
    script = (
        "require('gltf-validator').validateBytes(new Uint8Array(require('fs').readFileSync("
        "process.argv[1]))).then(r => console.log(JSON.stringify(r.issues)))"
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.glb"
        surface = tube()
        write_scene(
            path, surface=(surface.vertices, surface.faces), joints=wind(), diameter=DIAMETER
        )
        run = subprocess.run([node, "-e", script, str(path)], capture_output=True, check=True)
    assert json.loads(run.stdout)["messages"] == []
