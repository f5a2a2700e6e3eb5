"""``bozzini plan``: what it says of a file's components, pictures, faces and labels is so."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest
import trimesh

from tests.anatomy.test_statements import VERSION_1, abdomen, save_labels
from tests.anatomy.test_surface import join, rod, turn_some
from tests.cli.plan_cases import SCOPE, Run, Tracts

OPTIONS = [*SCOPE, "--voxel", "2mm", "--method", "tube", "--quiet"]


def test_the_volume_that_is_kept_is_named_however_triangles_turn(run: Run, tmp_path: Path) -> None:
    source = tmp_path / "two.stl"
    both = join(turn_some(rod(8.0, 80.0), 0.4), rod(6.0, 60.0, 40.0))
    trimesh.Trimesh(*both, process=False).export(source)
    outcome = run(source, *OPTIONS, "--out", tmp_path / "way", "--json")
    kept = trimesh.Trimesh(*rod(8.0, 80.0)).volume / 1000.0
    dropped = trimesh.Trimesh(*rod(6.0, 60.0)).volume / 1000.0
    assert f"the largest ({kept:.3g} mL) is kept, 1 other" in outcome.err
    assert f"triangles and {dropped:.3g} mL, wholly outside" in outcome.err
    apart = [item for item in outcome.result["unreached"] if item["kind"] == "component"]
    assert [item["volume_mm3"] / 1000.0 for item in apart] == pytest.approx([dropped], rel=1e-3)
    assert apart[0]["share"] == pytest.approx(dropped / (kept + dropped), abs=0.02)


def test_a_surface_with_a_picture_is_planned_in_silence(run: Run, tmp_path: Path) -> None:
    mesh = trimesh.creation.cylinder(6.0, 60.0, sections=24)
    head = ["ply", "format ascii 1.0", "comment TextureFile skin.png"]
    head += [f"element vertex {len(mesh.vertices)}", *(f"property float {a}" for a in "xyz")]
    head += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord", "end_header"]
    rows = [" ".join(map(str, point)) for point in mesh.vertices]
    rows += [f"3 {a} {b} {c} 6 0 0 1 0 1 1" for a, b, c in mesh.faces]
    source = tmp_path / "textured.ply"
    source.write_text("\n".join([*head, *rows, ""]))
    out = tmp_path / "way"
    outcome = run(source, *OPTIONS, "--organ", "colon", "--out", out)
    assert outcome.code == 0 and "unable" not in outcome.err and "Traceback" not in outcome.err
    assert all(line.startswith("bozzini: ") for line in outcome.err.splitlines())


def test_faces_of_two_corners_go_with_repair(run: Run, tmp_path: Path) -> None:
    mesh = trimesh.creation.cylinder(6.0, 60.0, sections=24)
    source = tmp_path / "edge.obj"
    source.write_text(mesh.export(file_type="obj") + "\nf 3 4\n")
    out = tmp_path / "way"
    refused = run(source, *OPTIONS, "--out", out)
    assert refused.code == 2 and refused.err.count("\n") == 1 and not out.exists()
    assert "the face 'f 3 4' has 2 corners: --repair drops such faces" in refused.err
    outcome = run(source, *OPTIONS, "--repair", "--out", out, "--json")
    assert outcome.code == 0
    notes = {item["code"]: item["message"] for item in outcome.result["findings"]}
    assert notes["faces-dropped"] == "1 face of one or two corners dropped"


def test_labels_of_the_wrong_version_make_no_report(run: Run, tmp_path: Path) -> None:
    source = save_labels(tmp_path / "scan.nii.gz", abdomen(**VERSION_1))
    out = tmp_path / "way"
    outcome = run(source, *OPTIONS, "--labels", "totalsegmentator-v2:colon", "--out", out)
    assert outcome.code == 2 and outcome.err.count("\n") == 1 and not out.exists()
    assert "totalsegmentator-v1:colon fits (label 57, " in outcome.err


def test_an_organ_that_is_given_against_the_names_is_told(
    run: Run, tracts: Tracts, tmp_path: Path
) -> None:
    source = tmp_path / "colon.nii.gz"
    nibabel.save(nibabel.load(tracts.volume), source)
    options = [*OPTIONS, "--organ", "upper-tract", "--out", tmp_path / "way", "--json"]
    outcome = run(source, *options)
    assert outcome.code == 0 and outcome.result["organ"] == "upper-tract"
    assert "names are those of the organ colon, but upper-tract was given" in outcome.err
    assert np.isfinite(outcome.result["clearance_certified_mm"])
