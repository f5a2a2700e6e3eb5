"""Refusals of every function of the anatomy: one clear line with the field and what is legal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import trimesh

from bozzini.anatomy import (
    Finding,
    LabelTract,
    Phantom,
    PublicData,
    SurfaceTract,
    fetch_data,
    make_phantom,
    read_labels,
    read_surface,
    read_tract,
    read_volume,
    segment_gas,
    tract_from_labels,
    tract_from_surface,
    write_tract,
)
from bozzini.anatomy.frame import find_axis
from bozzini.anatomy.labels import Volume
from bozzini.anatomy.phantom import Dimension
from bozzini.errors import (
    BozziniError,
    FileFormatError,
    GeometryError,
    InputError,
    OutputError,
    UnitError,
)

PHANTOM = make_phantom()
TETRAHEDRON = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 5]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
SQUARE = np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]], dtype=float)
SHEAR = np.array([[1, 0.01, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
ORGANS = {1: "stomach", 2: "esophagus", 3: "liver"}
CT = np.full((20, 20, 20), -1000.0)
CT[2:-2, 2:-2, 2:-2] = 40.0


def block(fill: int = 3, border: int = 2) -> np.ndarray:
    return np.pad(np.full((4, 5, 6), fill, dtype=np.uint16), border)


def tube(second: int = 1) -> np.ndarray:
    """Return a tube of label 1, and from its middle on of another."""
    array = np.zeros((12, 13, 40), dtype=np.uint8)
    array[4:8, 5:9, 3:20] = 1
    array[4:8, 5:9, 20:35] = second
    return array


def box(x: float = 0.0) -> trimesh.Trimesh:
    mesh = trimesh.creation.box((20.0, 20.0, 20.0))
    mesh.apply_translation((x, 0.0, 0.0))
    return mesh


def ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def labels(array: Any, affine: Any = None, **options: Any) -> object:
    return tract_from_labels(array, np.eye(4) if affine is None else affine, **options)


def scale(*size: float) -> np.ndarray:
    return np.diag([*size, 1.0])


def label_tract(array: Any, affine: Any = None) -> object:
    return LabelTract(labels=array, affine=np.eye(4) if affine is None else affine, source="test")


def surface_tract(faces: Any) -> object:
    return SurfaceTract(vertices=TETRAHEDRON, faces=faces, source="test")


def phantom(**changes: Any) -> object:
    values = {"centreline": np.zeros((3, 3)), "radii": np.ones(3), "region": np.ones(3, np.uint8)}
    return Phantom(**(values | {"seed": 0, "dimensions": {}} | changes))


def entry(**changes: Any) -> PublicData:
    values = {
        "name": "test", "what": "A tract", "licence": "CC0", "citation": "Nobody, 2026",
        "url": "https://somewhere/x", "file_name": "tract.stl",
    }  # fmt: skip
    return PublicData(**(values | changes))


def gas(array: Any, **options: Any) -> object:
    return segment_gas(Volume(array=np.asarray(array), affine=np.eye(4), source="ct"), **options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with files of each kind."""
    folder = tmp_path_factory.mktemp("files")
    noise = np.random.default_rng(0).integers(-1000, 1000, (8, 8, 8)).astype(np.int16)
    series = np.stack([tube(), tube()], axis=-1)
    for name, array in (
        ("one.nii", tube()), ("three.nii.gz", tube(3)), ("ct.nii", noise), ("two.nii", series)
    ):  # fmt: skip
        nibabel.save(nibabel.Nifti1Image(array, np.eye(4)), folder / name)
    (folder / "masks").mkdir()
    for name, value in (("colon", 1), ("liver", 3)):
        mask = (tube(3) == value).astype(np.uint8)
        nibabel.save(nibabel.Nifti1Image(mask, np.eye(4)), folder / "masks" / f"{name}.nii")
    names = "".join(f'<Label Key="{key}">{name}</Label>' for key, name in ORGANS.items())
    image = nibabel.Nifti1Image(tube(3), np.eye(4))
    table = f"<LabelTable>{names}</LabelTable>".encode()
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, table))
    nibabel.save(image, folder / "named.nii")
    box().export(folder / "box.stl")
    trimesh.util.concatenate([box(), box(50.0)]).export(folder / "boxes.stl")
    trimesh.Trimesh(TETRAHEDRON[:3], [[0, 1, 2], [0, 2, 1]], process=False).export(
        folder / "flat.stl"
    )
    scene = trimesh.Scene({"colon": box(), "liver": box(90.0)})
    scene.apply_scale(1e-3)
    scene.export(folder / "scene.glb")
    box().export(folder / "mm.glb")
    (folder / "nan.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 9 0\nf 1 2 3\n")
    (folder / "empty").mkdir()
    (folder / "file").touch()
    return folder


# fmt: off
REFUSALS: list[tuple[Callable[[Path], object], type[BozziniError], str, str]] = [
    # Findings, and the two forms of a tract
    (lambda _: Finding("x", "error", "no"),
     InputError, "severity is 'error'", "one of note, warning"),
    (lambda _: label_tract(block().astype(int)), InputError, "labels are int64", "uint16"),
    (lambda _: label_tract(block()[0]), InputError, "labels are uint16", "3 dimensions"),
    (lambda _: label_tract(block(fill=0)), GeometryError, "the label volume has no lumen", "0"),
    (lambda _: label_tract(block(border=1)), GeometryError, "the lumen is closer", "two voxels"),
    (lambda _: label_tract(block(), np.eye(3)), InputError, "affine has shape (3, 3)", "4)"),
    (lambda _: label_tract(block(), np.full((4, 4), np.nan)),
     InputError, "affine has 4 point(s)", "not finite"),
    (lambda _: surface_tract(FACES + 1),
     InputError, "faces of test point at vertices 1 to 4", "[0, 3]"),
    (lambda _: surface_tract(FACES.astype(float)),
     InputError, "faces of test are float64", "integers"),
    (lambda _: surface_tract(FACES[:0]), InputError, "test has no faces", ""),
    (lambda _: surface_tract(FACES[:, :2]),
     InputError, "faces of test are int64", "(m, 3)"),
    # Frames
    *((lambda _, code=code: find_axis(code, "S"), InputError, f"frame is '{code}'", "three letters")
      for code in ("RAR", "xyz", "", "RA")),
    (lambda _: find_axis("RAS", "X"), InputError, "side is 'X'", "one of R, L, A, P, S, I"),
    # Labels
    (lambda _: labels(tube(), labels=[]), InputError, "no labels were given", "at least one"),
    *((lambda _, value=value: labels(tube(), labels=[value]),
       InputError, f"label is {value}", "[1, 65535]") for value in (0, -1, 70000, 1.5, True)),
    (lambda _: labels(tube(6), labels=[1, 4], source="scan"),
     InputError, "scan has no voxel of label 4", "it has 1 (0.272 mL), 6 "),
    (lambda _: labels(tube(2), labels=None, names=ORGANS),
     InputError, "array has 2 labels", "1 stomach (0.272 mL), 2 esophagus (0.24 mL)"),
    (lambda _: labels(tube(), scale(0.01, 0.01, 0.01)),
     GeometryError, "the tract is implausibly small", "it must be 1 to 10000 mm"),
    (lambda _: labels(tube(), scale(1e5, 1e5, 1e5)),
     GeometryError, "the tract is implausibly large", "it must be 1 to 10000 mm"),
    (lambda _: labels(tube(), scale(2, 2, 0.001)),
     GeometryError, "voxels of 2 x 2 x 0.001 mm", "at most 100 times"),
    (lambda _: labels(np.ones((4, 4, 4, 2))),
     InputError, "array has 4 dimensions, shape (4, 4, 4, 2)", "has 3"),
    (lambda _: labels(np.ones((4, 4))), InputError, "array has 2 dimensions", "has 3"),
    (lambda _: labels(np.full((4, 4, 4), 1.5)),
     InputError, "array has the voxel value 1.5", "whole numbers"),
    (lambda _: labels(np.full((4, 4, 4), np.nan)),
     InputError, "array has voxels that are not finite", "whole numbers"),
    (lambda _: labels(np.full((4, 4, 4), -1000)),
     InputError, "array has voxel values from -1000", "[0, 65535]"),
    (lambda _: labels(np.full((4, 4, 4), "a")), InputError, "array holds <U1", "whole numbers"),
    (lambda _: labels(np.ones((0, 4, 4))), InputError, "array has shape (0, 4, 4)", "no voxels"),
    (lambda _: labels(np.zeros((4, 4, 4))), GeometryError, "array is empty", "every voxel is 0"),
    (lambda _: labels(tube(), SHEAR),
     InputError, "the affine of array is sheared", "at most 0.001"),
    (lambda _: labels(tube(), scale(1.0, 0.0, 1.0)),
     InputError, "the affine of array is singular", "must be above 0"),
    (lambda _: labels(tube(), [[1, 1, 0, 0], [0, 1e-9, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]),
     InputError, "the affine of array is singular", "lie in a plane"),
    (lambda _: labels(tube(), scale(1.0, 1.0, np.inf)),
     InputError, "the affine of array has 1 point(s)", "not finite"),
    (lambda _: labels(tube(), 2.0 * np.eye(4)),
     InputError, "the affine of array is not a 4 x 4 matrix", "last row 0 0 0 1"),
    # Label files
    (lambda _: read_tract(None), InputError, "path is None", "the path of a file"),
    (lambda f: read_tract(f / "three.nii.gz"),
     InputError, "three.nii.gz has 2 labels", "1 (0.272 mL), 3 (0.24 mL)"),
    (lambda f: read_tract(f / "three.nii.gz", labels=["colon"]),
     InputError, "label is 'colon'", "totalsegmentator-v1:colon"),
    (lambda f: read_tract(f / "three.nii.gz", labels=["totalsegmentator-v2:colon"]),
     InputError, "three.nii.gz has no voxel of label 20", "it has 1 "),
    (lambda f: read_tract(f / "three.nii.gz", labels=["totalsegmentator-v3:colon"]),
     InputError, "label is 'totalsegmentator-v3:colon'", "known are totalsegmentator-v1"),
    (lambda f: read_tract(f / "named.nii", labels=["colon"]),
     InputError, "named.nii has no label named 'colon'", "it has stomach, liver"),
    (lambda f: read_tract(f / "one.nii", frame="RAR"), InputError, "frame is 'RAR'", "LPS"),
    (lambda f: read_tract(f / "one.nii", unit="m"), InputError, "unit is 'm'", "leave it out"),
    (lambda f: read_tract(f / "one.nii", part="1"),
     InputError, "one.nii is a label volume", "no parts"),
    (lambda f: read_labels(f / "two.nii"),
     FileFormatError, "two.nii has 4 dimensions, shape (12, 13, 40, 2)", "has 3"),
    (lambda f: read_tract(f / "ct.nii"), InputError, "ct.nii has voxel values from", "[0, 65535]"),
    (lambda f: read_tract(f / "masks"), InputError, "masks has 2 masks", "colon (0.272 mL)"),
    (lambda f: read_tract(f / "masks", labels=["rectum"]),
     InputError, "masks has no mask named 'rectum'", "it has colon, liver"),
    (lambda f: read_tract(f / "masks", labels=[]), InputError, "no labels were given", "'all'"),
    (lambda f: read_volume(f / "empty"), FileFormatError, "empty is a folder", "a DICOM series"),
    # Surfaces
    (lambda _: tract_from_surface([[0, 0, np.nan], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]]),
     InputError, "array has 2 vertices", "not finite"),
    (lambda _: tract_from_surface(np.zeros((3, 2)), [[0, 1, 2]]),
     InputError, "vertices of array have shape (3, 2)", "(n, 3)"),
    (lambda _: tract_from_surface(np.full((3, 3), 1e38), [[0, 1, 2]]),
     InputError, "array has a coordinate of 1e+38 mm", "within 1e+09 mm"),
    (lambda _: tract_from_surface(np.zeros((3, 3)), [[0, 1, 3]]),
     InputError, "faces of array point at vertices 0 to 3", "[0, 2]"),
    (lambda _: tract_from_surface(np.zeros((3, 3)), [[0.0, 1.0, 2.0]]),
     InputError, "faces of array are float64", "integers (m, 3)"),
    (lambda _: tract_from_surface(np.zeros((3, 3)), np.zeros((0, 3), int)),
     InputError, "array has no faces", ""),
    (lambda _: tract_from_surface(*ball(0.02)),
     GeometryError, "the tract is implausibly small", "1 to 10000 mm; give the file's own unit"),
    (lambda _: tract_from_surface(*ball(20_000.0)),
     GeometryError, "the tract is implausibly large", "1 to 10000 mm; give the file's own unit"),
    (lambda _: tract_from_surface(SQUARE, [(0, 1, 2), (0, 2, 3), (0, 2, 1), (0, 3, 2)]),
     GeometryError, "array encloses no volume", "it is flat"),
    (lambda _: tract_from_surface(SQUARE, [(0, 0, 2), (1, 1, 1)]),
     GeometryError, "array encloses no volume", "all its triangles are flat"),
    # Surface files
    *((lambda f, unit=unit: read_surface(f / "box.stl", unit=unit), UnitError, "", "length")
      for unit in ("parsec/s", "lightfoot", "", "N", "nan", "0m", "e3mm", "*5 mm", "mm\nm")),
    (lambda f: read_tract(f / "box.stl", labels=[1]),
     InputError, "box.stl is a surface", "no labels"),
    (lambda f: read_tract(f / "flat.stl"), GeometryError, "flat.stl encloses no volume", "flat"),
    (lambda f: read_tract(f / "nan.obj"), InputError, "nan.obj has 1 vertex", "not finite"),
    (lambda f: read_surface(f / "boxes.stl", part=3),
     InputError, "boxes.stl has no part '3'", "'2'"),
    (lambda f: read_surface(f / "boxes.stl", part=[]),
     InputError, "no part was given", "'1' (8 mL)"),
    (lambda f: read_surface(f / "scene.glb"),
     InputError, "scene.glb has 2 parts that do not all touch", "'liver' (8 mL)"),
    (lambda f: read_surface(f / "scene.glb", part="lung"),
     InputError, "scene.glb has no part 'lung'", "it has 'colon' (8 mL), 'liver' (8 mL)"),
    (lambda f: read_surface(f / "mm.glb"),
     GeometryError, "the tract is implausibly large", "1 to 10000 mm; give --unit mm"),
    # Writing
    (lambda f: write_tract(f / "new.stl", PHANTOM.to_labels(4.0)),
     InputError, "new.stl holds a surface tract", "labels"),
    (lambda f: write_tract(f / "new.nii", PHANTOM.to_surface(4.0)),
     InputError, "new.nii holds a labels tract", "surface"),
    (lambda f: write_tract(f / "new.step", PHANTOM.to_surface(4.0)),
     InputError, "new.step: cannot tell what to write", ".stl, .ply, .obj, .glb, .nii, .nii.gz"),
    (lambda f: write_tract(f / "box.stl", PHANTOM.to_surface(4.0)),
     OutputError, "box.stl exists already", "--force"),
    (lambda f: write_tract(f / "nowhere" / "new.stl", PHANTOM.to_surface(4.0)),
     OutputError, "cannot write nowhere/new.stl", "not a directory"),
    # The phantom
    *((lambda _, seed=seed: make_phantom(seed=seed), InputError, f"seed is {seed}", "[0, inf]")
      for seed in (-1, 1.5, True)),
    *((lambda _, size=size: PHANTOM.to_labels(size),
      InputError, f"voxel is {size:g}", "[0.5, 4] mm")
      for size in (0.1, 9.0, -1.0, float("nan"))),
    *((lambda _, size=size: PHANTOM.to_surface(size),
       InputError, f"spacing is {size:g}", "[0.5, 4] mm") for size in (0.1, 9.0, float("nan"))),
    (lambda _: PHANTOM.signed_distance([0.0, np.nan, 0.0]),
     InputError, "points has 1", "not finite"),
    (lambda _: phantom(centreline=np.zeros((1, 3))), InputError, "centreline has shape", "n >= 2"),
    (lambda _: phantom(radii=np.ones(2)), InputError, "radii (2,)", "one value for each of the 3"),
    (lambda _: phantom(radii=np.zeros(3)), InputError, "the least radius is 0 mm", "above 0"),
    (lambda _: Dimension(name="x", unit="mm", value=3.0, low=1.0, high=2.0, basis="none"),
     InputError, "x is 3", "[1, 2]"),
    # Gas in a CT
    (lambda _: gas(CT * 0 + 1), InputError, "ct has values from 1 to 1", "air (-1000)"),
    (lambda _: gas(np.maximum(CT, 0)), InputError, "ct has values from 0 to 40", "CT in HU"),
    (lambda _: gas(CT), GeometryError, "ct has no gas below -800 HU", "inside the body"),
    (lambda _: gas(CT[..., None] * np.ones(2)),
     InputError, "ct is not a CT image", "(20, 20, 20, 2)"),
    (lambda _: gas(CT, threshold=100.0), InputError, "threshold is 100 HU", "[-1000, -400] HU"),
    (lambda _: gas(CT, smallest=-1.0), InputError, "smallest volume is -1 mm^3", "[0, inf)"),
    # Public data
    (lambda _: entry(sha256="12"), InputError, "sha256 is '12'", "64 hexadecimal digits"),
    (lambda _: entry(sha256="X" * 64), InputError, "sha256 is 'X", "64 hexadecimal digits"),
    (lambda _: entry(licence=""), InputError, "a catalogue entry needs a licence", "empty"),
    (lambda _: entry(file_name="../x"), InputError, "file name is '../x'", "a plain name"),
    (lambda f: fetch_data(entry(url="ftp://somewhere/x"), f),
     InputError, "the address of test is 'ftp://somewhere/x'", "http or file"),
    (lambda f: fetch_data("nothing", f),
     InputError, "there is no data set 'nothing'", "gca-stomach"),
    (lambda f: fetch_data(entry(), f / "file"), OutputError, "cannot write to file", "File exists"),
    (lambda f: fetch_data(entry(), f / "a" / "b"), OutputError, "cannot write to a/b", "No such"),
]
# fmt: on
"""What is asked, the error, the field that the message names, and what it states as legal."""


@pytest.mark.parametrize(("call", "error", "field", "legal"), REFUSALS)
def test_refused(
    folder: Path,
    call: Callable[[Path], object],
    error: type[BozziniError],
    field: str,
    legal: str,
) -> None:
    before = sorted(folder.iterdir())
    with pytest.raises(error) as caught:
        call(folder)
    line = str(caught.value).replace(f"{folder}/", "")
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 400
    assert sorted(folder.iterdir()) == before
