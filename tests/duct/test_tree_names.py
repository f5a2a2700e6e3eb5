"""Names of branches: from labels of an organ and from tables, which agree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bozzini.anatomy.regions import Regions, read_regions
from bozzini.duct import LumenTree, find_tree
from bozzini.duct.tree_names import name_by_regions, read_names
from bozzini.errors import FileFormatError, InputError
from bozzini.numeric.arrays import Floats

from .branching import grow


@pytest.fixture(scope="module")
def tree() -> LumenTree:
    return find_tree(grow(3).rasterise(1.0))


def label(tree: LumenTree, roots: dict[str, str], blur: float) -> tuple[Floats, np.ndarray]:
    """Voxels of 3 mm round a tree, each with the root nearest to it; where that is, uncertain."""
    points = np.concatenate([branch.points for branch in tree.branches])
    low, high = points.min(axis=0) - 15.0, points.max(axis=0) + 15.0
    axes = [np.arange(a, b, 3.0) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    jitter = np.random.default_rng(0).normal(0.0, blur, grid.shape)
    owner, _ = tree.nearest(grid + jitter)
    labels = np.zeros(owner.shape, dtype=np.uint16)
    for number, root in enumerate(roots, start=1):
        own = [each.name == root or each.name.startswith(f"{root}.") for each in tree.branches]
        labels[np.array(own)[owner]] = number
    affine = np.diag([3.0, 3.0, 3.0, 1.0])
    affine[:3, 3] = low
    return affine, labels


ROOTS = {"0.0": "right lung", "0.1.0": "LUL", "0.1.1": "LLL"}


@pytest.mark.parametrize("blur", [0.0, 3.0])
def test_a_region_names_the_root_of_the_branches_in_it(
    blur: float, tree: LumenTree, tmp_path: Path
) -> None:
    nibabel = pytest.importorskip("nibabel")
    affine, labels = label(tree, ROOTS, blur)
    file = tmp_path / "lobes.nii.gz"
    image = nibabel.Nifti1Image(labels, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, file)
    names = ", ".join(f'"{k}": "{name}"' for k, name in enumerate(ROOTS.values(), start=1))
    (tmp_path / "lobes.json").write_text(f"{{{names}}}")
    named = read_names(tree, file)
    assert {b.name: b.anatomy for b in named.branches if b.anatomy} == ROOTS
    assert named.findings == tree.findings
    assert named.find_branch("lul") == tree.find_branch("0.1.0")
    assert named.path("LLL").length == tree.path("0.1.1").length

    table = tmp_path / "names.csv"
    table.write_text("branch,name\n" + "".join(f"{k},{v}\n" for k, v in ROOTS.items()))
    middles = [tree.branches[tree.find_branch(k)] for k in ROOTS]
    places = [branch.points[len(branch.points) // 2] for branch in middles]
    rows = [
        f"{x:.3f},{y:.3f},{z:.3f},{name}\n"
        for (x, y, z), name in zip(places, ROOTS.values(), strict=True)
    ]
    by_place = tmp_path / "places.csv"
    by_place.write_text("x,y,z,name\n" + "".join(rows))
    for each in (table, by_place):
        other = read_names(tree, each)
        assert [b.anatomy for b in other.branches] == [b.anatomy for b in named.branches]


def test_a_region_without_a_branch_of_its_own_gives_no_name(tree: LumenTree) -> None:
    affine, labels = label(tree, {"0": ""}, 0.0)
    places = np.argwhere(labels > 0) * 3.0 + affine[:3, 3]
    chance = np.random.default_rng(0).random(len(places))
    named = name_by_regions(tree, Regions(("fog",), places, (chance < 0.4)[None]))
    assert not any(branch.anatomy for branch in named.branches)
    assert [item.code for item in named.findings] == ["unnamed"]
    most = name_by_regions(tree, Regions(("lung",), places, (chance < 0.9)[None]))
    assert [b.name for b in most.branches if b.anatomy] == ["0"]


def test_a_large_volume_is_thinned_evenly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nibabel = pytest.importorskip("nibabel")
    labels = np.zeros((20, 20, 20), dtype=np.uint8)
    labels[2:18, 2:18, 2:18] = 1
    labels[2:10, 2:18, 2:18] = 2
    file = tmp_path / "labels.nii"
    nibabel.save(nibabel.Nifti1Image(labels, np.eye(4)), file)
    whole = read_regions(file)
    monkeypatch.setattr("bozzini.anatomy.regions.MOST_VOXELS", 512)
    thin = read_regions(file)
    assert len(thin.places) == len(whole.places) // 8
    assert thin.inside.mean(axis=1) == pytest.approx(whole.inside.mean(axis=1))
    assert {*map(tuple, thin.places)} <= {*map(tuple, whole.places)}
    turned = read_regions(file, "LPS")
    assert turned.places * (-1.0, -1.0, 1.0) == pytest.approx(thin.places)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("branch,title\n0,a\n", "it must have branch,name or x,y,z,name"),
        ("branch,name\n0.9.9,a\n", "there is no branch '0.9.9'"),
        ("branch,name\n0.0,a\n0.0,b\n", "row 3 gives branch 0.0 the name 'b'"),
        ("branch,name\n0.0,a\n0.1,a\n", "row 3 gives branch 0.1 the name 'a'"),
        ("branch,name\n0.0,0.1\n", "other than those by path"),
        ("x,y,z,name\n1,2,q,a\n", "z"),
    ],
)
def test_wrong_tables_are_one_line(text: str, said: str, tree: LumenTree, tmp_path: Path) -> None:
    (tmp_path / "names.csv").write_text(text)
    with pytest.raises((FileFormatError, InputError), match=said) as told:
        read_names(tree, tmp_path / "names.csv")
    assert "\n" not in str(told.value)
