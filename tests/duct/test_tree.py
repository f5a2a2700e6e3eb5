"""The tree of a lumen, against random trees of which all is known, and the tree of an airway."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bozzini.anatomy import read_tract
from bozzini.duct import LumenTree, build_field, field_from_mask, find_tree
from bozzini.errors import GeometryError, InputError

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


def test_a_ball_is_no_tree() -> None:
    away = np.linalg.norm(np.mgrid[-9:10, -9:10, -9:10], axis=0)
    with pytest.raises(GeometryError, match="no tube"):
        find_tree(field_from_mask(away < 6.0, np.eye(4)))


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
