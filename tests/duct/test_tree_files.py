"""Trees of other tools: lines that overlap or touch, in every form that VTK and Slicer write."""

from __future__ import annotations

import base64
import itertools
import json
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bozzini.duct import LumenTree, find_tree
from bozzini.duct.tree_files import read_tree, write_curves, write_swc, write_vtp
from bozzini.errors import FileFormatError, InputError
from bozzini.numeric.arrays import Floats

from .branching import grow


@pytest.fixture(scope="module")
def tree() -> LumenTree:
    return find_tree(grow(3).rasterise(1.0))


def make_paths(tree: LumenTree, noise: float = 0.0) -> tuple[list[Floats], list[Floats]]:
    """Lines as VMTK makes them: from each end back to the root, all along the trunk."""
    rng = np.random.default_rng(1)
    lines, radii = [], []
    for end in tree.ends:
        route = [tree.branches[k] for k in tree.list_route(end)]
        points = np.concatenate([route[0].points[:1], *(part.points[1:] for part in route)])
        radius = np.concatenate([route[0].radius[:1], *(part.radius[1:] for part in route)])
        points = points + noise * rng.uniform(-1.0, 1.0, points.shape)
        lines.append(points[::-1])
        radii.append(radius[::-1])
    return lines, radii


def compare(again: LumenTree, tree: LumenTree, within: float) -> None:
    assert list(again.names) == list(tree.names)
    for one, other in zip(again.branches, tree.branches, strict=True):
        assert one.points == pytest.approx(other.points, abs=within)
        assert one.radius[1:] == pytest.approx(other.radius[1:], abs=within)
        assert (one.parent, one.is_end) == (other.parent, other.is_end)


@pytest.mark.parametrize("write", [write_swc, write_vtp, write_curves])
@pytest.mark.parametrize("seed", range(4))
def test_a_tree_comes_back_from_a_file(
    seed: int, write: Callable[[LumenTree, Path], None], tmp_path: Path
) -> None:
    known = find_tree(grow(seed).rasterise(1.0))
    ending = {write_swc: "swc", write_vtp: "vtp", write_curves: "mrk.json"}[write]
    write(known, tmp_path / f"tree.{ending}")
    compare(read_tree(tmp_path / f"tree.{ending}"), known, 1e-3)


Writer = Callable[[Path, list[Floats], list[Floats], str], None]


def write_legacy(path: Path, lines: list[Floats], radii: list[Floats], name: str) -> None:
    _write_legacy(path, lines, radii, name, binary=False)


def write_legacy_binary(path: Path, lines: list[Floats], radii: list[Floats], name: str) -> None:
    _write_legacy(path, lines, radii, name, binary=True)


def _write_legacy(
    path: Path, lines: list[Floats], radii: list[Floats], name: str, *, binary: bool
) -> None:
    def show(values: Floats, kind: str) -> bytes:
        if binary:
            return np.asarray(values).astype(f">{kind}").tobytes() + b"\n"
        return " ".join(f"{value:.9g}" for value in np.ravel(values)).encode() + b"\n"

    points, ends = np.concatenate(lines), np.cumsum([0] + [len(line) for line in lines])
    cells = np.concatenate([[b - a, *range(a, b)] for a, b in itertools.pairwise(ends)])
    path.write_bytes(
        b"# vtk DataFile Version 4.2\nvtk output\n"
        + (b"BINARY" if binary else b"ASCII")
        + b"\nDATASET POLYDATA\n"
        + f"POINTS {len(points)} float\n".encode() + show(points, "f4")
        + f"LINES {len(lines)} {len(cells)}\n".encode() + show(cells, "i4")
        + f"CELL_DATA {len(lines)}\nFIELD FieldData 1\nGroupIds 1 {len(lines)} int\n".encode()
        + show(np.arange(len(lines)), "i4")
        + f"POINT_DATA {len(points)}\nFIELD FieldData 2\n".encode()
        + f"EdgeArray 2 {len(points)} double\n".encode() + show(np.zeros(2 * len(points)), "f8")
        + b"METADATA\nINFORMATION 0\n\n"
        + f"{name.replace(' ', '%20')} 1 {len(points)} double\n".encode()
        + show(np.concatenate(radii), "f8")
    )  # fmt: skip


def _write_xml(
    path: Path, lines: list[Floats], radii: list[Floats], name: str, *, how: str
) -> None:
    """As vtkXMLPolyDataWriter does: packed by zlib, or plain; in base64, or appended raw."""
    appended = b""

    def pack(values: Floats, kind: str) -> str:
        nonlocal appended
        raw = np.asarray(values).astype(kind).tobytes()
        if how == "base64":
            text = base64.b64encode(np.array([len(raw)], "<u4").tobytes() + raw).decode()
            return f'format="binary">{text}'
        blocks = [raw[k : k + 32768] for k in range(0, len(raw), 32768)]
        packed = [zlib.compress(block) for block in blocks]
        sizes = [len(blocks), 32768, len(raw) % 32768, *map(len, packed)]
        head = np.array(sizes, "<u4").tobytes()
        if how == "zlib":
            text = base64.b64encode(head).decode() + base64.b64encode(b"".join(packed)).decode()
            return f'format="binary">{text}'
        offset = len(appended)
        appended += head + b"".join(packed)
        return f'format="appended" offset="{offset}">'

    points, ends = np.concatenate(lines), np.cumsum([len(line) for line in lines])
    body = (
        '<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian" header_type="UInt32" '
        + ("" if how == "base64" else 'compressor="vtkZLibDataCompressor"')
        + f'><PolyData><Piece NumberOfPoints="{len(points)}" NumberOfVerts="0" '
        f'NumberOfLines="{len(lines)}" NumberOfStrips="0" NumberOfPolys="0"><PointData>'
        f'<DataArray type="Float64" Name="{name}" '
        + pack(np.concatenate(radii), "<f8")
        + '</DataArray></PointData><Points><DataArray type="Float32" NumberOfComponents="3" '
        + pack(points, "<f4")
        + '</DataArray></Points><Lines><DataArray type="Int64" Name="connectivity" '
        + pack(np.arange(len(points)), "<i8")
        + '</DataArray><DataArray type="Int64" Name="offsets" '
        + pack(ends, "<i8")
        + "</DataArray></Lines></Piece></PolyData>"
    ).encode()
    if how == "appended":
        body += b'<AppendedData encoding="raw">_' + appended + b"</AppendedData>"
    path.write_bytes(body + b"</VTKFile>")


@pytest.mark.parametrize("form", ["ascii", "binary", "base64", "zlib", "appended"])
def test_lines_from_every_outlet_are_one_tree(form: str, tree: LumenTree, tmp_path: Path) -> None:
    """Where points coincide the tree is the same; every form of the file has the same."""
    lines, radii = make_paths(tree)
    name = "MaximumInscribedSphereRadius"
    path = tmp_path / ("tree.vtk" if form in ("ascii", "binary") else "tree.vtp")
    if form in ("ascii", "binary"):
        _write_legacy(path, lines, radii, name, binary=form == "binary")
    else:
        _write_xml(path, lines, radii, name, how=form)
    compare(read_tree(path), tree, 1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_lines_that_only_nearly_coincide_are_one_tree(seed: int, tmp_path: Path) -> None:
    known = find_tree(grow(seed).rasterise(1.0))
    lines, radii = make_paths(known, noise=0.1)
    _write_xml(tmp_path / "tree.vtp", lines, radii, "Radius", how="zlib")
    again = read_tree(tmp_path / "tree.vtp")
    assert len(again.branches) == len(known.branches)
    assert len(again.ends) == len(known.ends)
    assert again.length == pytest.approx(known.length, rel=0.1)
    for end in again.ends:
        _, gap = known.nearest(end.points[-1])
        assert gap < 0.3


def test_a_root_that_is_given_is_taken(tree: LumenTree, tmp_path: Path) -> None:
    path = tmp_path / "tree.swc"
    write_swc(tree, path)
    tip = tree.ends[0].points[-1]
    turned = read_tree(path, root=tip)
    assert turned.branches[0].points[0] == pytest.approx(tip, abs=1e-5)
    assert turned.length == pytest.approx(tree.length)
    assert len(turned.ends) == len(tree.ends)
    inside = tree.branches[0].points[len(tree.branches[0].points) // 2]
    both = read_tree(path, root=inside)
    assert sum(branch.parent < 0 for branch in both.branches) == 2
    write_swc(both, path)
    compare(read_tree(path), both, 1e-5)
    with pytest.raises(InputError, match="start is .* mm from the tree"):
        read_tree(path, root=(500.0, 0.0, 0.0))


def test_slicers_frame_is_kept(tree: LumenTree, tmp_path: Path) -> None:
    write_curves(tree, tmp_path / "tree.mrk.json")
    curves = json.loads((tmp_path / "tree.mrk.json").read_text())["markups"]
    assert [curve["name"] for curve in curves] == list(tree.names)
    turned = read_tree(tmp_path / "tree.mrk.json", frame="LPS")
    for one, other in zip(turned.branches[:1], tree.branches[:1], strict=True):
        assert one.points * (-1.0, -1.0, 1.0) == pytest.approx(other.points, abs=1e-3)


def test_what_is_no_tree_of_lines_is_refused(tree: LumenTree, tmp_path: Path) -> None:
    path = tmp_path / "tree.vtp"
    lines, radii = make_paths(tree)
    for write, said in (
        (lambda: _write_xml(path, lines, radii, "Thickness", how="zlib"), "they have Thickness"),
        (lambda: _write_xml(path, lines, [-r for r in radii], "Radius", how="zlib"), "above 0"),
        (lambda: _write_xml(path, [1e20 * lines[0]], radii[:1], "Radius", how="zlib"), "too far"),
        (
            lambda: _write_xml(path, [lines[0], lines[1] + 90.0], radii[:2], "Radius", how="zlib"),
            "2 parts",
        ),
        (lambda: path.write_bytes(path.read_bytes()[:-300]), "damaged|not a VTP"),
    ):
        write()
        with pytest.raises(FileFormatError, match=said):
            read_tree(path)
    same = [np.ones((4, 3))]
    _write_xml(path, same, [np.ones(4)], "Radius", how="zlib")
    with pytest.raises(FileFormatError, match="the root must have a node after it"):
        read_tree(path)
    _write_legacy(tmp_path / "t.vtk", lines, radii, "Radius", binary=False)
    text = (tmp_path / "t.vtk").read_text()
    (tmp_path / "t.vtk").write_text(text[: text.index("LINES")])
    with pytest.raises(FileFormatError, match="has no lines"):
        read_tree(tmp_path / "t.vtk")
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.stack([20.0 * np.cos(turn), 20.0 * np.sin(turn), 0.0 * turn], axis=1)
    _write_xml(path, [ring[:40], ring[30:]], [np.ones(40), np.ones(30)], "Radius", how="zlib")
    with pytest.raises(FileFormatError, match="loop"):
        read_tree(path)
