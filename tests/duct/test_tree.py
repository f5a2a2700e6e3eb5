"""The tree of a lumen, against random trees of which all is known, and the tree of an airway."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bozzini.anatomy import read_tract
from bozzini.duct import LumenTree, build_field, field_from_mask, find_tree
from bozzini.duct.tree import Branch, order_branches
from bozzini.duct.tree_files import read_tree, write_swc, write_vtp
from bozzini.errors import FileFormatError, GeometryError, InputError

from .branching import KnownTree, grow


@pytest.mark.parametrize("seed", range(6))
def test_random_trees_have_their_branches_ends_and_radii(seed: int) -> None:
    known = grow(seed)
    tree = find_tree(known.rasterise(1.0, offset=0.13 * seed))
    ends = np.array([branch.points[-1] for branch in tree.ends])
    gaps, which = cKDTree(known.end[known.ends]).query(ends)
    assert len(tree.branches) == len(known.parent)
    assert sorted(which) == list(range(len(known.ends)))
    assert gaps.max() < 3.0
    assert np.linalg.norm(tree.branches[0].points[0] - known.start[0]) < 2.5
    for branch, tube in zip(tree.ends, np.array(known.ends)[which], strict=True):
        assert branch.mean_radius == pytest.approx(known.radius[tube], abs=0.5)


@pytest.fixture(scope="module")
def known() -> KnownTree:
    return grow(3)


@pytest.fixture(scope="module")
def tree(known: KnownTree) -> LumenTree:
    return find_tree(known.rasterise(1.0))


def test_a_trunk_has_one_line_to_where_its_tubes_part() -> None:
    known = grow(2)
    first = find_tree(known.rasterise(1.0)).branches[0]
    assert first.length > 0.9 * np.linalg.norm(known.end[0] - known.start[0])


def test_names_paths_and_nearest_agree(tree: LumenTree) -> None:
    assert tree.branches[0].name == "0"
    assert not tree.findings
    for index, branch in enumerate(tree.branches):
        route = tree.list_route(branch.name)
        path = tree.path(index)
        assert branch.generation == branch.name.count(".") == len(route) - 1
        assert path.length == pytest.approx(sum(tree.branches[k].length for k in route))
        assert np.array_equal(path.points[-1], branch.points[-1])
        found, gap = tree.nearest(branch.points[len(branch.points) // 2])
        assert (found, gap) == (index, 0.0)
        assert np.all(branch.radius >= branch.clearance)
        if branch.parent >= 0:
            assert np.array_equal(branch.points[0], tree.branches[branch.parent].points[-1])
    assert len(tree.to_frame()) == len(tree.to_dict()["branches"]) == len(tree.branches)
    assert tree.plot().lines
    with pytest.raises(InputError, match="branch"):
        tree.path("0.7")


def test_networkx_has_the_same_tree(tree: LumenTree) -> None:
    networkx = pytest.importorskip("networkx")
    graph = tree.to_networkx()
    assert networkx.is_arborescence(graph)
    assert graph.size("length_mm") == pytest.approx(tree.length)


def test_odd_lumens_are_reported(known: KnownTree) -> None:
    mask, affine = known.label(1.0)
    mask[1:4, 1:4, 1:6] = True
    mask[tuple(np.rint(0.5 * known.end[0] - affine[:3, 3]).astype(int))] = False
    found = find_tree(field_from_mask(mask, affine)).findings
    assert [(item.code, round(item.size)) for item in found] == [("loose-part", 45), ("hole", 1)]


def test_a_root_inside_a_branch_is_named_and_one_outside_refused(known: KnownTree) -> None:
    field = known.rasterise(1.0)
    inside = find_tree(field, 0.5 * known.end[0])
    assert [item.code for item in inside.findings] == ["root-inside"]
    with pytest.raises(GeometryError, match="root .* lies outside the lumen"):
        find_tree(field, (500.0, 0.0, 0.0))


def test_a_bridge_is_a_loop_and_not_followed(known: KnownTree) -> None:
    one, two = (0.4 * known.start[k] + 0.6 * known.end[k] for k in (1, 8))
    bridged = replace(
        known,
        start=np.vstack([known.start, one]),
        end=np.vstack([known.end, two]),
        radius=np.append(known.radius, 0.9),
        parent=(*known.parent, 0),
    )
    tree = find_tree(bridged.rasterise(1.0))
    assert [item.code for item in tree.findings if item.severity == "warning"] == ["loop"]
    assert len(tree.ends) == len(known.ends)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_a_tree_in_line_with_its_voxels_parts_where_its_tubes_do(count: int) -> None:
    """In the middle of an even number of voxels lie lines side by side: the trunk has one."""
    turn = 2.0 * np.pi * np.arange(count) / count
    tips = 30.0 * np.stack([np.cos(turn), np.sin(turn), np.full(count, -0.9)], axis=1)
    radius = 4.0 if count == 2 else 6.0
    known = KnownTree(
        start=np.array([[0.0, 0.0, 50.0], *[np.zeros(3)] * count]),
        end=np.array([np.zeros(3), *tips]),
        radius=np.array([radius, *[0.5 * radius] * count]),
        parent=(-1, *[0] * count),
    )
    for voxel in (0.6, 0.8):
        tree = find_tree(known.rasterise(voxel))
        assert len(tree.ends) == count
        assert all(tree.begins[1:] > 40.0)


def test_names_in_a_picture_are_as_many_as_fit() -> None:
    """Those of all tips, or of an earlier generation and the tips before it."""
    from matplotlib.figure import Figure

    counts = []
    for splits in (6, 40):
        known = grow(1, splits)
        tubes = np.stack([known.start, known.end], axis=1)
        tree = LumenTree(
            branches=order_branches(
                [
                    Branch("", parent, tube, np.full(2, r), np.full(2, r), 0, 0.0, False)
                    for parent, tube, r in zip(known.parent, tubes, known.radius, strict=True)
                ]
            )
        )
        ax = tree.plot(Figure().subplots())
        names = [text.get_text() for text in ax.texts]
        counts.append((len(names), len(tree.tips)))
        for tip in tree.tips:  # each has its own name or one of a branch before it
            route = {tree.branches[k].name for k in tree.list_route(tip)}
            assert len(route & set(names)) == 1
    (few, all_few), (many, all_many) = counts
    assert few == all_few
    assert 1 < many <= 24 < all_many


@pytest.mark.parametrize(("away", "severity"), [(1, "note"), (8, "warning")])
def test_a_loop_round_a_voxel_where_branches_part_is_a_note(away: int, severity: str) -> None:
    """Of its own size, not that of the way by the lines; farther from there it is a loop."""
    tips = np.array([[8.0, 0.0, -45.0], [-8.0, 0.0, -45.0]])
    known = KnownTree(
        start=np.array([[0.0, 0.0, 30.0], *[np.zeros(3)] * 2]),
        end=np.array([np.zeros(3), *tips]),
        radius=np.array([4.0, 3.0, 3.0]),
        parent=(-1, 0, 0),
    )
    mask, affine = known.label(1.0)
    mid, side, top = np.rint(-affine[:3, 3]).astype(int)
    wall = top - int(np.argmin(mask[mid, side, top::-1]))
    mask[mid - 4 : mid + 5, side, wall - away] = True
    tree = find_tree(field_from_mask(mask, affine))
    assert [(item.code, item.severity) for item in tree.findings] == [("loop", severity)]
    assert len(tree.branches) == 3
    (loop,) = tree.findings
    assert (loop.size < 9.0) == (severity == "note")
    assert len(tree.ends) == 2


def test_a_ball_is_no_tree() -> None:
    away = np.linalg.norm(np.mgrid[-9:10, -9:10, -9:10], axis=0)
    with pytest.raises(GeometryError, match="no tube"):
        find_tree(field_from_mask(away < 6.0, np.eye(4)))


def test_a_voxel_or_two_are_no_tree_and_a_row_is() -> None:
    mask = np.zeros((12, 7, 7), dtype=bool)
    for count in (1, 2, 8):
        mask[2 : 2 + count, 3, 3] = True
        field = field_from_mask(mask, np.eye(4))
        if count == 8:
            assert len(find_tree(field).branches) == 1
            continue
        with pytest.raises(GeometryError, match="no tube"):
            find_tree(field)


def test_airway_agrees_with_its_own_tree(airway_dir: Path) -> None:
    rows = np.genfromtxt(airway_dir / "tree.csv", delimiter=",", skip_header=1)
    parent, places, radii = rows[:, 1].astype(int), rows[:, 2:5], rows[:, 5]
    ends = np.append(np.setdiff1d(rows[:, 0].astype(int), parent), 0)
    share = np.linspace(0.0, 1.0, 8)[:, None, None]
    line = ((1.0 - share) * places[parent[1:]] + share * places[1:]).reshape(-1, 3)
    thick = ((1.0 - share[..., 0]) * radii[parent[1:]] + share[..., 0] * radii[1:]).ravel()
    field = build_field(read_tract(airway_dir / "airway_labels_06mm.nii.gz", labels="1"))
    tree = find_tree(field)
    tips = np.array([tree.branches[0].points[0], *(b.points[-1] for b in tree.ends)])
    assert (cKDTree(tips).query(places[ends])[0] <= 4.0).sum() >= 70
    assert (cKDTree(places[ends]).query(tips)[0] > 4.0).sum() <= 1
    points = np.concatenate([branch.points for branch in tree.branches])
    radius = np.concatenate([branch.radius for branch in tree.branches])
    gaps, nearest = cKDTree(line).query(points)
    assert np.percentile(gaps, 95.0) < 0.5
    assert np.median(np.abs(radius - thick[nearest])) < 0.3


def test_a_tree_comes_back_from_swc(tree: LumenTree, tmp_path: Path) -> None:
    write_swc(tree, tmp_path / "tree.swc")
    again = read_tree(tmp_path / "tree.swc")
    assert list(again.names) == list(tree.names)
    for one, other in zip(again.branches, tree.branches, strict=True):
        assert one.points == pytest.approx(other.points, abs=1e-6)
        assert one.radius[1:] == pytest.approx(other.radius[1:], abs=1e-6)
        assert (one.parent, one.generation, one.is_end) == (
            other.parent, other.generation, other.is_end
        )  # fmt: skip
        assert one.angle == pytest.approx(other.angle, abs=1e-3)


def test_a_tree_whose_root_lies_inside_comes_back_from_swc(
    known: KnownTree, tmp_path: Path
) -> None:
    """Its root has two nodes after it, as those of neurons have."""
    path = tmp_path / "inside.swc"
    tree = find_tree(known.rasterise(1.0), 0.5 * known.end[0])
    write_swc(tree, path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    again = read_tree(path)
    assert again.list_columns()["parent"] == tree.list_columns()["parent"]
    assert again.length == pytest.approx(tree.length, abs=1e-3)


def test_a_tree_as_poly_data_has_a_line_for_each_branch(tree: LumenTree, tmp_path: Path) -> None:
    from xml.etree import ElementTree

    write_vtp(tree, tmp_path / "tree.vtp")
    root = ElementTree.parse(tmp_path / "tree.vtp").getroot()
    arrays = {each.get("Name"): (each.text or "").split() for each in root.iter("DataArray")}
    ends = np.array(arrays["offsets"], dtype=int)
    places = np.array(arrays["Points"], dtype=float).reshape(-1, 3)
    assert len(ends) == len(tree.branches)
    assert places[ends - 1] == pytest.approx(
        np.array([b.points[-1] for b in tree.branches]), rel=1e-4
    )
    generations = [branch.generation for branch in tree.branches]
    assert [float(value) for value in arrays["Generation"]] == generations


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 0 0 0 0 1", "it must be id, type, x, y, z, radius, parent"),
        ("1 0 0 0 0 0 -1\n", "its radius above 0"),
        ("1 0 0 0 0 1 -1\n2 0 0 0 1 1 -1\n", "has 2 roots"),
        ("1 0 0 0 0 1 -1\n2 0 0 0 1 1 1\n3 0 0 0 1 1 9\n", "2 of them are joined"),
        ("1 0 0 0 0 1 -1\n3 0 0 0 1 1 4\n4 0 0 0 2 1 3\n", "a ring by their parents: 4, 3"),
        ("1 0 0 0 0 1 3\n2 0 0 0 1 1 1\n3 0 0 0 2 1 2\n", "a ring by their parents: 2, 3, 1"),
        ("1 0 0 0 0 1 -1\n2 0 0 0 1e300 1 1\n", "must be within 1e\\+09 mm"),
        ("1 0 0 0 0 1 -1\n", "must have a node after it"),
        ("1 0 0 0 0 1 -1\n2 0 0 0 0 1 1\n", "the same place"),
    ],
)
def test_what_is_no_tree_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.swc"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=said):
        read_tree(path)


@pytest.mark.parametrize("end", [0, 2])
@pytest.mark.parametrize("rooted", [True, False])
def test_a_leak_at_an_end_is_told_with_its_place(known: KnownTree, end: int, rooted: bool) -> None:
    """Also where it is taken for the root, as the widest end."""
    mask, affine = known.label(1.0)
    mask = np.pad(mask, 12)
    affine[:3, 3] -= 12.0
    number = known.ends[end]
    place, size = known.end[number], 3.5 * known.radius[known.parent[number]]
    grid = np.stack(np.mgrid[tuple(map(slice, mask.shape))], axis=-1)
    mask |= np.linalg.norm(grid + affine[:3, 3] - place, axis=-1) < size
    tree = find_tree(field_from_mask(mask, affine), known.start[0] if rooted else None)
    (leak,) = [finding for finding in tree.findings if finding.code == "leak"]
    assert np.linalg.norm(np.array(leak.point) - place) < 4.0
    assert leak.severity == "warning"
