from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.measure import marching_cubes

from bozzini.anatomy import tract_from_surface
from bozzini.anatomy._mesh import find_voxels
from bozzini.anatomy.kernels.meshes import cross_groups
from bozzini.errors import GeometryError, InputError


def codes(tract):
    return {finding.code: finding for finding in tract.findings}


def ball(radius=20.0, centre=(0, 0, 0), subdivisions=3):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.asarray(mesh.vertices) + np.asarray(centre, dtype=float), np.asarray(mesh.faces)


def join(*parts):
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + at for (_, faces), at in zip(parts, starts, strict=False)]),
    )


def count_fans(faces):
    """Count the fans of triangles around vertices, and the sheets, by trimesh's neighbours."""
    mesh = trimesh.Trimesh(faces=faces, process=False)
    pairs, edges = mesh.face_adjacency, mesh.face_adjacency_edges
    joined = [
        [3 * face + list(faces[face]).index(corner) for face in pair]
        for pair, edge in zip(pairs, edges, strict=True)
        for corner in edge
    ]
    count = trimesh.graph.connected_component_labels
    fans, sheets = count(np.array(joined), node_count=3 * len(faces)), count(pairs, len(faces))
    return len(set(fans)), len(set(sheets))


def test_a_clean_surface_passes_without_a_word():
    vertices, faces = ball()
    tract = tract_from_surface(vertices, faces)
    assert tract.findings == ()
    assert tract.volume == pytest.approx(trimesh.Trimesh(vertices, faces).volume)
    assert len(tract.faces) == len(faces)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), share=st.floats(0.0, 1.0))
def test_loose_triangles_in_any_order_and_turn_become_the_same_surface(seed, share):
    random = np.random.default_rng(seed)
    vertices, faces = ball(subdivisions=2)
    loose = vertices[faces][random.permutation(len(faces))]
    turned = random.random(len(loose)) < share
    loose[turned] = loose[turned, ::-1]
    tract = tract_from_surface(loose.reshape(-1, 3), np.arange(3 * len(loose)).reshape(-1, 3))
    mesh = trimesh.Trimesh(tract.vertices, tract.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert tract.volume == pytest.approx(trimesh.Trimesh(vertices, faces).volume)
    assert len(tract.vertices) == len(vertices)


def test_a_surface_inside_out_is_turned():
    vertices, faces = ball()
    tract = tract_from_surface(vertices, faces[:, ::-1])
    assert tract.volume > 0
    assert set(codes(tract)) == {"surface-turned"}


def test_the_largest_component_is_kept():
    vertices, faces = join(ball(5.0, (60, 0, 0)), ball(20.0), ball(4.0, (-60, 0, 0)))
    tract = tract_from_surface(vertices, faces)
    assert np.abs(tract.vertices).max() < 21.0
    dropped = codes(tract)["components-dropped"]
    assert "3 components" in dropped.message
    assert dropped.severity == "warning"


def turn_some(part, share, seed=0):
    """Return a part with a share of its triangles turned inside out."""
    vertices, faces = part
    turned = np.random.default_rng(seed).random(len(faces)) < share
    return vertices, np.where(turned[:, None], faces[:, ::-1], faces)


def rod(radius, height, x=0.0):
    mesh = trimesh.creation.cylinder(radius=radius, height=height)
    return np.asarray(mesh.vertices) + (x, 0.0, 0.0), np.asarray(mesh.faces)


@pytest.mark.parametrize("share", [0.3, 0.45, 1.0])
def test_the_volumes_that_are_named_are_those_of_triangles_turned_right(share):
    large, small = rod(8.0, 80.0), rod(6.0, 60.0, 40.0)
    size, other = (trimesh.Trimesh(*part).volume for part in (large, small))
    tract = tract_from_surface(*join(turn_some(large, share), turn_some(small, 0.2)))
    assert tract.volume == pytest.approx(size)
    assert [part.volume for part in tract.not_reached] == pytest.approx([other])
    dropped = codes(tract)["components-dropped"].message
    assert f"the largest ({size / 1000:.3g} mL) is kept" in dropped
    assert f"and {other / 1000:.3g} mL, wholly outside" in dropped


def test_a_one_sided_part_keeps_no_other_from_being_turned():
    corners = [(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)]
    band = []
    for k, (x, y) in enumerate(corners):
        twist = np.pi * k / 24
        for side in (-4.0, 4.0):
            reach = 12.0 + side * np.cos(twist)
            band.append((x * reach, y * reach, side * np.sin(twist)))
    faces = []
    for k in range(24):
        a, b = 2 * k, 2 * k + 1
        c, d = (2 * k + 2, 2 * k + 3) if k < 23 else (1, 0)  # joined the wrong way round
        faces += [(a, c, b), (b, c, d)]
    moebius = np.array(band) + (0.0, 0.0, 200.0), np.array(faces)
    large, small = rod(8.0, 80.0), rod(6.0, 60.0, 40.0)
    tract = tract_from_surface(*join(turn_some(large, 0.4), turn_some(small, 0.4), moebius))
    assert tract.volume == pytest.approx(trimesh.Trimesh(*large).volume)
    assert tract.not_reached[0].volume == pytest.approx(trimesh.Trimesh(*small).volume)


def test_sheets_that_touch_in_a_corner_are_turned_each_for_itself():
    low, high = ball(20.0), ball(10.0)
    bottom, top = high[0][high[0][:, 2].argmin()], low[0][low[0][:, 2].argmax()]
    high = high[0] - bottom + top, high[1]
    both = sum(trimesh.Trimesh(*part).volume for part in (low, high))
    for one, other in ((low, inside_out(high)), (inside_out(low), high)):
        tract = tract_from_surface(*join(one, other))
        assert tract.volume == pytest.approx(both)
        assert winding_at(tract, (0, 0, 0), (0, 0, 30.0)) == pytest.approx(1.0)
        assert codes(tract)["surface-turned"].severity == "note"


def inside_out(part):
    return part[0], part[1][:, ::-1]


def holds_triangles(tract, vertices, faces):
    """Say whether each triangle given is one of the tract's."""
    wanted = {tuple(sorted(map(tuple, corners))) for corners in np.round(vertices[faces], 9)}
    there = np.round(tract.vertices[tract.faces], 9)
    return wanted <= {tuple(sorted(map(tuple, corners))) for corners in there}


def winding_at(tract, *points):
    import igl

    return igl.winding_number(tract.vertices, tract.faces, np.array(points, dtype=float))


@pytest.mark.parametrize("turn", [inside_out, lambda part: part])
def test_the_lumen_of_a_wall_with_thickness_is_inside_its_inner_sheet(turn):
    speck = ball(0.5, (13.5, 0, 0), 1)  # within the wall
    tract = tract_from_surface(*join(ball(15.0), turn(ball(12.0)), speck))
    alone = tract_from_surface(*ball(12.0))
    assert tract.volume == pytest.approx(alone.volume)
    assert np.linalg.norm(tract.vertices, axis=1).max() < 12.01
    found = codes(tract)
    assert found["wall-with-thickness"].severity == "warning"
    assert "1 other" not in found["wall-with-thickness"].message
    assert "bodies-inside" not in found


def test_a_thick_wall_round_a_narrow_lumen_and_three_sheets_are_followed_inwards():
    def tube(radius, height):
        mesh = trimesh.creation.cylinder(radius=radius, height=height)
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)

    narrow = tract_from_surface(*join(tube(10.0, 200.0), inside_out(tube(4.0, 190.0))))
    assert np.linalg.norm(narrow.vertices[:, :2], axis=1).max() == pytest.approx(4.0)
    three = tract_from_surface(*join(ball(11.0), ball(15.0), inside_out(ball(13.0))))
    assert np.linalg.norm(three.vertices, axis=1).max() == pytest.approx(11.0)


@pytest.mark.parametrize(
    ("radius", "height", "shift"),
    [(4.0, 190.0, 3.0), (4.0, 165.0, 0.0), (4.0, 165.0, 15.0), (2.4, 198.0, 0.0)],
)
@pytest.mark.parametrize("turn", [inside_out, lambda part: part])
def test_a_tube_in_the_lumen_is_not_taken_for_its_wall(turn, radius, height, shift):
    def tube(radius, height, place=(0.0, 0.0, 0.0)):
        mesh = trimesh.creation.cylinder(radius=radius, height=height)
        return np.asarray(mesh.vertices) + place, np.asarray(mesh.faces)

    place = (shift, 0.0, 0.0) if height > 170.0 else (0.0, 0.0, shift)
    both = join(tube(10.0, 200.0), turn(tube(radius, height, place)))
    with pytest.raises(
        InputError, match=r"with --part: '1' \(62.* mL\) or '2' \(.* mL\)"
    ) as caught:
        tract_from_surface(*both)
    assert "\n" not in str(caught.value)
    # A small one is a body in the lumen.
    thin = tract_from_surface(*join(tube(10.0, 200.0), turn(tube(1.0, height, place))))
    assert "bodies-inside" in codes(thin)


@pytest.mark.parametrize("turn", [inside_out, lambda part: part])
def test_bodies_in_the_lumen_stay_as_wall(turn):
    bodies = (turn(ball(3.0, (8, 0, 0))), ball(2.0, (-8, 0, 0)))
    outside = ball(4.0, (60, 0, 0))
    tract = tract_from_surface(*join(ball(20.0), *bodies, outside))
    winding = winding_at(tract, (0, 0, 0), (8, 0, 0), (-8, 0, 0), (60, 0, 0), (17, 0, 0))
    assert winding == pytest.approx([1, 0, 0, 0, 1], abs=1e-9)
    found = codes(tract)
    assert found["bodies-inside"].message.startswith("2 closed parts lie inside the lumen")
    assert "1 other " in found["components-dropped"].message
    assert "handles" not in found


def test_two_large_bodies_side_by_side_are_not_taken_for_the_wall():
    def block(size, x=0.0):
        mesh = trimesh.creation.box(extents=size)
        return np.asarray(mesh.vertices) + [x, 0.0, 0.0], np.asarray(mesh.faces)

    bodies = (block((27, 27, 27), 14.5), block((27, 27, 27), -14.5))
    tract = tract_from_surface(*join(block((60, 30, 30)), *bodies))
    assert winding_at(tract, (14.5, 0, 0), (0, 5, 0)) == pytest.approx([0, 1], abs=1e-9)
    assert "wall-with-thickness" not in codes(tract)


def test_an_open_piece_inside_the_lumen_is_warned_of():
    vertices, faces = ball(3.0)
    half = (vertices, faces[vertices[faces].mean(axis=1)[:, 2] > 0])
    tract = tract_from_surface(*join(ball(20.0), half))
    assert codes(tract)["pieces-inside"].severity == "warning"
    assert winding_at(tract, (0, 0, 2), (0, 0, 10)) == pytest.approx([1, 1], abs=1e-9)
    assert holds_triangles(tract, *half)


def test_a_small_hole_is_filled_and_a_large_one_is_located():
    vertices, faces = ball()
    whole = tract_from_surface(vertices, faces)
    filled = tract_from_surface(vertices, faces[1:])
    assert "holes-filled" in codes(filled)
    assert filled.volume == pytest.approx(whole.volume, rel=1e-3)
    middle = vertices[faces].mean(axis=1)
    with pytest.raises(GeometryError) as caught:
        tract_from_surface(vertices + [100.0, 0, 0], faces[middle[:, 2] < 0.0])
    said = str(caught.value)
    assert "boundary edges in 1 hole, near (100.0, " in said
    height = float(said.split("near (")[1].split(")")[0].split(",")[2])
    assert -3.0 < height < 3.0


def test_an_open_end_is_capped_flat_and_is_a_candidate_for_an_end():
    vertices, faces = ball()
    height = vertices[faces].mean(axis=1)[:, 2]
    for turned in (faces, faces[:, ::-1]):
        tract = tract_from_surface(vertices, turned[(height < 15.0) & (height > -17.0)])
        first, second = tract.openings
        assert (first.name, second.name) == ("opening 1", "opening 2")
        assert first.point == pytest.approx((0.0, 0.0, 15.0), abs=1.5)
        assert second.point == pytest.approx((0.0, 0.0, -17.0), abs=1.5)
        assert first.radius == pytest.approx(np.sqrt(20.0**2 - 15.0**2), rel=0.1)
        mesh = trimesh.Trimesh(tract.vertices, tract.faces, process=False)
        assert mesh.is_watertight
        assert tract.volume > 0.0
        assert "ends-capped" in codes(tract)
        assert "capped" in tract.wall


def test_corners_apart_by_rounding_are_welded():
    vertices, faces = ball()
    random = np.random.default_rng(1)
    loose = vertices[faces].reshape(-1, 3) + random.uniform(-5e-5, 5e-5, (3 * len(faces), 3))
    tract = tract_from_surface(loose, np.arange(len(loose)).reshape(-1, 3))
    assert "corners-welded" in codes(tract)
    assert len(tract.vertices) == len(vertices)


@pytest.mark.parametrize("rings", [1, 2])
def test_handles_are_counted(rings):
    torus = trimesh.creation.torus(major_radius=20.0, minor_radius=5.0)
    vertices, faces = np.asarray(torus.vertices), np.asarray(torus.faces)
    if rings == 2:
        other = trimesh.creation.torus(major_radius=20.0, minor_radius=5.0)
        moved = np.asarray(other.vertices) + [100.0, 0.0, 0.0]
        # A bridge: two triangles taken off, three quads between their corners put on.
        one = int(vertices[faces].mean(axis=1)[:, 0].argmax())
        two = int(moved[other.faces].mean(axis=1)[:, 0].argmin())
        a, b = faces[one], np.asarray(other.faces)[two] + len(vertices)
        b = b[::-1]
        start = np.linalg.norm(vertices[a[0]] - moved[b - len(vertices)], axis=1).argmin()
        b = np.roll(b, -int(start))
        faces = np.concatenate(
            (
                np.delete(faces, one, axis=0),
                np.delete(np.asarray(other.faces) + len(vertices), two, axis=0),
                [(a[i], a[(i + 1) % 3], b[i]) for i in range(3)],
                [(a[(i + 1) % 3], b[(i + 1) % 3], b[i]) for i in range(3)],
            )
        )
        vertices = np.concatenate((vertices, moved))
    found = codes(tract_from_surface(vertices, faces))
    assert found["handles"].message.startswith(f"{rings} handle")
    assert "self-touching" not in found


def test_two_balls_that_touch_in_one_corner_touch_themselves():
    one = ball()
    far = int(one[0][:, 0].argmax())
    other = (2 * one[0][far] - one[0], one[1][:, ::-1])
    vertices, faces = join(one, other)
    tract = tract_from_surface(vertices, faces)
    assert "1 corner(s)" in codes(tract)["self-touching"].message
    assert "handles" not in codes(tract)
    assert count_fans(tract.faces) == (len(tract.vertices) + 1, 2)


def test_handles_are_those_of_the_sheets_that_touch():
    torus = trimesh.creation.torus(major_radius=20.0, minor_radius=5.0)
    vertices, faces = np.asarray(torus.vertices), np.asarray(torus.faces)
    order = vertices[faces].mean(axis=1)[:, 0].argsort()
    # Two tetrahedra that stand with one edge each on an edge of the ring, left and right.
    for face, side in ((order[-1], 40.0), (order[0], -40.0)):
        a, b, c, d = *faces[face][:2], len(vertices), len(vertices) + 1
        vertices = np.concatenate((vertices, [(side, 0.0, 4.0), (side, 0.0, -4.0)]))
        faces = np.concatenate((faces, [(a, b, c), (a, d, b), (a, c, d), (b, d, c)]))
    tract = tract_from_surface(vertices, faces)
    assert "2 edge(s)" in codes(tract)["self-touching"].message
    assert codes(tract)["handles"].message.startswith("1 handle ")


def test_only_the_fewer_triangles_are_turned():
    vertices, faces = ball()
    for number in (1, 5):
        some = faces.copy()
        some[:number] = some[:number, ::-1]
        for turned in (some, some[:, ::-1]):
            said = codes(tract_from_surface(vertices, turned))["faces-turned"].message
            assert said.startswith(f"{number} triangle(s)")


def crossing_reference(vertices, faces):
    """Say the same by solving for the point where each edge meets each triangle."""
    crossed = np.zeros(len(faces), dtype=bool)
    for i, one in enumerate(faces):
        for j, other in enumerate(faces):
            if i == j or set(one) & set(other):
                continue
            for k in range(3):
                p, q = vertices[one[k]], vertices[one[(k + 1) % 3]]
                a, b, c = vertices[other]
                matrix = np.stack((b - a, c - a, p - q), axis=1)
                if abs(np.linalg.det(matrix)) < 1e-12:
                    continue
                u, v, t = np.linalg.solve(matrix, p - a)
                if u > 0 and v > 0 and u + v < 1 and 0 < t < 1:
                    crossed[i] = crossed[j] = True
    return crossed


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), cell=st.floats(0.05, 5.0))
def test_crossing_triangles_are_those_of_the_plain_method(seed, cell):
    random = np.random.default_rng(seed)
    centres = random.uniform(0, 3, (14, 1, 3))
    vertices = (centres + random.uniform(-0.7, 0.7, (14, 3, 3))).reshape(-1, 3)
    faces = np.arange(42).reshape(-1, 3)
    faces[1, 0] = faces[0, 0]  # two that share a corner
    expected = crossing_reference(vertices, faces)
    assert np.array_equal(cross_groups(vertices, faces, cell, np.arange(len(faces))), expected)


def test_a_surface_that_crosses_itself_is_warned_of():
    vertices, faces = ball()
    vertices[vertices[:, 2] > 15.0, 2] -= 60.0  # the cap pushed through the other side
    assert "self-crossing" in codes(tract_from_surface(vertices, faces))


def test_a_tiny_or_huge_tract_hints_at_the_unit():
    vertices, faces = ball(2.0)
    assert "--unit m" in codes(tract_from_surface(vertices, faces))["scale"].message
    assert "scale" in codes(tract_from_surface(*ball(2_500.0)))


def test_a_far_corner_does_not_weld_the_rest_away():
    vertices, faces = ball()
    vertices[0] = 5e8
    with pytest.raises(GeometryError, match="is open"):
        tract_from_surface(vertices, faces[1:-40])


def knock(vertices, faces, wanted):
    """Take out the triangles at some corners of a ball: a hole of more than four edges."""
    return faces[~np.isin(faces, wanted).any(axis=1)]


def test_a_small_hole_of_more_edges_needs_repair_and_has_its_place():
    vertices, faces = ball(subdivisions=4)
    corner = int(vertices[:, 0].argmax())
    holed = knock(vertices, faces, [corner])
    with pytest.raises(GeometryError) as caught:
        tract_from_surface(vertices, holed)
    assert "--repair" in str(caught.value)
    place = [float(word) for word in str(caught.value).split("near (")[1].split(")")[0].split(",")]
    assert place == pytest.approx(vertices[corner], abs=1.5)
    mended = tract_from_surface(vertices, holed, repair=True)
    assert mended.openings == ()
    assert "near (1" in codes(mended)["holes-filled"].message
    assert mended.volume == pytest.approx(tract_from_surface(vertices, faces).volume, rel=2e-3)


@pytest.mark.slow
def test_corners_doubled_by_more_than_rounding_are_welded_by_repair():
    vertices, faces = ball()
    random = np.random.default_rng(1)
    loose = vertices[faces].reshape(-1, 3) + random.uniform(-5e-3, 5e-3, (3 * len(faces), 3))
    index = np.arange(len(loose)).reshape(-1, 3)
    with pytest.raises(GeometryError):
        tract_from_surface(loose, index)
    mended = tract_from_surface(loose, index, repair=True)
    assert "near (" in codes(mended)["corners-welded"].message
    assert mended.volume == pytest.approx(tract_from_surface(vertices, faces).volume, rel=1e-2)


def test_repair_tells_what_it_changed_and_leaves_the_rest():
    vertices, faces = ball()
    same = tract_from_surface(vertices, faces, repair=True)
    assert np.array_equal(same.vertices, tract_from_surface(vertices, faces).vertices)
    assert "repaired" not in codes(same)
    # A triangle torn inwards by less than --repair welds; without it that is a body in the lumen.
    seam = (1.0 - 5e-4) * vertices[faces[7]]
    torn = np.concatenate([vertices, seam])
    index = faces.copy()
    index[7] = len(vertices) + np.arange(3)
    plain, mended = (tract_from_surface(torn, index, repair=repair) for repair in (False, True))
    text = codes(mended)["repaired"].message
    assert codes(mended)["repaired"].severity == "warning"
    for before, after, name in (
        (plain.vertices, mended.vertices, "corners"),
        (plain.faces, mended.faces, "triangles"),
    ):
        assert f"{len(before)} {name} became {len(after)}" in text
    moved = float(text.split("moved by up to ")[1].split(" mm")[0])
    assert 0.0 < moved <= 0.01 * np.sqrt(3.0) + 1e-3
    # What is not at an open edge stays where it was.
    kept = np.setdiff1d(np.unique(np.delete(faces, 7, axis=0)), faces[7])
    known = {tuple(point) for point in mended.vertices.tolist()}
    assert all(tuple(point) in known for point in vertices[kept].tolist())


def make_cubes(shape, spacing, *, mask):
    index = np.indices(shape).transpose(1, 2, 3, 0) * spacing
    middle = 0.5 * np.array(shape) * spacing
    along = np.clip(index[..., 2] - middle[2], -16.0, 16.0)[..., None] * [0.0, 0.0, 1.0]
    inside = np.linalg.norm(index - middle - along, axis=-1) - 6.3
    values = (inside < 0.0).astype(np.float32) if mask else -inside
    found = marching_cubes(values, 0.5 if mask else 0.0, spacing=tuple(spacing))
    return found[0] + [3.3, 1.7, -40.0], found[1]


@pytest.mark.parametrize("mask", [True, False])
@pytest.mark.parametrize("spacing", [(3.0, 3.0, 2.0), (1.5, 1.5, 1.5)])
def test_a_surface_made_from_voxels_shows_their_size(mask, spacing):
    shape = np.ceil(np.array([24.0, 24.0, 60.0]) / spacing).astype(int)
    points, faces = make_cubes(tuple(shape), np.array(spacing), mask=mask)
    found = find_voxels(points.astype(np.float32).astype(float))
    assert found == pytest.approx(np.array(spacing), rel=1e-4)
    tract = tract_from_surface(points, faces)
    assert tract.source_error == pytest.approx(0.5 * np.linalg.norm(spacing), rel=1e-4)
    text = codes(tract)["voxel-surface"].message
    assert f"{0.5 * np.linalg.norm(spacing):.2f} mm" in text
    # Turned or smoothed nothing is seen, nor in a surface that was never made of voxels.
    turn = trimesh.transformations.rotation_matrix(0.3, [1.0, 1.0, 0.0])[:3, :3]
    assert find_voxels(points @ turn.T) is None
    boxes = trimesh.creation.box((30.0, 20.0, 100.0)).subdivide_to_size(3.0)
    for other in (ball(subdivisions=4)[0], boxes.vertices):
        assert find_voxels(np.asarray(other)) is None


def test_loops_that_touch_are_split_by_repair_with_their_place():
    one = ball()
    far = int(one[0][:, 0].argmax())
    vertices, faces = join(one, (2 * one[0][far] - one[0], one[1][:, ::-1]))
    before = tract_from_surface(vertices, faces)
    assert "near (20.0, 0.0, 0.0)" in codes(before)["self-touching"].message
    after = tract_from_surface(vertices, faces, repair=True)
    assert "near (20.0, 0.0, 0.0)" in codes(after)["corners-split"].message
    assert count_fans(after.faces)[0] == len(after.vertices)
    assert after.volume == pytest.approx(before.volume)
    plate = np.array([(0.0, -9, -9), (0, 9, -9), (0, 0, 9)])
    with_plate = join((vertices, faces), (plate, np.array([[0, 1, 2]])))
    both = tract_from_surface(*with_plate, repair=True)
    assert holds_triangles(both, *with_plate)
