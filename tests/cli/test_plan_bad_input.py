"""``bozzini plan``: every input that it must refuse, in one clear line, leaving nothing."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from bozzini import motion
from bozzini.cli.plan import command
from tests.cli.plan_cases import SCOPE, Outcome, Run, Tracts, list_all, write_volume

NOTES = b"These are my notes.\n" * 20


@dataclass(frozen=True)
class Bad:
    """A command line that must be refused: how it is made, and words that the line must hold."""

    name: str
    make: Callable[[Tracts, Path], list[str | Path]]
    words: tuple[str, ...]
    findings: bool = False
    """Whether the file can be read, but with findings: they are told before the error."""


def put(content: bytes, name: str) -> Callable[[Tracts, Path], list[str | Path]]:
    def make(_: Tracts, folder: Path) -> list[str | Path]:
        (folder / name).write_bytes(content)
        return [folder / name]

    return make


def with_options(*options: str) -> Callable[[Tracts, Path], list[str | Path]]:
    return lambda tracts, _: [tracts.volume, *options]


def of_surface(*options: str) -> Callable[[Tracts, Path], list[str | Path]]:
    return lambda tracts, _: [tracts.surface, *options]


def with_mesh(change: Callable[[trimesh.Trimesh], trimesh.Trimesh]) -> Callable[..., Any]:
    def make(tracts: Tracts, folder: Path) -> list[str | Path]:
        change(tracts.mesh.copy()).export(folder / "changed.stl")
        return [folder / "changed.stl"]

    return make


def with_volume(
    change: Callable[[np.ndarray], np.ndarray], spacing: float | tuple[float, ...] = 1.5
) -> Callable[..., Any]:
    def make(tracts: Tracts, folder: Path) -> list[str | Path]:
        return [write_volume(folder / "changed.nii.gz", change(tracts.labels), spacing)]

    return make


def truncated(tracts: Tracts, folder: Path) -> list[str | Path]:
    content = tracts.volume.read_bytes()
    (folder / "cut.nii.gz").write_bytes(content[: len(content) // 2])
    return [folder / "cut.nii.gz"]


def truncated_inside(tracts: Tracts, folder: Path) -> list[str | Path]:
    """Whole as gzip, but with half of the voxels."""
    content = gzip.decompress(tracts.volume.read_bytes())
    (folder / "cut.nii.gz").write_bytes(gzip.compress(content[: len(content) // 2]))
    return [folder / "cut.nii.gz"]


def nan_vertices(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    vertices = mesh.vertices.copy()
    vertices[7, 1] = np.nan
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def flatten(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices * [1.0, 1.0, 0.0], mesh.faces, process=False)


def in_metres(tracts: Tracts, folder: Path) -> list[str | Path]:
    mesh = tracts.mesh.copy()
    mesh.apply_scale(1e-3)
    mesh.export(folder / "metres.ply")
    return [folder / "metres.ply"]


def in_kilometres(tracts: Tracts, folder: Path) -> list[str | Path]:
    tracts.mesh.copy().apply_scale(1e6).export(folder / "huge.stl")
    return [folder / "huge.stl"]


def open_end(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    keep = mesh.triangles_center[:, 2] > mesh.bounds[0, 2] + 10.0
    return trimesh.Trimesh(mesh.vertices, mesh.faces[keep], process=False)


BAD = [
    Bad("missing file", lambda _, folder: [folder / "none.stl"], ("none.stl", "no such file")),
    Bad("empty file", put(b"", "empty.nii.gz"), ("empty.nii.gz", "0 bytes")),
    Bad("empty surface", put(b"", "empty.stl"), ("empty.stl", "0 bytes")),
    Bad(
        "text named stl",
        put(NOTES, "notes.stl"),
        ("notes.stl", "is not STL triangles"),
    ),
    Bad("text named nii", put(NOTES, "notes.nii"), ("notes.nii", "NIfTI")),
    Bad("truncated gzip", truncated, ("cut.nii.gz",)),
    Bad("truncated voxels", truncated_inside, ("cut.nii.gz", "truncated")),
    Bad(
        "four dimensions",
        with_volume(lambda array: np.stack([array, array], axis=-1)),
        ("4 dimensions", "has 3"),
    ),
    Bad("no lumen", with_volume(np.zeros_like), ("empty", "0")),
    Bad(
        "an image",
        with_volume(lambda array: array.astype(np.int16) - 1000),
        ("-1000", "[0, 65535]"),
    ),
    Bad("label not there", with_options("--labels", "7"), ("label 7", "it has 1 (")),
    Bad(
        "several labels",
        lambda tracts, _: [tracts.halves],
        ("2 labels", "1 (", "mL", "--labels all"),
    ),
    Bad("label without a name", with_options("--labels", "one"), ("'one'", "no names")),
    Bad("label of background", with_options("--labels", "0"), ("--labels", "'0'", "[1, 65535]")),
    Bad("labels of a surface", of_surface("--labels", "1"), ("surface", "no labels")),
    Bad("not finite", with_mesh(nan_vertices), ("not finite", "NaN")),
    Bad("no volume", with_mesh(flatten), ("no volume", "flat")),
    Bad("a directory", lambda _, folder: [folder], ("known are", ".nii.gz", "DICOM")),
    Bad("unknown kind", put(b"x", "scan.xyz"), ("scan.xyz", ".nii.gz", ".stl")),
    Bad("shapes", put(b"shapes: []", "shapes.yaml"), ("shapes.yaml", "format", "kind")),
    Bad(
        "start outside",
        with_options("--start", "500mm,0,0"),
        ("start", "500", "outside the lumen", "inside it"),
    ),
    Bad("end outside", with_options("--end", "-500mm,0,0"), ("end", "-500", "outside the lumen")),
    Bad("start of two parts", with_options("--start", "1,2"), ("--start", "'1,2'", "give 3")),
    Bad("start of words", with_options("--start", "mouth"), ("start", "'mouth'", "names nothing")),
    Bad("start not finite", with_options("--start", "nan,0,0"), ("--start", "nan")),
    Bad("start label not there", with_options("--start", "9"), ("start", "9", "one of 1")),
    Bad("label end of a surface", of_surface("--end", "2"), ("end", "2", "surface", "point")),
    Bad(
        "negative diameter", with_options("--diameter", "-5mm"), ("diameter", "-5", "[0.1, 500] mm")
    ),
    Bad("no diameter", with_options("--diameter", "0mm"), ("diameter", "is 0", "[0.1, 500] mm")),
    Bad("endless diameter", with_options("--diameter", "inf"), ("--diameter", "inf")),
    Bad("unknown unit", with_options("--diameter", "5 elbows"), ("elbows", "5mm")),
    Bad("wrong kind of unit", with_options("--link", "5kg"), ("5kg", "unit", "5mm")),
    Bad("decimal comma", with_options("--link", "5,5mm"), ("--link", "5,5mm")),
    Bad("unknown unit of file", of_surface("--unit", "elbow"), ("elbow",)),
    Bad("weight as unit of file", of_surface("--unit", "kg"), ("kg", "length")),
    Bad("unit of a volume", with_options("--unit", "m"), ("'m'", "label volume")),
    Bad("no link", with_options("--link", "0"), ("link", "is 0", "[0.1, 10000] mm")),
    Bad("link too long", with_options("--link", "5m"), ("link", "5000", "at most", "mm")),
    Bad("scope too short", with_options("--length", "1mm"), ("length", "is 1", "[10")),
    Bad("negative inflation", with_options("--inflate", "-1mm"), ("inflation", "-1", "[0")),
    Bad("huge inflation", with_options("--inflate", "3m"), ("inflation", "3000", "30]")),
    Bad("much inflation", with_options("--inflate", "99mm"), ("inflation", "99", "[0, 30] mm")),
    Bad(
        "parsecs",
        with_options("--length", "5parsec"),
        ("--length", "unknown unit", "parsec", "5mm"),
    ),
    Bad("a scope of 1 km", with_options("--length", "1km"), ("scope length", "[10, 10000] mm")),
    Bad("a wide scope", with_options("--diameter", "1km"), ("scope diameter", "[0.1, 500] mm")),
    Bad("a long scope", with_options("--length", "1e9mm"), ("--length", "1e9mm", "1e+06] mm")),
    Bad("1e308 mm", with_options("--voxel", "1e308mm"), ("--voxel", "1e308mm", "1e+06] mm")),
    Bad("a thin scope", with_options("--diameter", "1nm"), ("scope diameter", "[0.1, 500] mm")),
    Bad("a short link", with_options("--link", "1nm"), ("link length", "[0.1, 10000] mm")),
    Bad("no voxel", with_options("--voxel", "0"), ("voxel", "is 0", "[0.01, inf)")),
    Bad("negative voxel", with_options("--voxel", "-1mm"), ("voxel", "is -1", "[0.01, inf)")),
    Bad("tiny voxel", with_options("--voxel", "1um"), ("voxel", "0.001", "[0.01, inf)")),
    Bad("huge voxel", with_options("--voxel", "1m"), ("1000", "smaller --voxel")),
    Bad("huge voxel of a surface", of_surface("--voxel", "1m"), ("1000", "smaller --voxel")),
    Bad("no head step", with_options("--head-step", "0"), ("head step", "is 0", "[0.001, 10000]")),
    Bad("long head step", with_options("--head-step", "1m"), ("head step", "1000", "10]")),
    Bad("unknown method", with_options("--method", "magic"), ("'magic'", "thesis")),
    Bad("unknown option", with_options("--magic"), ("--magic", "--help")),
    Bad("no input", lambda *_: [], ("INPUT", "--help")),
    Bad(
        "one voxel",
        with_volume(lambda array: one_voxel(array)),
        ("no tube was found", "--start and --end", "implausibly small"),
        findings=True,
    ),
    Bad(
        "a ball",
        with_volume(lambda array: ball(), spacing=2.0),
        ("no tube was found", "--start and --end"),
    ),
    Bad("metres taken for mm", in_metres, ("implausibly small", "1 to 10000", "--unit m")),
    Bad("kilometres", in_kilometres, ("longest side is", "1 to 10000 mm")),
    Bad(
        "thin voxels",
        with_volume(lambda array: np.minimum(array, 1), spacing=(2.0, 2.0, 0.001)),
        ("2 x 2 x 0.001 mm", "at most 100"),
    ),
]


def ball() -> np.ndarray:
    axis = np.arange(-14.0, 15.0)
    squares = axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2
    return np.asarray(squares < 11.0**2, dtype=np.uint8)


def one_voxel(array: np.ndarray) -> np.ndarray:
    changed = np.zeros_like(array)
    changed[10, 10, 10] = 1
    return changed


def check_refusal(
    outcome: Outcome, words: tuple[str, ...], *, as_json: bool, findings: bool = False
) -> None:
    assert outcome.code == 2, outcome
    *told, line = outcome.err.splitlines(keepends=True)
    assert bool(told) == findings, outcome.err
    assert all(item.startswith(("bozzini: note: ", "bozzini: warning: ")) for item in told), told
    assert line.startswith("bozzini: error: ") and line.endswith("\n"), outcome.err
    assert "Traceback" not in outcome.err
    for word in words:
        assert word in line, outcome.err
    if as_json:
        assert f"bozzini: error: {outcome.result['error']['message']}\n" == line
        assert set(outcome.result) == {"error"}
    else:
        assert outcome.out == ""


@pytest.mark.parametrize(
    "option",
    [
        "--inflate=99mm",
        "--method=magic",
        "--head-step=0mm",
        "--slip=7",
        "--label-error=-1mm",
        "--voxel=1e-6mm",
        "--diameter=1nm",
    ],
)
def test_an_option_is_refused_before_the_file_is_read(
    run: Run, tmp_path: Path, option: str
) -> None:
    # There is no such file: what is refused first is what is looked at first.
    outcome = run(tmp_path / "none.nii.gz", option, "--quiet", "--out", tmp_path / "plan")
    assert outcome.code == 2 and "none.nii.gz" not in outcome.err
    assert option.partition("=")[0].strip("-").replace("-", " ")[:4] in outcome.err.lower()
    assert list_all(tmp_path) == set()


def test_the_command_line_knows_every_planner() -> None:
    (method,) = (option for option in command.params if option.name == "method")
    assert tuple(method.type.choices) == tuple(motion.PLANNERS)


@pytest.mark.parametrize("as_json", [False, True], ids=["", "json"])
@pytest.mark.parametrize("bad", BAD, ids=[bad.name for bad in BAD])
def test_bad_input_is_one_clear_line_and_leaves_nothing(
    tracts: Tracts, run: Run, tmp_path: Path, bad: Bad, as_json: bool
) -> None:
    source, place = tmp_path / "source", tmp_path / "results"
    source.mkdir()
    place.mkdir()
    arguments = bad.make(tracts, source)
    before = list_all(tmp_path)
    # Quiet: on a loaded machine a line of progress could come between.
    outcome = run(*arguments, "--quiet", *["--json"] * as_json, "--out", place / "plan")
    check_refusal(outcome, bad.words, as_json=as_json, findings=bad.findings)
    assert list_all(tmp_path) == before


@pytest.mark.slow
def test_an_open_surface_is_capped_and_that_is_reported(
    tracts: Tracts, run: Run, tmp_path: Path
) -> None:
    arguments = with_mesh(open_end)(tracts, tmp_path)
    outcome = run(*arguments, "--quiet", "--organ=colon", "--out", tmp_path / "plan")
    assert outcome.code == 0
    assert "open" in outcome.err and "capped" in outcome.err


@pytest.mark.parametrize("as_json", [False, True], ids=["", "json"])
def test_a_directory_that_exists_is_not_touched(
    tracts: Tracts, run: Run, tmp_path: Path, as_json: bool
) -> None:
    (tmp_path / "plan").mkdir()
    (tmp_path / "plan" / "mine.txt").write_text("mine")
    outcome = run(
        tracts.volume, *SCOPE, "--quiet", *["--json"] * as_json, "--out", tmp_path / "plan"
    )
    check_refusal(outcome, (str(tmp_path / "plan"), "exists already", "--force"), as_json=as_json)
    assert list_all(tmp_path) == {"plan", "plan/mine.txt"}


@pytest.mark.parametrize("place", ["file", "file/plan", "file/a/b", "x" * 300])
@pytest.mark.parametrize("force", [False, True])
def test_an_output_that_cannot_be_written_is_said_before_any_work(
    tracts: Tracts, run: Run, tmp_path: Path, place: str, force: bool
) -> None:
    (tmp_path / "file").write_text("mine")
    # The input is missing too: the output is looked at first, before minutes of work.
    outcome = run(tmp_path / "none.stl", *["--force"] * force, "--out", f"{tmp_path}/{place}")
    check_refusal(outcome, (), as_json=False)
    assert "none.stl" not in outcome.err
    assert list_all(tmp_path) == {"file"}
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def test_an_output_that_becomes_unwritable_meanwhile_leaves_nothing(
    tracts: Tracts, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    options = ["--organ=colon", "--quiet", "--json", "--out", tmp_path / "plan"]
    outcome = run(tracts.volume, *SCOPE, *options)
    check_refusal(outcome, ("plan.npz", "No space left"), as_json=True)
    assert list_all(tmp_path) == set()
