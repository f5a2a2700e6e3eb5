"""Run every command on damaged files and odd options: ``make fuzz COUNT=500 SEED=0``.

A case is made from the seed and its number alone, so that it can be repeated: the line that is
printed for a failure does so, and keeps the files of the case. Each case is a process of its own,
forked from one that has loaded everything, with a limit of processor time and of memory. A case is
right if

- its exit code is 0, 1 or 2, without a traceback; with 2 there is exactly one line on stderr that
  begins with ``bozzini: error:``, and none otherwise;
- with ``--json`` there is one JSON object on stdout;
- its input files are as before, with code 2 nothing has been written, and nothing temporary stays;
- it takes less than 30 s of processor time and 2 GB.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import click

from bozzini.cli.common import LabelsType

from .mutate import UNTITLED, WORDS, damage, make_number, make_value, repeat_option

MEMORY = 2_000_000_000
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

TRACTS = (
    *("tube.nii.gz", "tube.nii.gz", "tube.nii.gz", "tube.nii", "tube.stl", "tube.stl", "tube.stl"),
    *("tube.ply", "tube.obj", "tube.glb", "tube.vtk", "tube.off"),
)
EXAMPLE_ROBOTS = ("two_sections.yaml", "helical.yaml", "gastroscope.yaml")
ROBOTS = ("two_sections.yaml", "two_sections.yaml", "helical.yaml", "gastroscope.yaml",
          "elastic.yaml", "elastic.yaml")  # fmt: skip
FILES = {
    "tract": TRACTS,
    "tract or shapes": (*TRACTS, *("shapes.json", "shapes.yaml") * 6),
    "robot": ROBOTS,
    "table": ("table.csv",),
    "muscle": ("muscle.yaml", "muscle.json"),
    "curve": ("curve.csv", "curve.mat"),
    "plan": ("plan.npz",),
    "plan's tract": ("tube.stl",),
    "ct": ("ct.nii.gz",),
    "board": ("board.yaml",),
    "cameras": ("cameras.yaml", "cameras.json"),
    "markers": ("markers.csv",),
    "log": ("log.csv",),
    "way": ("way.csv",),
    "rows": ("rows.csv",),
    "two sections": ("two_sections.yaml",),
    "strips": ("strips.yaml",),
    "pictures": ("pictures.csv",),
    "pairs": ("pairs.csv",),
    "loop": ("loop.csv",),
    "fitted loop": ("loop.yaml",),
    "law": ("law.yaml",),
    "fitted muscle": ("fit.yaml",),
    "elastic": ("elastic.yaml",),
    "drives": ("drives.csv",),
    "obstacle": ("shapes.json", "shapes.yaml"),
    "study": ("study.yaml", "search.yaml"),
    "options": ("options.yaml",),
    "saltelli": ("saltelli.yaml", "study.yaml"),
    "results": ("results",),
    "arm": ("arm.yaml",),
    "head": ("head.yaml",),
    "commands": ("commands.csv",),
    "mover": ("mover.yaml",),
    "pulls": ("pulls.csv",),
    "deflections": ("deflections.csv",),
}
LEGAL: dict[str, tuple[int, str]] = {
    # How often, and command lines that work, with | between; <kind is a file, >suffix an output.
    "plan": (14, "<tract --options <options --diameter 5mm --link 8mm --head-step 1mm --out >"),
    "certify": (8, "<plan <plan's_tract"),
    "uncertainty": (
        6,
        "<plan <plan's_tract --sd 0.3mm --draws 20 --out >|<saltelli --workers 1 --out >",
    ),
    "execute": (1, "<plan <plan's_tract --speed 500mm/s --step 5ms --out >"),
    "evaluate": (1, "--phantoms 1 --starts 1 --policy straight --out >.csv"),
    "export": (4, "ros2 <plan --out >.yaml"),
    "segment": (8, "<ct --out >.nii.gz"),
    "demo": (3, "--voxel 3mm --diameter 9mm --link 12mm --out >"),
    "tree": (4, "<tract --out >.csv"),
    "reach": (4, "<tract --diameter 3mm --link 3mm --out >.csv"),
    "duct kinds": (1, ""),
    "duct fit": (6, "<tract --pieces 6 --out >.json"),
    "duct show": (6, "<tract or shapes --out >.png"),
    "duct limits": (6, "<tract or shapes --diameter 4mm"),
    "duct chain": (2, "<way --links 5 --out >.csv"),
    "show": (4, "<tract --out >.html"),
    "record": (1, "<plan --style x-ray --duration 0.2s --rate 5 --out >.gif"),
    "phantom": (3, "--out >.stl --voxel 3mm"),
    "data list": (1, ""),
    "data fetch": (1, "no-such-data --to >"),
    "muscle solve": (4, "--pressure 300kPa --load 1N"),
    "muscle curve": (3, "<muscle --points 5"),
    "muscle models": (1, "chou"),
    "muscle export": (3, "--model chou --out >.c"),
    "muscle presets": (1, ""),
    "muscle fit": (5, "<table --free modulus"),
    "muscle compare": (5, "<table --model energy --model thesis"),
    "muscle predict": (4, "<fitted_muscle --pressure 300kPa --load 0N"),
    "muscle fit-loop": (4, "<loop --samples 100 --out >.yaml"),
    "muscle trace-loop": (2, "<fitted_loop <loop"),
    "muscle invert-loop": (3, "<fitted_loop <loop"),
    "hysteresis fit": (4, "<loop --input pressure --output contraction --samples 100 --out >.yaml"),
    "hysteresis predict": (3, "<law <loop --out >.csv"),
    "rig identify": (5, "<curve --check <curve"),
    "effector pose": (3, "--pressure R=300kPa,G=200kPa"),
    "effector curve": (2, "--points 5"),
    "effector reach": (3, "--to 5mm,-3mm"),
    "effector stick": (3, "--axes 700,400"),
    "effector workspace": (2, ""),
    "effector tip-error": (2, "--pressure R=0.4MPa --pressure-sd 5kPa --draws 64"),
    "effector trace": (4, "--from -2mm,0mm --to 5mm,3mm --points 5|--radius 4mm --points 6"),
    "effector sweep": (2, "--vary offset=3mm:5mm:3"),
    "effector least-pressure": (2, "--between offset=3mm:4mm --deflection 8mm"),
    "rig demo": (1, "--board native --out >"),
    "rig run": (2, "--board native --duration 0.2s"),
    "rig replay": (2, "<log --board native"),
    "rig characterise": (1, "--board native --steps 2 --repeats 1 --hold 0.3s --out >.csv"),
    "rig flash": (1, "--port /dev/ttyACM0"),
    "continuum models": (1, ""),
    "new plan": (1, ">.yaml"),
    "new muscle": (1, ">.yaml"),
    "new robot": (2, "--sections 2 --tendons 3 >.yaml"),
    "new effector": (1, ">.yaml"),
    "new shapes": (1, ">.yaml"),
    "new head": (1, ">.yaml"),
    "new manoeuvre": (1, ">.yaml"),
    "new study": (1, ">.yaml"),
    "continuum pose": (8, "<robot --displacement T1=1mm"),
    "continuum tip-error": (3, "<robot --displacement T1=1mm --displacement-sd 50um --draws 64"),
    "continuum jacobian": (2, "<robot --tension T1=1N"),
    "continuum reach": (4, "<robot --to 30mm,10mm,80mm --starts 4"),
    "continuum compare": (3, "<robot --displacement T1=1mm"),
    "continuum workspace": (3, "<robot --count 500"),
    "continuum design": (2, "<way --tendons 1 --out >.yaml"),
    "continuum rank": (1, "<plan --modes 4 --sections 4 --rounds 2"),
    "continuum contact": (3, "<robot <tract or shapes --displacement T1=1mm"),
    "continuum insert": (3, "<elastic <tract or shapes --to 20mm --step 5mm"),
    "continuum fit": (2, "<two_sections <rows --folds 0 --free base.position"),
    "continuum predict": (3, "<two_sections <rows --out >.csv"),
    "continuum fabricate": (2, "<robot --out >"),
    "effector fit": (3, "<deflections --free muscles.*.modulus,offset --out >.yaml"),
    "continuum track": (3, "<mover --radius 5mm --frequency 5Hz --max-step 5ms --out >.csv"),
    "continuum estimate": (3, "<two_sections <rows --out >.csv"),
    "continuum sensors": (1, "<two_sections --count 2 --candidates 4 --out >.csv"),
    "continuum simulate": (3, "<mover <pulls --max-step 5ms --out >.csv"),
    "effector simulate": (3, "<arm <commands --out >.csv"),
    "effector track": (3, "<arm --radius 4mm --frequency 2Hz --plants 1 --out >.png"),
    "effector fabricate": (2, "--holder-diameter 11mm --out >"),
    "head show": (2, "--head <head --out >.png"),
    "head check": (2, "--head <head --samples 20 --out >.csv"),
    "head view": (2, "--head <head --samples 20 --out >.png"),
    "head reach": (3, "<plan <plan's_tract --head <head --samples 20 --spacing 6mm --out >.png"),
    "live": (2, "<tract --diameter 4mm --link 8mm --duration 0.1s --inserted 0.8"),
    "study run": (4, "<study --workers 1 --out >"),
    "study resume": (2, "<results --workers 1"),
    "study status": (2, "<results"),
    "study show": (3, "<results --out >.png"),
    "study export": (1, "<results --out >.csv"),
    "study jobs": (1, ""),
    "schema": (1, "robot --out >.json"),
    "completion": (1, "bash"),
    "doctor": (1, ""),
    "vision demo": (1, "--repeats 1 --steps 2 --out >"),
    "vision length": (
        4,
        "<pictures --board <strips --distance 300mm --height 3mm --diameter 2mm --ring 2mm "
        "--jobs 1 --out >",
    ),
    "vision plan-setup": (2, "--height 2.8mm --diameter 1.6mm --ring 2mm"),
    "vision shape": (4, "<pairs --cameras <cameras --jobs 1 --out >"),
    "vision board": (3, "charuco --out >.pdf"),
    "vision calibrate": (3, ". --board <board --jobs 1 --out >.yaml"),
    "vision track": (6, "<markers --cameras <cameras --jobs 1 --out >"),
}
REAL_TIME = {"rig emulate", "rig selftest", "cockpit"}
"""Commands that are left out: they run in real time."""
NEEDS_ROOM = {"head compare"}
"""Commands that are left out: no tube among the sound files is wide enough for what they do."""
CHANGES_INPUT = {"study resume"}
"""Commands that go on with what they are given."""
OUTPUTS = {"--out"}
UNITS = {
    "length": "mm", "force": "N", "pressure": "kPa", "angle": "deg", "time": "s", "rigidity":
    "Nmm^2", "stiffness": "N/mm", "line force": "N/mm", "compliance": "mm/N",
}  # fmt: skip
LOADS = ("at=30mm,force=0:0:-10mN,frame=body", "force=0:10mN:0", "moment=1Nmm:0:0,frame=world",
         "line=0:0:-1N/m,from=10mm,to=30mm", "line=0:0:-1N/m,from=30mm,to=10mm", "force=1:2",
         "at=-1mm,force=0:0:1N", "at=9m,force=0:0:1N", "force=nan:0:0", "force=1e30N:0:0", "at=1mm",
         "force=0:0:-1,frame=moon", "force=1N:0:0,force=1N:0:0", "force=1psi:0:0")  # fmt: skip
FREE = ("base", "base.position", "base.rotation.x", "sections.each.bending_stiffness",
        "tendons.*.stiffness", "tendons.T1.zero", "sections.9.bending_stiffness", "markers.m1",
        "commands.scale", "commands.backlash", "tendons.each.pretension", "base..x")  # fmt: skip
CHOSEN: dict[str, Sequence[str]] = {
    "--load": LOADS,
    "--tension": ("T1=1N", "T1=0.5N,T2=1N", "T1=-1N", "T1=1mm", "T9=1N", "T1=1e9N", "T1=nanN"),
    "--free": FREE,
    "--marker": ("m1=30mm,0mm,0mm,5mm", "m1=-3mm,0,0,0", "m1=1mm,2mm", "tip=30mm,0,0,0"),
    "--column": ("T1 tension [N]=T1 displacement [mm]", "a=b", "tip x [mm]=tip y [mm]"),
    "--history": ("T1=1mm", "T1=-1mm,T2=2mm", "T1=nan"),
}
"""Values of options that are text with a form of its own."""
FILE_OPTIONS = {
    "--robot": "robot", "--over": "tract", "--drives": "drives", "--obstacle": "obstacle",
    "--check": "rows", "--head": "head",
}  # fmt: skip
PAIRS = ("T1=2mm", "T1=2mm,T2=-1mm", "H1=1mm", "R=300kPa", "R=0.5,G=0.1", "A=0deg,B=90deg",
         "offset=3mm:5mm:3", "segments=12,15", "modulus=0.1MPa:2MPa", "pressure=kPa")  # fmt: skip


ELASTIC = """\
name: elastic
base_position: [0 mm, 0 mm, 5 mm]
base_rotation: [0 deg, 10 deg, 0 deg]
sections:
  - length: 60 mm
    radius: 3 mm
    discs: 6
    wire: {diameter: [[0 mm, 1 mm], [60 mm, 0.7 mm]], modulus: 60 GPa, density: 6450 kg/m^3}
    curvature: [0.1 deg/mm, 0 deg/mm, 0 deg/mm]
    line_weight: 0.02 N/m
    disc_weight: 1 mN
    tendons:
      - {name: T1, offset: 2 mm, angle: 0 deg, stiffness: 10 kN, pretension: 0.2 N}
      - {name: T2, offset: 2 mm, angle: 120 deg, stiffness: 10 kN, tension_limit: 20 N}
      - {name: T3, offset: 2 mm, angle: {start: 4, turns: 0.2}, stiffness: 10 kN, friction: 0.1}
  - length: 30 mm
    radius: 3 mm
    discs: 3
    bending_stiffness: [[0 mm, 200 N mm^2], [30 mm, 100 N mm^2]]
    torsional_stiffness: 150 N mm^2
    stretch_stiffness: 10 kN
    shear_stiffness: 4 kN
    tendons:
      - name: D1
        path: [[0 mm, 2 mm, 0 mm], [45 mm, 0 mm, 2 mm], [90 mm, 1 mm, 1 mm]]
        interpolation: cubic
        stiffness: 10 kN
"""
"""A robot with all that elastic models heed."""

STUDY = """\
format: bozzini-study-1
job: effector-design
fixed: {preset: prototype, deflection: 12 mm}
factors:
  offset: {range: [1 mm, 4.5 mm], scale: log}
  segments: {integers: [10, 20]}
  muscle.modulus: {normal: [0.56 MPa, 30 kPa], clip: [0.4 MPa, 0.7 MPa]}
"""
"""A study without its sampling."""


@dataclass(frozen=True)
class Case:
    """One command line in a folder of its own, and how its files were damaged."""

    number: int
    folder: Path
    command: str
    arguments: tuple[str, ...]
    damages: tuple[str, ...]

    @property
    def line(self) -> str:
        return "bozzini " + " ".join(map(ascii, self.arguments))


@dataclass
class Outcome:
    """What came of a case; `problems` is empty if all is right."""

    case: Case
    code: int
    seconds: float
    memory: float
    message: str
    problems: list[str] = field(default_factory=list)


def find_commands() -> dict[str, click.Command]:
    """Return every command that is no group, by its whole name."""
    from bozzini.cli.main import root

    def walk(group: click.Group, name: str) -> Iterator[tuple[str, click.Command]]:
        context = click.Context(group)
        for word in group.list_commands(context):
            command = group.get_command(context, word)
            assert command is not None
            if isinstance(command, click.Group):
                yield from walk(command, f"{name} {word}")
            else:
                yield f"{name} {word}".strip(), command

    return dict(walk(root, ""))


ARM = """kind: bozzini-effector
version: 1
muscles:
- {name: A, muscle: {length: 100.0, outer_radius: 2.0}, angle: 0.0}
- {name: B, muscle: {length: 100.0, outer_radius: 2.0}, angle: 2.1}
- {name: C, muscle: {length: 100.0, outer_radius: 2.0}, angle: 4.2}
section: {offset: 6.0, backbone_length: 100.0, flexural_rigidity: 20000.0}
motion: {fill_lag: 0.2, bleed_lag: 0.3, play_radii: [0.01], play_weights: [0.4], creep_share: 0.1}
pulls:
- {area: 20.0, stiffening: 3.0}
- {area: 24.0, stiffening: 2.0}
- {area: 18.0, stiffening: 4.0}
intervals: {"muscles.each.area[A]": [20.0, 19.0, 21.0], "muscles.each.area[B]": [24.0, 23.0, 25.0],
  "muscles.each.area[C]": [18.0, 17.0, 19.0], motion.fill_lag: [0.2, 0.18, 0.22]}
"""
"""A fitted end-effector."""


def make_originals(folder: Path) -> None:
    """Write the sound files that the cases damage."""
    import numpy as np
    import trimesh
    from scipy.io import savemat
    from skimage.measure import marching_cubes

    from bozzini.cli.main import main
    from bozzini.head import Head, write_head
    from bozzini.muscle import EndEffects, MuscleFile, preset, write_muscle
    from bozzini.muscle.loops import fit_loop, read_loop, save_loop_model
    from bozzini.vision import CameraSet, CharucoBoard, PairLayout, StripBoard
    from tests.cli.plan_cases import write_volume
    from tests.shapes import bend_curve, curve_distance

    curve = bend_curve(20.0, 1.2, 12.0)
    low, high = curve.min(axis=0) - 10.0, curve.max(axis=0) + 10.0
    axes = [np.arange(a, b, 2.0) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = curve_distance(curve, 6.0)(points)
    vertices, faces, _, _ = marching_cubes(distance, level=0.0, spacing=(2.0,) * 3)
    mesh = trimesh.Trimesh(vertices, faces)
    for suffix in ("stl", "ply", "obj", "glb", "off"):
        mesh.export(folder / f"tube.{suffix}")
    lines = ["# vtk DataFile Version 3.0", "tube", "ASCII", "DATASET POLYDATA"]
    lines += [f"POINTS {len(vertices)} float", *(" ".join(map(str, v)) for v in mesh.vertices)]
    lines += [f"POLYGONS {len(faces)} {4 * len(faces)}"]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    (folder / "tube.vtk").write_text("\n".join(lines) + "\n")
    labels = np.where(distance < 0.0, np.where(points[..., 2] < 10.0, 1, 2), 0).astype(np.uint8)
    write_volume(folder / "tube.nii.gz", np.minimum(labels, 1), 2.0)
    write_volume(folder / "tube.nii", labels, 2.0)  # two labels: refused without --labels
    noise = np.random.default_rng(0).normal(0.0, 20.0, distance.shape)
    body = np.where(distance < 0.0, -1000.0, 40.0) + noise
    body = np.pad(body, 6, constant_values=40.0)  # or the wall is too thin for a body
    write_volume(folder / "ct.nii.gz", np.pad(body, 3, constant_values=-1000.0).astype("i2"), 2.0)
    pressure = np.linspace(0.0, 0.8, 12)
    rows = [f"{1000 * p:g},{12 * p / (p + 0.4):.4f}" for p in pressure]
    (folder / "table.csv").write_text("\n".join(["pressure [kPa],contraction [mm]", *rows]) + "\n")
    muscle = MuscleFile(muscle=preset("effector-45"), model="energy", ends=EndEffects(offset=0.1))
    for suffix in ("yaml", "json"):
        write_muscle(folder / f"muscle.{suffix}", muscle)
    table, fit = str(folder / "table.csv"), str(folder / "fit.yaml")
    main(["muscle", "fit", table, "--free", "modulus", "--out", fit])
    loops = np.interp(np.arange(200.0), np.arange(0.0, 201.0, 40.0), [0, 600, 100, 500, 0, 400])
    lagging = np.convolve(loops, [0.5, 0.3, 0.2])[:200]
    loop = np.column_stack([np.arange(200.0), loops, 0.01 * lagging])
    header = "time [s],pressure [kPa],contraction [mm]"
    np.savetxt(folder / "loop.csv", loop, delimiter=",", header=header, comments="", fmt="%.6g")
    fitted = fit_loop(read_loop(folder / "loop.csv"), "prandtl-ishlinskii")
    save_loop_model(folder / "loop.yaml", fitted.model)
    main(["hysteresis", "fit", str(folder / "loop.csv"), "--out", str(folder / "law.yaml")])
    pair = PairLayout(size=(640, 400)).make_cameras()
    cameras = CameraSet(names=("left", "right"), cameras=pair, resamples=(pair, pair))
    for suffix in ("yaml", "json"):
        cameras.save(folder / f"cameras.{suffix}")
    CharucoBoard().save(folder / "board.yaml")
    StripBoard().save(folder / "strips.yaml")
    # Pictures that are not there are rows with a reason.
    (folder / "pictures.csv").write_text("image,pressure_kpa\na.png,0\nb.png,100\n")
    (folder / "pairs.csv").write_text("left,right,pose\na.png,b.png,1\nc.png,,2\n")
    s = np.linspace(0.0, 60.0, 61)
    way = np.column_stack([8.0 * np.sin(s / 25.0) ** 2, 0.0 * s, s])
    np.savetxt(folder / "way.csv", way, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    pulls = [f"{pull},{-pull / 2},{-pull / 2},0,0,0,{pull},5,95" for pull in (0, 0.5, 1, 1.5)]
    titles = [f"T{k} displacement [mm]" for k in range(1, 7)] + [f"tip {a} [mm]" for a in "xyz"]
    deflections = ["R pressure [kPa],lateral [mm]", "300,10", "400,13", "500,15.5", "689,20.4"]
    (folder / "deflections.csv").write_text("\n".join(deflections) + "\n")
    (folder / "commands.csv").write_text(
        "time [s],A pressure [kPa],B pressure [kPa],C pressure [kPa]\n0,0,0,0\n0.5,300,100,0\n"
    )
    (folder / "arm.yaml").write_text(ARM)
    heavy = ELASTIC.replace(
        "    bending_stiffness:", "    disc_weight: 1 mN\n    bending_stiffness:"
    )
    (folder / "mover.yaml").write_text(heavy)
    (folder / "pulls.csv").write_text("time [s],T1 tension [N]\n0,0\n0.02,1\n0.05,0.5\n")
    write_head(folder / "head.yaml", Head())
    (folder / "rows.csv").write_text("\n".join([",".join(titles), *pulls]) + "\n")
    seen = np.hstack([each.project(np.linspace([0, 0, 10], [9, 5, 30], 9)) for each in pair])
    rows = [",".join(f"{value:.2f}" for value in row) for row in seen]
    (folder / "markers.csv").write_text("\n".join(["Lx1,Ly1,Rx1,Ry1", *rows]) + "\n")
    time = np.linspace(0.0, 2.0, 60)
    curve = np.column_stack([time, 600.0 * np.minimum(time, 1.0) * (2.0 - np.minimum(time, 1.0))])
    np.savetxt(folder / "curve.csv", curve, delimiter=",", header="time,pressure", comments="")
    savemat(folder / "curve.mat", {"data": curve})
    for name in EXAMPLE_ROBOTS:
        shutil.copy(EXAMPLES / name, folder / name)
    (folder / "elastic.yaml").write_text(ELASTIC)
    drawn = "sampling: {method: sobol, count: 50, seed: 1}\nchunk: 20\n"
    (folder / "study.yaml").write_text(STUDY + drawn)
    (folder / "saltelli.yaml").write_text(
        STUDY.replace("1 mm, 4.5", "3 mm, 4.5")
        + "sampling: {method: saltelli, count: 16}\noutputs: [area]\n"
    )
    least = "search: {minimise: [needed_pressure], evaluations: 60}\n"
    (folder / "search.yaml").write_text(STUDY + least)
    (folder / "options.yaml").write_text("{inflate: 0.5 mm, method: tube, angle_limit: 60 deg}\n")
    names = [*(f"T{k}_mm" for k in range(1, 7)), "D1_mm"]
    rows = [f"{4 * n},{n / 10},{-n / 20},{-n / 20},0,0,0,0" for n in range(6)]
    (folder / "drives.csv").write_text("\n".join([",".join(["base_advance_mm", *names]), *rows]))
    here = Path.cwd()
    os.chdir(folder)
    try:
        with _quiet():
            plan = ["--diameter", "5mm", "--link", "8mm", "--head-step", "1mm", "--out", "made"]
            assert main(["plan", "tube.stl", *plan]) in (0, 1)
            run = ["rig", "run", "--board", "native", "--duration", "0.3s", "--out", "log.csv"]
            assert main(run) == 0
            for suffix in ("json", "yaml"):
                fit = ["duct", "fit", "tube.stl", "--pieces", "6", "--out", f"shapes.{suffix}"]
                assert main(fit) in (0, 1)
            study = ["study", "run", "study.yaml", "--workers", "1", "--out", "results"]
            assert main(study) == 0
    finally:
        os.chdir(here)
    shutil.move(folder / "made" / "plan.npz", folder / "plan.npz")
    shutil.rmtree(folder / "made")


def run_sound(folder: Path, commands: dict[str, click.Command]) -> list[str]:
    """Run every command on sound files, which also compiles; return what is wrong with them."""
    from bozzini.cli.main import main

    wrong = []
    lines = [
        (name, line) for name in commands if name in LEGAL for line in LEGAL[name][1].split("|")
    ]
    for name, line in lines:
        words = []
        for word in _split(line):
            if word.startswith("<"):
                word = str(folder / FILES[word[1:].replace("_", " ")][0])
            words.append("out" + word[1:] if word.startswith(">") else word)
        with tempfile.TemporaryDirectory() as place, _quiet():
            os.chdir(place)
            code = main([*name.split(), *words])
            os.chdir(folder)
        if code not in (0, 1) and name not in ("data fetch", "vision calibrate"):
            wrong.append(f"bozzini {name} {' '.join(words)}: exit code {code}")
    return wrong


def make_case(
    number: int, seed: int, originals: Path, place: Path, commands: dict[str, click.Command]
) -> Case:
    """Make one case from its number and the seed alone."""
    rng = random.Random(f"{seed}:{number}")
    folder = place / f"case-{number}"
    folder.mkdir()
    names = [name for name in commands if name in LEGAL]
    name = rng.choices(names, [LEGAL[name][0] for name in names])[0]
    damages: list[str] = []
    words = []
    wrecked = rng.random() < 0.7  # a file is damaged, or else it is only the options
    for word in _split(rng.choice(LEGAL[name][1].split("|"))):
        if word.startswith("<"):
            word = _take(word[1:], rng, originals, folder, damages, damaged=wrecked)
        elif word.startswith(">"):
            word = "out" + word[1:]
        words.append(word)
    options = [item for item in commands[name].params if isinstance(item, click.Option)]
    count = rng.choice([0, 0, 1, 2]) if damages else rng.choice([1, 1, 2, 3])
    for option in rng.choices(options, k=count):
        _add_option(option, words, rng, originals, folder, damages)
    if rng.random() < 0.05:
        words.insert(rng.randint(0, len(words)), rng.choice(WORDS))
    if rng.random() < 0.05 and words:
        del words[rng.randrange(len(words))]
    if rng.random() < 0.1:
        _repeat(options, words, rng, damages)
    if rng.random() < 0.25:
        words.append("--json")
    if rng.random() < 0.05:
        _write_over_input(words, rng)
    if rng.random() < 0.04:
        (folder / "out").mkdir()
        (folder / "out" / "mine.txt").write_text("mine")
    arguments = [word.replace("\0", "") for word in (*name.split(), *words)]
    return Case(number, folder, name, tuple(arguments), tuple(damages))


TWO_VALUES = "two values of one option"
"""What is not legal, whatever the values are."""


def _repeat(
    options: list[click.Option], words: list[str], rng: random.Random, damages: list[str]
) -> None:
    """Give an option that is there once more."""
    flags = {flag: item for item in options for flag in item.opts if not item.is_flag}
    known = [flag for flag in (word.partition("=")[0] for word in words) if flag in flags]
    if not known:
        return
    flag = rng.choice(known)
    option = flags[flag]
    unit = UNITS.get(getattr(option.type, "kind", None) or option.type.name, "")
    differs = repeat_option(words, flag, rng, unit)
    is_list = isinstance(option.type, LabelsType) or (option.metavar or "").endswith(",...")
    if differs and not (option.multiple or is_list or "--" in words):
        damages.append(TWO_VALUES)


def _split(text: str) -> list[str]:
    return text.replace("<tract or shapes", "<tract_or_shapes").replace("> ", ">").split()


def _take(
    kind: str, rng: random.Random, originals: Path, folder: Path, damages: list[str], *,
    damaged: bool,
) -> str:  # fmt: skip
    """Copy a sound file of a kind into the folder, damage it, and return its name."""
    source = originals / rng.choice(FILES[kind.replace("_", " ")])
    suffix = "".join(source.suffixes)
    stem = rng.choice(["x", "x", "x", "x", "é b", "日本", "\udcff\udcfe", "-x", "{}"])
    target = folder / f"{stem}{len(damages)}{suffix}"
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copy(source, target)
    if damaged:
        inside = sorted(path for path in target.rglob("*") if path.is_file())
        damages.append(damage(rng.choice(inside or [target]), rng))
    return f"./{target.name}"


def _write_over_input(words: list[str], rng: random.Random) -> None:
    """Let the output be a file that is given, or its folder."""
    given = [word for word in words if word.startswith("./")]
    if given and "--out" in words[:-1]:
        target = rng.choice(given)
        words[words.index("--out") + 1] = rng.choice([target, target, f"no/../{target}", "."])
        words.append("--force")


def _add_option(
    option: click.Option, words: list[str], rng: random.Random, originals: Path, folder: Path,
    damages: list[str],
) -> None:  # fmt: skip
    """Set an option to something; one that is there already is mostly replaced."""
    flag = rng.choice([*option.opts, *option.secondary_opts])
    if flag in ("--help", "-h", "--debug", "--open"):
        return
    if option.is_flag or option.count:
        words.append(flag)
        return
    kind = option.type
    unit = UNITS.get(getattr(kind, "kind", None) or kind.name, "")
    if isinstance(kind, click.Choice):
        value = str(rng.choice([*kind.choices, *kind.choices, rng.choice(WORDS)]))
    elif flag in OUTPUTS:
        value = rng.choice(
            ["out", "out.png", "out.csv", "out.json", "out.stl", "out.nii.gz", "no/out.csv", ".",
             "..", "/dev/null", "/proc/x", "\udcff.png", "out/", rng.choice(WORDS)]
        )  # fmt: skip
    elif flag in ("--steps", "--repeats"):
        value = rng.choice(["1", "3", "0", "-2", "1.5", *WORDS])
    elif flag in ("--duration", "--hold"):  # any other would be simulated, however long
        value = rng.choice(["0.1s", "30 ms", "0", "-1s", "1e9s", "5parsec", *WORDS])
    elif flag in FILE_OPTIONS:
        damaged = rng.random() < 0.7
        value = _take(FILE_OPTIONS[flag], rng, originals, folder, damages, damaged=damaged)
    elif flag in CHOSEN and rng.random() < 0.8:
        value = rng.choice(CHOSEN[flag])
    elif isinstance(kind, click.types.IntParamType):
        value = rng.choice([make_number(rng), "0", "1", "2", "3", "7", "20", "-1", "100000"])
    elif kind.name == "text" and rng.random() < 0.5:
        value = rng.choice([*PAIRS, "m", "energy", "tube", "follow", "thesis", "gaylord"])
    elif "," in kind.name and rng.random() < 0.8:
        size = kind.name.count(",") + 1
        simple = rng.random() < 0.7
        value = ",".join(
            f"{rng.gauss(0.0, 30.0):.3g}{unit}" if simple else make_value(rng, unit)
            for _ in range(size)
        )
    else:
        value = make_value(rng, unit)
    if flag in words and rng.random() < 0.8:
        at = words.index(flag) + 1
        words[at : at + 1] = [value]
    elif rng.random() < 0.5 and flag.startswith("--"):
        words.append(f"{flag}={value}")
    else:
        words += [flag, value]


def run_case(case: Case, seconds: int) -> int:
    """Start a case in a process of its own; return the number of that process."""
    process = os.fork()
    if process:
        return process
    code = 99
    try:
        os.setsid()
        os.chdir(case.folder)
        logs = case.folder.with_suffix(".log")
        logs.mkdir()
        for descriptor, name in ((1, "stdout"), (2, "stderr")):
            file = os.open(logs / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, descriptor)
            os.close(file)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        (logs / "tmp").mkdir()
        tempfile.tempdir = str(logs / "tmp")
        now = (
            int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0])
            * resource.getpagesize()
        )
        resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, now + MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.alarm(10 * seconds)
        from bozzini.cli.main import main

        code = main(case.arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def judge(
    case: Case, status: int, usage: resource.struct_rusage, before: dict[str, bytes]
) -> Outcome:
    """Compare what a case did with what it must do."""
    logs = case.folder.with_suffix(".log")
    out = (logs / "stdout").read_text(encoding="utf-8", errors="replace")
    err = (logs / "stderr").read_text(encoding="utf-8", errors="replace")
    code = os.waitstatus_to_exitcode(status)
    seconds = usage.ru_utime + usage.ru_stime
    lines = err.splitlines()
    errors = [line for line in lines if line.startswith("bozzini: error")]
    outcome = Outcome(case, code, seconds, usage.ru_maxrss * 1024.0, (errors or lines or [""])[-1])
    add = outcome.problems.append
    if code == -signal.SIGXCPU or code == -signal.SIGALRM:
        add("too long")
    elif code not in (0, 1, 2):
        add(f"exit code {code}")
    elif len(errors) != (code == 2):
        add(f"exit code {code} with {len(errors)} lines of error")
    if code in (0, 1):
        for damage_done in case.damages:
            if damage_done == TWO_VALUES or damage_done.endswith(f": {UNTITLED}"):
                add(f"exit code {code} with {damage_done}")
    if "Traceback" in err:
        add("traceback")
    stray = [line for line in lines if not line.startswith(("bozzini: ", "note: "))]
    if stray:
        add(f"on stderr: {stray[0][:80]}")
    if "not enough memory" in err or outcome.memory > MEMORY:
        add(f"more than {MEMORY / 1e9:g} GB")
    # After -- it is no flag, or -- is the value of an option.
    if "--json" in case.arguments and "--" not in case.arguments and code in (0, 1, 2):
        try:
            json.loads(out)
        except ValueError:
            add("stdout is no JSON")
    after = _list_files(case.folder)
    changed = any(after.get(name) != content for name, content in before.items())
    if changed and case.command not in CHANGES_INPUT:
        add("an input was changed")
    new = sorted(set(after) - set(before))
    if code == 2 and new:
        add(f"exit code 2, but wrote {new[0]}")
    left = [name for name in new if any(part.startswith(".") for part in Path(name).parts)]
    left += [path.name for path in (logs / "tmp").iterdir()]
    if left:
        add(f"left {left[0]}")
    return outcome


def _list_files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): b"" if path.is_dir() else path.read_bytes()
        for path in folder.rglob("*")
    }


def _load_everything() -> None:
    """Import what the commands import when they run, once for all cases."""
    import importlib
    import pkgutil

    import matplotlib.backends.backend_agg
    import matplotlib.pyplot  # noqa: F401

    import bozzini
    from bozzini.units import parse_quantity

    parse_quantity("5mm", "length")
    for module in pkgutil.walk_packages(bozzini.__path__, "bozzini."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    # A browser needs more memory than a case may have.
    importlib.import_module("bozzini.scene.film").BROWSERS = ()


class _quiet:  # noqa: N801
    """Send stdout and stderr of this process to nothing meanwhile."""

    def __enter__(self) -> None:
        sys.stdout.flush()
        self.saved = [os.dup(1), os.dup(2)]
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        os.close(nothing)

    def __exit__(self, *_: object) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        for number, descriptor in enumerate(self.saved, start=1):
            os.dup2(descriptor, number)
            os.close(descriptor)


def run_cases(
    numbers: Sequence[int],
    seed: int,
    place: Path,
    *,
    jobs: int = 1,
    seconds: int = 30,
    sound: bool = True,
    only: str = "",
) -> Iterator[Outcome]:
    """Run cases, `jobs` at a time, after every command on sound files if `sound`.

    `seconds` is how much time of a processor each may take; `only` is how names of the commands
    begin.
    """
    commands = find_commands()
    missing = sorted(set(commands) - set(LEGAL) - REAL_TIME - NEEDS_ROOM)
    if missing:
        raise SystemExit(f"fuzz: no legal command line is known for: {', '.join(missing)}")
    commands = {name: command for name, command in commands.items() if name.startswith(only)}
    originals = place / "originals"
    if not originals.exists():
        originals.mkdir(parents=True)
        process = os.fork()  # so that no threads run in the process that is forked for the cases
        if not process:
            code = 1
            try:
                make_originals(originals)
                wrong = run_sound(originals, commands) if sound else []
                for line in wrong:
                    print(f"fuzz: {line}", file=sys.stderr)
                code = int(bool(wrong))
            except BaseException:
                import traceback

                traceback.print_exc()
            finally:
                os._exit(code)
        if os.waitpid(process, 0)[1]:
            raise SystemExit("fuzz: sound files and options are refused")
    _load_everything()
    running: dict[int, tuple[Case, dict[str, bytes]]] = {}
    waiting = iter(numbers)
    while True:
        while len(running) < jobs:
            number = next(waiting, None)
            if number is None:
                break
            case = make_case(number, seed, originals, place, commands)
            before = _list_files(case.folder)
            sys.stdout.flush()
            running[run_case(case, seconds)] = (case, before)
        if not running:
            return
        process, status, usage = os.wait3(0)
        if process in running:
            case, before = running.pop(process)
            yield judge(case, status, usage, before)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description=__doc__.split("\n")[0]
    )
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help='how commands begin, such as "continuum"')
    parser.add_argument("--case", type=int, help="repeat this one and show what it says")
    parser.add_argument("--jobs", type=int, default=min(os.cpu_count() or 1, 4))
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    parser.add_argument("--seconds", type=int, default=30, help="processor time for each case")
    parser.add_argument("--skip-sound", action="store_true", help="no sound files at first")
    parser.add_argument("--verbose", action="store_true", help="show what every case says")
    given = parser.parse_args()
    numbers = range(given.count) if given.case is None else [given.case]
    codes: dict[str, Counter[str]] = {}
    failures: dict[tuple[str, str], list[Outcome]] = {}
    slowest = largest = 0.0
    done = 0
    with tempfile.TemporaryDirectory(prefix="bozzini-fuzz-") as name:
        place = Path(name).resolve()
        sound = given.case is None and not given.skip_sound
        for outcome in run_cases(
            numbers,
            given.seed,
            place,
            jobs=given.jobs,
            seconds=given.seconds,
            sound=sound,
            only=given.only,
        ):
            case = outcome.case
            done += 1
            slowest, largest = max(slowest, outcome.seconds), max(largest, outcome.memory)
            codes.setdefault(case.command, Counter())[str(outcome.code)] += 1
            if given.verbose:
                print(f"{case.number}: {outcome.code} {outcome.seconds:.1f} s {case.line[:300]}")
                print(f"    {outcome.message[:300]!a}")
            if outcome.problems or given.case is not None:
                kept = given.keep / f"seed-{given.seed}-case-{case.number}"
                shutil.rmtree(kept, ignore_errors=True)
                shutil.copytree(case.folder, kept, ignore_dangling_symlinks=True)
                print(f"case {case.number}: {'; '.join(outcome.problems) or 'right'}", flush=True)
                print(f"  in {kept}: {case.line}")
                print(f"  files: {', '.join(case.damages) or 'sound'}")
                print(f"  said: {outcome.message[:300]!a}")
                print(f"  again: make fuzz SEED={given.seed} CASE={case.number}", flush=True)
            if outcome.problems:
                failures.setdefault((case.command, outcome.problems[0]), []).append(outcome)
            shutil.rmtree(case.folder, ignore_errors=True)
            shutil.rmtree(case.folder.with_suffix(".log"), ignore_errors=True)
            if done % 50 == 0:
                print(f"{done} cases", flush=True)
    for command, counts in sorted(codes.items()):
        print(f"{command:<30} {dict(sorted(counts.items()))}")
    wrong = sum(map(len, failures.values()))
    print(
        f"{done} cases of seed {given.seed}: {done - wrong} right, {wrong} wrong; "
        f"at most {slowest:.1f} s of processor time and {largest / 1e9:.2f} GB"
    )
    for (command, problem), found in sorted(failures.items()):
        numbers_shown = ", ".join(str(item.case.number) for item in found[:8])
        print(f"  {command}: {problem}: {len(found)} (cases {numbers_shown})")
    return 1 if wrong else 0


if __name__ == "__main__":
    os.environ.setdefault("MPLBACKEND", "Agg")
    sys.exit(main())
