"""``bozzini effector``: what it prints is what the library says; a bad input is one line."""

from __future__ import annotations

import csv
import io
import json
import math
import re

import numpy as np
import pytest

from bozzini.checks import list_quantities
from bozzini.cli.main import main
from bozzini.effector import (
    Effector,
    EffectorDesign,
    balance,
    effector_preset,
    find_stick_scale,
    lateral_deflection,
    pose,
    solve_inverse,
    tip_force,
    workspace,
)
from bozzini.muscle import MuscleFile, ThesisMuscle, write_muscle
from bozzini.muscle import preset as muscle_preset

EFFECTOR = Effector(effector_preset("measured"))
UNTUNED = ("--preset", "prototype")
THESIS = ("--beam", "3", "--model", "thesis", "--load-path", "bulk",
          "--muscle-preset", "effector-45")  # fmt: skip


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        capsys.readouterr()
        code = main(["effector", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def ask(run):
    def call(*arguments, code=0):
        got, out, err = run(*arguments, "--json")
        assert (got, err) == (code, "")
        return json.loads(out)

    return call


@pytest.mark.parametrize("method", ["superposition", "thesis"])
def test_pose_is_the_library(ask, method):
    said = ask("pose", "--pressure", "R=689.4kPa,G=413.6kPa", "--method", method)
    found = pose(EFFECTOR, {"R": 0.6894, "G": 0.4136}, method=method)
    assert said["tip_mm"] == pytest.approx(found.tip.tolist())
    assert said["holder_tip_mm"] == pytest.approx(found.holder_tip.tolist())
    assert said["lateral_mm"] == pytest.approx(float(found.lateral))
    assert said["azimuth_rad"] == pytest.approx(float(found.azimuth))
    assert said["length_error_mm"] == pytest.approx(float(found.length_error), abs=1e-12)
    for k, name in enumerate("RGB"):
        row = said["muscles"][name]
        assert row["contraction_mm"] == pytest.approx(found.contraction[k])
        assert row["force_N"] == pytest.approx(found.force[k])
        assert row["iterations"] == found.iterations[k]
    assert said["saturated"] is False
    assert said["converged"] is True
    assert "tables" not in said


def test_order_of_pressing_matters_to_the_thesis_only(ask, run):
    both = ("pose", "--pressure", "R=413.6kPa,G=689.4kPa", "--method", "thesis", *THESIS)
    first, second = (ask(*both, "--order", order)["lateral_mm"] for order in ("R,G", "G,R"))
    assert abs(first - second) > 1.0
    code, _, err = run("pose", "--pressure", "R=0.4,G=0.6", "--order", "R,G")
    assert code == 2
    assert "order" in err


def test_tables_of_the_thesis(ask, run):
    table = ask("pose", "--pressure", "R=689.4kPa", "--table", *THESIS)["tables"]["R"]
    # Table 4.1: 0 N, 7.6 mm, 22.8 mm, 1.69 N, and at the end 6.9 mm, 20.4 mm, 1.51 N
    first, last = table[0], table[-1]
    assert first["force_N"] == 0.0
    assert first["contraction_mm"] == pytest.approx(7.6, abs=0.05)
    assert first["lateral_mm"] == pytest.approx(22.8, abs=0.26)
    assert last["contraction_mm"] == pytest.approx(6.9, abs=0.15)
    assert last["lateral_mm"] == pytest.approx(20.4, abs=0.5)
    assert last["next_force_N"] == pytest.approx(1.51, abs=0.05)
    for row, after in zip(table, table[1:], strict=False):
        assert after["force_N"] == row["next_force_N"]
    code, text, _ = run("pose", "--pressure", "R=689.4kPa,B=0", "--table", *THESIS)
    assert code == 0
    assert "muscle R alone at 689.4 kPa, 10 rows" in text
    assert "muscle B alone" not in text


def test_an_iteration_that_does_not_end_is_said(ask, run):
    # stiffer than the muscle: d lateral / d contraction is above c times the muscle's stiffness
    command = ("pose", "--pressure", "R=689.4kPa", "--rigidity", "260Nmm^2", "--table", *UNTUNED)
    said = ask(*command)
    assert said["tables_converged"] == {"R": False}
    assert len(said["tables"]["R"]) > 50
    assert said["converged"] is True  # the root is found all the same
    code, text, _ = run(*command)
    assert code == 0
    assert "note: not converged" in text
    assert text.count("\n") < 30


def test_too_much_is_said(run):
    command = ("pose", "--pressure", "R=689.4kPa,G=689.4kPa", *THESIS)
    code, text, _ = run(*command)
    assert code == 1
    assert "saturated: the muscles ask for" in text
    code, out, _ = run(*command, "--json")
    said = json.loads(out)
    assert (code, said["saturated"]) == (1, True)
    assert said["lateral_mm"] < said["demanded_lateral_mm"]


def test_reach_comes_back(ask):
    said = ask("reach", "--to", "6mm,-8mm")
    pressures = {name: row["pressure_MPa"] for name, row in said["muscles"].items()}
    assert pose(EFFECTOR, pressures).lateral_vector == pytest.approx([6.0, -8.0], abs=1e-8)
    assert said["reachable"] is True
    assert said["delivered_mm"] == pytest.approx([6.0, -8.0])
    assert said["tip_mm"][:2] == pytest.approx([6.0, -8.0])


def test_out_of_reach_is_a_negative_answer(ask, run):
    said = ask("reach", "--to", "12mm,-5mm", *UNTUNED, code=1)
    found = solve_inverse(Effector(effector_preset("prototype")), (12.0, -5.0))
    assert said["reachable"] is False
    assert said["delivered_mm"] == pytest.approx(found.delivered.tolist())
    x, y = said["delivered_mm"]
    assert y / x == pytest.approx(-5.0 / 12.0)
    code, text, _ = run("reach", "--to", "12mm,-5mm", *UNTUNED)
    assert code == 1
    assert f"delivered {x:.3f}, {y:.3f} mm" in text
    assert str(found.reason) in text
    # the derived beam formula bends further
    assert ask("reach", "--to", "12mm,-5mm", *UNTUNED, "--beam", "2")["reachable"] is True


def test_options_of_the_design_reach_it(ask):
    said = ask(
        "pose", "--pressure", "A=300kPa", "--angles", "A=10deg,C=200deg", "--offset", "3.8mm",
        "--backbone-length", "5cm", "--segments", "18", "--rigidity", "1.5e-4 N m^2",
        "--catheter", "20Nmm²", "--holder-length", "8", "--pressure-limit", "90psi",
        "--beam", "2", "--muscle-preset", "thesis-40", "--ends", "trellis",
    )  # fmt: skip
    design = said["design"]
    assert {name: row["angle_rad"] for name, row in design["muscles"].items()} == pytest.approx(
        {"A": math.radians(10.0), "C": math.radians(200.0)}
    )
    assert design["muscles"]["A"]["length_mm"] == 50.0
    assert design["muscles"]["A"]["outer_radius_mm"] == muscle_preset("thesis-40").outer_radius
    assert design["offset_mm"] == 3.8
    assert design["backbone_length_mm"] == 50.0
    assert design["segments"] == 18
    assert design["flexural_rigidity_Nmm2"] == pytest.approx(150.0)
    assert design["catheter_rigidity_Nmm2"] == 20.0
    assert design["holder_length_mm"] == 8.0
    assert design["pressure_limit_MPa"] == pytest.approx(0.62053, abs=1e-5)
    assert design["beam_factor"] == 2.0
    assert design["compliance_mm_per_N"] == pytest.approx(3.8 * 50.0**2 / (2.0 * 170.0))
    assert said["azimuth_rad"] == pytest.approx(math.radians(10.0))
    assert said["lateral_mm"] == pytest.approx(
        float(lateral_deflection(
            EFFECTOR.design.resize(50.0).replace(offset=3.8, segments=18),
            said["muscles"]["A"]["contraction_mm"],
        ))
    )  # fmt: skip


def test_a_muscle_preset_brings_its_length(ask):
    design = ask("pose", "--pressure", "R=0", "--muscle-preset", "thesis-60")["design"]
    assert design["backbone_length_mm"] == 60.0


def test_rigidity_from_a_test(ask):
    design = ask("pose", "--pressure", "R=0", "--rigidity-test", "0.1N,15mm")["design"]
    assert design["flexural_rigidity_Nmm2"] == pytest.approx(202.5)


def test_workspace_is_a_table_and_a_picture(ask, run, tmp_path):
    said = ask("workspace", "--out", "edge.csv")
    found = workspace(EFFECTOR)
    assert said["area_mm2"] == pytest.approx(found.area)
    assert said["amplitudes_mm"] == pytest.approx(
        dict(zip("RGB", found.reach.amplitudes, strict=True))
    )
    rows = list(csv.DictReader((tmp_path / "edge.csv").open(encoding="utf-8")))
    edge = np.array([[float(row["x_mm"]), float(row["y_mm"])] for row in rows])
    assert edge == pytest.approx(found.boundary, abs=1e-6)
    assert said["design"]["conflicts"]
    code, _, told = run("workspace", "--out", "edge.png")
    assert code == 0
    assert "note: offset is 4 mm" in told
    assert (tmp_path / "edge.png").read_bytes()[:4] == b"\x89PNG"


def test_gaps_are_told(ask, run):
    angles = ("--angles", "A=0deg,B=90deg")
    assert ask("workspace", *angles)["inner_radius_mm"] == 0.0
    code, text, _ = run("workspace", *angles)
    assert code == 0
    assert "not reached: from B to A (270 deg)" in text


def test_force_of_the_tip(ask, run, tmp_path):
    said = ask("workspace", "--of", "force", "--at", "3mm,2mm", "--out", "force.csv")
    found = tip_force(EFFECTOR, [math.cos(1.0), math.sin(1.0)], lateral=(3.0, 2.0))
    force = np.interp(1.0, said["direction_rad"], said["force_N"])
    assert force == pytest.approx(float(found.force), rel=1e-3)
    assert (
        (tmp_path / "force.csv").read_text(encoding="utf-8").startswith("direction_rad,force_N\n")
    )
    code, text, _ = run("workspace", "--of", "force", "--out", "force.svg")
    assert code == 0
    assert "held at 0, 0 mm" in text


def test_curve(ask, run, tmp_path):
    code, out, _ = run("curve", "--points", "7")
    assert code == 0
    rows = list(csv.DictReader(io.StringIO(out)))
    assert len(rows) == 7
    for row in rows:
        found = balance(EFFECTOR, "G", pressure=float(row["pressure_MPa"]))
        assert float(row["deflection_G_mm"]) == pytest.approx(float(found.lateral), abs=1e-6)
        assert float(row["force_G_N"]) == pytest.approx(float(found.force), abs=1e-6)
    said = ask("curve", "--cubic-from", "100kPa", "--out", "curve.png")
    cubic = said["cubics"]["R"]
    assert 0.0 < cubic["rms_error_mm"] < cubic["largest_error_mm"] < 1.0
    assert (tmp_path / "curve.png").exists()


def test_trace_circle(ask, run, tmp_path):
    said = ask("trace", "circle", "--radius", "8mm", "--points", "12", "--out", "circle.csv")
    assert said["complete"] is True
    rows = list(csv.DictReader((tmp_path / "circle.csv").open(encoding="utf-8")))
    assert len(rows) == 13  # closed
    for row in rows:
        pressures = [float(row[f"pressure_{name}_MPa"]) for name in "RGB"]
        tip = pose(EFFECTOR, np.minimum(pressures, 0.827)).lateral_vector
        assert np.hypot(*tip) == pytest.approx(8.0, abs=1e-5)
    code, text, _ = run("trace", "circle", "--radius", "14mm", "--out", "circle.png")
    assert code == 1
    assert "targets in reach" in text
    assert (tmp_path / "circle.png").exists()


def test_trace_line_by_a_cubic_is_off(ask):
    line = ("trace", "line", "--from", "-5mm,-8mm", "--to", "8mm,4mm", "--points", "9")
    exact, cubic = ask(*line), ask(*line, "--cubic-from", "0")
    assert exact["targets"] == cubic["targets"] == 9
    assert exact["columns"]["target_x_mm"][::8] == pytest.approx([-5.0, 8.0])
    assert exact["largest_error_mm"] < 1e-8 < 0.01 < cubic["largest_error_mm"]
    assert cubic["pressure_map"] == "cubic"


def test_sweep_lists_what_does_not_work(ask, run, tmp_path):
    command = (
        "study", "sweep", "--vary", "offset=1mm:4mm:4", "--vary", "segments=12,15",
        "--deflection", "12mm", "--quiet",
    )  # fmt: skip
    said = ask(*command, "--out", "sweep.csv")
    assert said["designs"] == 8
    assert 0 < said["feasible"] < 8
    columns = said["columns"]
    for works, reason in zip(columns["feasible"], columns["reason"], strict=True):
        assert works == (reason == "")
    rows = list(csv.DictReader((tmp_path / "sweep.csv").open(encoding="utf-8")))
    assert [row["reason"] for row in rows] == columns["reason"]  # commas in them survive
    assert run(*command, "--out", "sweep.png")[0] == 0
    code, text, _ = run(*command)
    assert code == 0
    assert len(text.splitlines()) == 9


def test_sweep_of_angles_and_of_muscles(ask):
    said = ask(
        "study", "sweep", "--quiet", "--vary", "angles=0deg/120deg/240deg,307.5deg/219deg/75deg"
    )
    assert said["columns"]["angles_deg"][0] == "0/120/240"
    said = ask("study", "sweep", "--quiet", "--vary", "muscle.braid-angle=34deg,38deg")
    assert said["columns"]["muscle.braid_angle_rad"] == pytest.approx(np.radians([34.0, 38.0]))
    assert said["columns"]["area_mm2"][0] > said["columns"]["area_mm2"][1]


def test_least_pressure(ask, run):
    said = ask("study", "least-pressure", "--between", "length=40mm:50mm", "--deflection", "12mm",
               "--quiet")  # fmt: skip
    assert said["pressure_MPa"] < said["pressure_before_MPa"]
    length = said["changes"]["length_mm"]
    better = Effector(EFFECTOR.design.resize(length))
    needed = balance(better, "R", pressure=said["pressure_MPa"]).lateral
    assert float(needed) == pytest.approx(12.0, abs=1e-6)
    code, text, _ = run("study", "least-pressure", "--between", "offset=0.1mm:0.2mm",
                        "--deflection", "12mm", "--quiet")  # fmt: skip
    assert code == 1
    assert "no design" in text


def test_pose_pictures(run, tmp_path):
    base = ("pose", "--pressure", "R=600kPa", *THESIS)
    assert run(*base, "--out", "pose.png")[0] == 0
    assert run(*base, "--table", "--out", "table.svg")[0] == 0
    assert run(*base, "--out", "line.csv")[0] == 0
    assert run(*base, "--table", "--out", "table.csv")[0] == 0
    assert run("reach", "--to", "6mm,-8mm", "--out", "reach.png")[0] == 0
    line = np.loadtxt(tmp_path / "line.csv", delimiter=",", skiprows=1)
    pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert pieces == pytest.approx(np.full(15, 3.0), abs=1e-6)
    head, first, *_ = (tmp_path / "table.csv").read_text(encoding="utf-8").splitlines()
    assert head == "muscle,force_N,contraction_mm,lateral_mm,next_force_N"
    assert first.startswith("R,0,")
    code, _, err = run(*base, "--out", "pose.png")
    assert code == 2
    assert "exists already" in err


def test_model_of_the_muscles(ask):
    said = ask("pose", "--pressure", "R=689.4kPa", *THESIS)
    design = EFFECTOR.design.replace(
        beam_factor=3.0,
        muscles=tuple(
            type(placed)(name=placed.name, angle=placed.angle, muscle=muscle_preset("effector-45"))
            for placed in EFFECTOR.design.muscles
        ),
    )
    effector = Effector(design, lambda muscle: ThesisMuscle(muscle, load_path="bulk"))
    assert said["lateral_mm"] == pytest.approx(
        float(balance(effector, "R", pressure=0.6894).lateral)
    )


NARROW = ("--offset", "1.5mm", "--beam", "2")


def test_a_length_that_is_lost_is_told(run):
    command = ("pose", "--method", "thesis", *THESIS, "--pressure")
    _, shorter, _ = run(*command, "R=689.4kPa,G=413.6kPa")
    assert "the eight steps make the backbone 1.35 mm shorter" in shorter
    _, longer, _ = run(*command, "R=413.6kPa,B=689.4kPa")
    assert re.search(r"the eight steps make the backbone 2.\d+ mm longer", longer)
    _, neither, _ = run("pose", "--pressure", "R=689.4kPa,G=413.6kPa")
    assert "eight steps" not in neither


def test_a_linkage_that_ends_is_told(run, ask):
    code, text, told = run("pose", "--pressure", "R=645.53274039634kPa", *NARROW)
    assert code == 1
    assert "segment 15 of 15 would come nearer than 1.5 mm" in text
    assert "use more segments or a larger offset" in text
    assert "not every segment closes" in told
    said = ask("reach", "--to", "30mm,-30mm", *NARROW, "--pressure-limit", "2MPa", code=1)
    assert "segment 15 of 15" in said["reason"]


def test_muscles_that_cancel_have_no_direction(run):
    pressed = ("--pressure", "A=400kPa,B=400kPa", "--angles", "A=90deg,B=270deg")
    code, text, _ = run("pose", *pressed)
    assert code == 0
    assert "tip at 0.000, 0.000, 45.000 mm: on the axis" in text
    assert "towards" not in text


def test_a_table_that_fails_leaves_the_pose(run, ask, tmp_path):
    command = ("pose", "--pressure", "R=689.4kPa", "--rigidity", "5000", "--table")
    code, text, told = run(*command)
    assert code == 0
    assert "note: no table, muscle R, step 2 of the fixed point" in told
    said = ask(*command)
    assert said["tables"] == {} and said["tables_converged"] == {"R": False}
    assert said["converged"] is True
    code, out, err = run(*command, "--out", "x.csv")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "--table has nothing to write" in err
    code, _, told = run("pose", "--pressure", "R=0", "--table")
    assert code == 0 and "no table, no muscle is under pressure" in told
    assert run("pose", "--pressure", "R=0", "--table", "--out", "x.csv")[0] == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "command",
    [
        ("pose", "--pressure", "R=0"),
        ("reach", "--to", "1mm,1mm"),
        ("workspace",),
        ("workspace", "--of", "force"),
        ("curve", "--points", "2"),
        ("trace", "line", "--from", "0,0", "--to", "1,1", "--points", "2"),
        ("study", "sweep", "--vary", "offset=4", "--quiet"),
        ("study", "least-pressure", "--between", "offset=3.9:4", "--deflection", "9", "--quiet"),
    ],
)
def test_conflicts_are_told_by_every_command(run, ask, command):
    code, _, told = run(*command)
    assert code == 0
    # least-pressure tells those of the design that it found
    assert re.search(r"^note: offset is \S+ mm: a 9 mm holder", told, re.MULTILINE)
    said = ask(*command)
    assert any("9 mm holder" in line for line in said["design"]["conflicts"])


STRONG = ("--beam", "2", "--muscle-preset", "effector-45", "--pressure-limit", "3MPa")


def test_a_flat_curve_is_told(run, ask):
    code, out, told = run("curve", *STRONG, "--points", "8", "--cubic-from", "100kPa")
    assert code == 0
    rows = list(csv.DictReader(line for line in out.splitlines() if not line.startswith("#")))
    flat = [row["saturated_R"] == "1" for row in rows]
    assert flat == [float(row["deflection_R_mm"]) > 27.7 for row in rows]
    first = 1e3 * float(rows[flat.index(True)]["pressure_MPa"])
    assert f"note: muscle R from {first:.4g} kPa on: saturated" in told
    assert "flat beyond" in out
    said = ask("curve", *STRONG, "--points", "8", "--cubic-from", "100kPa")
    assert said["cubics"]["R"]["saturated"] is True
    assert said["cubics"]["R"]["to_MPa"] < 1e-3 * first
    assert any("muscle R from" in note for note in said["notes"])
    said = ask("workspace", *STRONG)
    assert said["saturated"] == {"R": True, "G": True, "B": True}
    assert "saturated: R, G, B could go on" in run("workspace", *STRONG)[1]


def test_a_place_out_of_reach_has_no_force(run, ask, tmp_path):
    command = ("workspace", "--of", "force", "--at", "40mm,0", "--out", "force.csv")
    code, text, _ = run(*command)
    assert code == 1
    assert "the tip cannot be at 40, 0 mm: muscle" in text
    said = ask(*command, code=1)
    assert said["reachable"] is False and said["file"] is None
    assert list(tmp_path.iterdir()) == []


def test_errors_are_of_targets_in_reach(run, ask):
    command = ("trace", "circle", "--radius", "10mm", *UNTUNED)
    said = ask(*command, code=1)
    assert said["largest_error_mm"] < 1e-9 < 1.0 < said["largest_distance_mm"]
    _, _, told = run(*command)
    away = said["targets"] - said["reachable"]
    assert f"note: {away} of 73 targets are out of reach, the farthest by 1.57 mm" in told


def test_reach_has_all_of_the_answer(ask, run):
    said = ask("reach", "--to", "6mm,-8mm")
    found = solve_inverse(EFFECTOR, (6.0, -8.0))
    assert said["residual_mm"] == pytest.approx(float(found.displacement_error))
    for k, name in enumerate("RGB"):
        assert said["muscles"][name]["force_N"] == pytest.approx(found.force[k])
        assert said["muscles"][name]["contraction_mm"] == pytest.approx(found.contraction[k])
    assert "force [N]" in run("reach", "--to", "6mm,-8mm")[1]


def test_a_pressure_that_none_is_has_no_number(run, ask, tmp_path):
    command = ("study", "sweep", "--quiet", "--vary", "offset=1mm,4mm,8mm", "--deflection", "24mm",
               "--beam", "2", "--muscle-preset", "effector-45")  # fmt: skip
    columns = ask(*command, "--out", "sweep.csv", code=1)["columns"]
    assert columns["needed_pressure_MPa"][0] is None
    assert columns["needed_pressure_MPa"][1] > 0.827
    assert columns["needed_pressure_MPa"][2] is None
    assert columns["area_mm2"][0] is None and columns["area_mm2"][2] > 0.0
    rows = list(csv.DictReader((tmp_path / "sweep.csv").open(encoding="utf-8")))
    assert [row["needed_pressure_MPa"] != "" for row in rows] == [False, True, False]
    assert [row["area_mm2"] != "" for row in rows] == [False, True, True]


def test_help_says_the_defaults(run):
    _, text, _ = run("pose", "--help")
    fields = list_quantities(EffectorDesign).values()  # which --set NAME tells
    text = " ".join([*text.split(), *(known.describe() for known in fields)])
    design = EFFECTOR.design
    angles = ",".join(f"{p.name}={math.degrees(p.angle):g}deg" for p in design.muscles)
    for value in (
        f"{design.offset:g} mm", f"{design.backbone_length:g} mm", f"{design.holder_length:g} mm",
        f"{design.segments}", f"{design.flexural_rigidity:g} N mm^2", f"{design.beam_factor:g}",
        f"{design.catheter_rigidity:g}", f"{design.pressure_limit:g} MPa", angles, "measured-45",
    ):  # fmt: skip
        assert f"(measured: {value})" in text.replace("- ", "-")
    assert design.muscles[0].muscle == muscle_preset("measured-45")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["pose"], "--pressure"),
        (["pose", "--pressure", "Q=1kPa"], "'Q': the muscles of this design are R, G, B"),
        (["pose", "--pressure", "R=1kPa,R=2kPa"], "'R' more than once"),
        (["pose", "--pressure", "R"], "'R': it must be NAME=PRESSURE"),
        (["pose", "--pressure", "R="], "'R=': it must be NAME=PRESSURE"),
        (["pose", "--pressure", "R=1kPa,"], "has the part ''"),
        (["pose", "--pressure", "R=-1kPa"], "-0.001 MPa: it must lie in [0, 0.827] MPa"),
        (["pose", "--pressure", "R=900kPa"], "0.9 MPa: it must lie in [0, 0.827] MPa"),
        (["pose", "--pressure", "R=5mm"], "'5mm' has the wrong kind of unit"),
        (["pose", "--pressure", "R=nan"], "'nan'"),
        (["pose", "--pressure", "R=0.5", "--offset", "1mm"], "offset is 1 mm"),
        (["pose", "--pressure", "R=0.5", "--backbone-length", "0"], "length is 0"),
        (["pose", "--pressure", "R=0.5", "--segments", "0"], "segments is 0"),
        (["pose", "--pressure", "R=0.5", "--segments", "2.5"], "2.5"),
        (["pose", "--pressure", "R=0.5", "--rigidity", "200N"], "'200N' has the wrong kind"),
        (["pose", "--pressure", "R=0.5", "--rigidity", "1.2.3"], "give a rigidity such"),
        (["pose", "--pressure", "R=0.5", "--rigidity=-2"], "flexural rigidity is -2"),
        (["pose", "--pressure", "R=0.5", "--rigidity-test", "0.1N"], "FORCE,DEFLECTION"),
        (["pose", "--pressure", "R=0.5", "--rigidity-test", "0.1N,0mm"], "deflection is 0 mm"),
        (["pose", "--pressure", "R=0.5", "--rigidity-test", "1N,1mm", "--rigidity", "1"], "one"),
        (["pose", "--pressure", "R=0.5", "--beam", "4"], "is 4: it must lie in [2, 3]"),
        (["pose", "--pressure", "R=0.5", "--preset", "none"], "'none'"),
        (["pose", "--pressure", "R=0.5", "--muscle-preset", "none"], "'none'"),
        (["pose", "--pressure", "R=0.5", "--model", "lui"], "'lui'"),
        (["pose", "--pressure", "R=0.5", "--model", "liu"], "liu must be given membrane_modulus"),
        (["pose", "--pressure", "A=0.5", "--angles", "A=0,B=360deg"], "angles must differ"),
        (["pose", "--pressure", "A=0.5", "--angles", "A 0"], "NAME=ANGLE"),
        (["pose", "--pressure", "R=0.5,G=0.5,B=0.5", "--method", "thesis"], "at most 2"),
        (["pose", "--pressure", "R=0.5", "--out", "a.txt"], ".csv"),
        (["pose", "--pressure", "R=0.5", "--out", "nowhere/a.png"], "nowhere"),
        (["reach"], "--to"),
        (["reach", "--to", "1mm"], "1 part"),
        (["reach", "--to", "1mm,2kg"], "wrong kind of unit"),
        (["reach", "--to", "1mm,2mm", "--out", "a.csv"], ".png"),
        (["workspace", "--at", "1mm,0"], "--at has no effect without --of force"),
        (["curve", "--points", "1"], "points is 1"),
        (["curve", "--cubic-from", "2MPa"], "2 MPa"),
        (["trace", "circle", "--radius", "0mm"], "radius is 0 mm"),
        (["trace", "circle", "--radius", "5mm", "--points", "2"], "points is 2"),
        (["trace", "line", "--from", "0,0", "--to", "1,2", "--points", "1"], "points is 1"),
        (["study", "sweep"], "--vary"),
        (["study", "sweep", "--vary", "colour=1,2"], "'colour'"),
        (["study", "sweep", "--vary", "offset"], "NAME=LOW:HIGH:COUNT"),
        (["study", "sweep", "--vary", "offset=1:2"], "NAME=LOW:HIGH:COUNT"),
        (["study", "sweep", "--vary", "offset=1:2:x"], "NAME=LOW:HIGH:COUNT"),
        (["study", "sweep", "--vary", "segments=a"], "segments is 'a'"),
        (["study", "sweep", "--vary", "segments=0,15"], "whole numbers in [1, 1000]"),
        (["study", "sweep", "--vary", "angles=0deg/120deg"], "give 3, one for each"),
        (["study", "sweep", "--vary", "angles=0deg/9deg/9deg"], "(9 deg): angles must differ"),
        (["study", "sweep", "--vary", "muscle.strands=20:30:4"], "this gives 23.3333 strands"),
        (["study", "sweep", "--vary", "offset=3,2000"], "offset is 2000 mm"),
        (["study", "sweep", "--vary", "offset=3,4", "--deflection", "0mm"], "deflection is 0 mm"),
        (["study", "least-pressure", "--between", "pressure-limit=0.1:0.8", "--deflection", "12"],
         "does not change the pressure"),
        (["study", "least-pressure", "--between", "offset=3:4", "--deflection", "12",
          "--choose-segments", "2000"], "whole numbers in [1, 1000]"),
        (["study", "least-pressure", "--between", "offset=3:4", "--deflection", "12",
          "--choose-segments", "0"], "whole numbers in [1, 1000]"),
        (["study", "sweep", "--vary", "offset=3,4", "--vary", "offset=5"], "more than once"),
        (["study", "sweep", "--vary", "flexural-rigidity=1N"], "give a rigidity"),
        (["study", "sweep", "--vary", "offset=1:2:9999", "--vary", "length=1,2"], "19998 designs"),
        (["study", "sweep", "--vary", "offset=3,4", "--deflection=-1mm"], "deflection is -1"),
        (["study", "least-pressure", "--between", "offset=3mm", "--deflection", "9"], "LOW:HIGH"),
        (["study", "least-pressure", "--between", "offset=4:3", "--deflection", "9"], "offset"),
        (["study", "least-pressure", "--between", "angles=1:2", "--deflection", "9"], "'angles'"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_nothing_is_written(run, tmp_path, arguments, said):
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_a_repeated_pressure_adds_up(ask, run):
    both = ask("pose", "--pressure", "R=0.5", "--pressure", "G=300kPa")
    assert both == ask("pose", "--pressure", "R=0.5,G=300kPa")
    code, _, told = run("pose", "--pressure", "R=0.5", "--pressure", "R=0.4")
    assert code == 2
    assert "--pressure names 'R' more than once" in told
    parts = ("--angles", "A=0deg", "--angles", "B=90deg")
    assert ask("workspace", *parts) == ask("workspace", "--angles", "A=0deg,B=90deg")


def test_the_preset_of_the_thesis_is_its_model_and_its_muscle(ask, run):
    typed = ("--model", "thesis", "--load-path", "bulk", "--muscle-preset", "effector-45",
             "--beam", "3")  # fmt: skip
    said = ask("pose", "--pressure", "R=689.4kPa", "--preset", "thesis")
    assert said == ask("pose", "--pressure", "R=689.4kPa", *typed)
    assert said["model"] == "thesis"
    assert said["lateral_mm"] == pytest.approx(20.4, abs=0.05)
    # Any model can be had with it.
    assert ask("pose", "--pressure", "R=0.5", "--preset", "thesis", "--model", "energy") == ask(
        "pose", "--pressure", "R=0.5", "--muscle-preset", "effector-45", "--beam", "3"
    )
    code, text, _ = run("pose", "--pressure", "R=689.4kPa", "--preset", "thesis")
    assert code == 0
    x, y, z = said["holder_tip_mm"]
    assert f"end of the holder at {x:.3f}, {y:.3f}, {z:.3f} mm" in text


def test_the_stick_is_a_place(ask, run):
    """A reading is the target of `reach`, by the mapping that the rig steers with."""
    said = ask("stick", "--axes", "700,400")
    x, y = said["target_mm"]
    reached = ask("reach", "--to", f"{x!r}mm,{y!r}mm")
    assert said["muscles"] == reached["muscles"]
    scale = find_stick_scale(EFFECTOR)
    assert said["full_stick_mm"] == pytest.approx(scale)
    assert (x, y) == pytest.approx((scale * 188 / 512, scale * 112 / 512))
    code, text, _ = run("stick", "--axes", "1024,1024")
    assert code == 1
    assert "out of reach" in text
    rest = ask("stick", "--axes", "520,505", "--dead-zone", "12")
    assert rest["target_mm"] == [0.0, 0.0]
    for wrong, message in (
        (("--axes", "1025,0"), "stick reading x is 1025: it must lie in [0, 1024]"),
        (("--axes", "700"), "give 2"),
        (("--axes", "1,2", "--dead-zone", "-1"), "stick dead zone is -1"),
    ):
        code, out, told = run("stick", *wrong)
        assert (code, out) == (2, "")
        assert message in told


def test_the_conflicts_of_a_design_are_one_note(ask, run):
    _, _, told = run("reach", "--to", "2mm,2mm")
    conflicts = ask("reach", "--to", "2mm,2mm")["design"]["conflicts"]
    assert len(conflicts) > 1
    (note,) = told.splitlines()
    assert note.startswith(f"note: {conflicts[0]}; muscles R, G, B touch the 4 mm coil")
    assert all(line.partition(" touches ")[2] in note for line in conflicts)


def test_the_muscles_may_come_from_a_file(run, tmp_path):
    fitted = muscle_preset("fitted-45")
    write_muscle(tmp_path / "m.yaml", MuscleFile(muscle=fitted, model="chou"))
    command = ("pose", "--pressure", "R=400kPa", "--json", "--muscle-preset")
    code, out, err = run(*command, "m.yaml")
    assert code == 0 and "note: m.yaml: the model" in err, out + err
    assert json.loads(out) == json.loads(run(*command, "fitted-45")[1])
    code, _, err = run(*command, "nowhere.yaml")
    assert code == 2


def test_an_angle_that_is_typed_in_degrees_is_answered_in_degrees(run, ask):
    between = ("--between", "muscle.braid-angle=34deg:38deg", "--deflection", "9", "--quiet")
    code, text, _ = run("study", "least-pressure", *between)
    assert code == 0
    (angle,) = ask("study", "least-pressure", *between)["changes"].values()
    assert f"{math.degrees(angle):.6g} deg" in text
