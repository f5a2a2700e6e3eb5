"""The commands of ``bozzini`` whose answers are recorded, in brief.

``python -m tests.cli.recorded_commands`` records the answers of this version in
``recorded_commands.json``, with words after it only of the commands that begin with one of them;
the test beside compares.
"""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from tests.cli.plan_cases import CURVE, write_scan, write_tracts

RECORDS = Path(__file__).with_name("recorded_commands.json")
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

COMMANDS = """
muscle solve effector-45 --pressure 100psi --load 1N
muscle solve effector-45 --model thesis --pressure 100psi
muscle solve effector-45 --model thesis --load-path bulk --pressure 100psi --load 1N
muscle solve --pressure 0.6MPa --ends trellis
muscle solve --pressure 0.6MPa --friction-length 20um --direction inflating
muscle solve --pressure 0.6MPa --load 1000N
muscle solve --pressure 0.6MPa --model davis
muscle solve --model kothera-balance --pressure 0.5MPa --load 0.2N
muscle solve --model tondu-lopez --pressure 0.5MPa --set kappa1=0.1 --set kappa2=1
muscle solve --model schulte --pressure 0.5MPa
muscle solve --model thesis --pressure 0.5MPa --load 1N
muscle curve --of force --pressure 700kPa --points 5
muscle curve --of contraction --load 0.5N --points 5
muscle curve --of angle --model thesis --points 5
muscle curve --of phases --points 5
muscle curve --model tondu-lopez --set kappa1=-0.5 --set kappa2=1.2 --points 5
muscle models
muscle models chou
muscle models energy
muscle models nobody
muscle fit thesis-45 data.csv --free modulus,dead-length
muscle fit thesis-45 data.csv --model sangian
muscle fit thesis-45 data.csv --free gap,braid-angle --bound gap=0mm:0.1mm --anyway
muscle compare thesis-45 data.csv --model energy --model thesis
muscle compare thesis-45 data.csv --model energy --model chou --fit
muscle compare data.csv --model energy --model tondu-lopez --fit --by cv --folds 3
effector pose --pressure R=689.4kPa,G=413.6kPa
effector pose --pressure R=689.4kPa,G=413.6kPa --method thesis --order G,R
effector pose --pressure R=689.4kPa --model thesis --load-path bulk --table
effector pose --pressure R=300kPa --model chou
effector pose --pressure Q=1kPa
effector reach --to 12mm,-5mm --beam 2
effector reach --to 3mm,-4mm
effector reach --to 3mm,-4mm --model thesis --load-path bulk
effector reach --to 3mm,-4mm --model gaylord-1
effector reach --to 300mm,0mm
effector workspace
effector workspace --of force --at 2mm,1mm
effector curve --points 7
effector curve --points 7 --cubic-from 250kPa
effector trace --radius 8mm --points 12
effector trace --from 0,0 --to 9mm,3mm --points 5 --cubic-from 250kPa
effector sweep --vary offset=2.75mm:4mm:3 --vary segments=12,15 --deflection 12mm
effector least-pressure --between offset=2.75mm:3.5mm --deflection 12mm
effector sweep --vary muscle.gap=0mm,9mm
head show
head check --samples 40
head view --samples 40
head view --effector 2
demo --voxel 4mm --seed -1 --out demo
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --organ colon --out way
plan tube.stl --diameter 5mm --link 8mm --head-step 1mm --organ colon --method tube --out way
plan tube.nii.gz --diameter 5parsec --out way
plan tube.nii.gz --diameter 0mm --out way
plan tube.nii.gz --start nowhere --out way
plan none.stl --out way
plan tube.stl --unit kg --out way
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --organ colon --method tube \
--out way && certify way/plan.npz tube.nii.gz --independent
plan tube.nii.gz --robot helical.yaml --organ colon --out way
plan tube.nii.gz --robot converging.yaml --organ colon --out way
phantom --voxel 4mm --out new.stl
phantom --voxel 4mm --seed 3 --out new.nii.gz
phantom --voxel 9mm --out new.stl
phantom --voxel 4mm --out phantom.stl
segment ct.nii.gz --out gas.nii.gz
segment ct.nii.gz --out gas.nii.gz --threshold -700 --seed 85mm,60mm,60mm
segment ct.nii.gz --out gas.nii.gz --seed 60mm,60mm,5mm
segment ct.nii.gz --out gas.nii.gz --bridge-fluid
segment tube.nii.gz --out gas.nii.gz
certify data.csv
duct fit tube.stl --pieces 0
duct show cones.json --out cones.svg
duct show cones.json --over tube.stl
duct show tube.nii.gz --organ colon --spacing 5mm --out tube.png
duct show cones.json --reverse
duct limits cones.json --labels 1
continuum pose two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm,T4=1mm,T5=1mm,T6=-2mm \
--out pose.csv
continuum pose two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm --model linkage \
--segments 20 --out pose.png
continuum pose two_sections.yaml --displacement T1=2.1mm,T2=-1mm,T3=-1mm --tolerance 0.1mm
continuum pose two_sections.yaml --displacement T1=2.1mm,T2=-1mm,T3=-1mm
continuum pose two_sections.yaml --displacement T1=20mm,T2=-10mm,T3=-10mm
continuum pose two_sections.yaml --displacement T9=1mm
continuum pose colonoscope.yaml \
--displacement up=10mm,down=-10mm,left1=2mm,right1=-2mm,left=2mm,right=-2mm
continuum pose converging.yaml --displacement C1=2mm,C2=-3mm,C3=-3mm
continuum pose converging.yaml --displacement C1=2mm,C2=-3mm,C3=-3mm --model rod
continuum pose converging.yaml --displacement C1=2mm,C2=-3mm,C3=-3mm --model arc
continuum pose helical.yaml --displacement H1=2mm,H2=-5mm,H3=-5mm,H4=-5mm
continuum pose gastroscope.yaml --displacement s17a=2mm,s17b=-1mm,s17c=-1mm
continuum simulate moving.yaml pulls.csv --damping-time 5ms --load force=0:10mN:0 --out motion.csv
continuum simulate moving.yaml pulls.csv --tip-weight 20mN --segment-kind arc --out motion.png
continuum simulate two_sections.yaml pulls.csv
continuum track two_sections.yaml --radius 5mm
continuum predict two_sections.yaml pulls.csv
continuum estimate two_sections.yaml pulls.csv
continuum sensors two_sections.yaml --kind curvature --count 2 --candidates 4 --out sensors.csv
continuum reach two_sections.yaml --to 300mm,0mm,0mm --starts 2
continuum reach colonoscope.yaml --to 60mm,20mm,100mm
continuum reach gastroscope.yaml --to 100mm,50mm,600mm --starts 1
continuum reach helical.yaml --to 30mm,10mm,90mm
continuum compare two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm --out compare.csv
continuum compare two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm --tip-force 0,20mN,0 \
--tendon-stiffness 10kN
continuum compare converging.yaml --displacement C1=2mm,C2=-3mm,C3=-3mm --out compare.png
continuum compare helical.yaml --displacement H1=2mm,H2=-5mm,H3=-5mm,H4=-5mm
continuum compare colonoscope.yaml --displacement up=10mm,down=-10mm,up1=2mm,down1=-2mm
continuum workspace two_sections.yaml --count 2000 --out map.csv
continuum workspace two_sections.yaml --count 1000 --seed 1 --cell 8mm --bend-cap 90deg \
--in-space --directions 20 --out map.png
continuum workspace two_sections.yaml --count 1000 --at 20mm,10mm,90mm --directions 10
continuum workspace colonoscope.yaml --count 1000
continuum workspace gastroscope.yaml --count 1000
continuum workspace helical.yaml --count 1000
continuum workspace two_sections.yaml --count 0
data list
data fetch nothing --to folder
"""
"""One command a line; ``--json`` is added. Of several, joined by ``&&``, the last is recorded."""

SLOW_COMMANDS = """
continuum pose two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm --model energy \
--segment-kind arc --between 1
continuum pose two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm \
--line-force 0,-0.0001N/mm,0 --tendon-stiffness 10kN
continuum reach two_sections.yaml --to 20mm,10mm,95mm --smallest-bends --starts 4
plan tube.nii.gz --diameter 18mm --link 8mm --organ colon --out way
duct fit tube.stl --organ colon --max-error 0.5mm --out fit.json
duct fit tube.nii.gz --organ colon --as cylinders --out fit.yaml
duct limits tube.nii.gz --organ colon --diameter 30mm --link 5mm
continuum pose two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm --model energy \
--segment-kind channel
continuum pose two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm --model rod --steps 300
continuum pose two_sections.yaml --displacement T1=2mm,T2=-1mm,T3=-1mm --tip-force 0,20mN,0 \
--tendon-stiffness 10kN
continuum reach two_sections.yaml --to 30mm,10mm,90mm --direction 1,0,1 --out reach.png
demo --voxel 4mm --diameter 5mm --out demo
plan tube.stl --diameter 5mm --link 8mm --head-step 1mm --organ colon --method thesis --out way
duct limits tube.stl --organ colon --diameter 6mm --voxel 1.5mm
continuum reach two_sections.yaml --to 30mm,10mm,90mm --out reach.csv
demo --voxel 3mm --diameter 6mm --seed 3 --out demo
demo --voxel 4mm --diameter 8mm --out demo
demo --voxel 3mm --robot gastroscope.yaml --diameter 5mm --out demo
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --organ colon --method follow \
--reverse --out way
plan tube.nii.gz --diameter 5mm --link 60mm --organ colon --head-step 1mm --method tube --out way
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --organ colon --method tube \
--out way && certify way/plan.npz
plan tube.stl --diameter 5mm --link 8mm --head-step 1mm --organ colon --method tube \
--inflate 1mm --out way && certify way/plan.npz tube.stl
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --organ colon --method tube \
--out way && certify way/plan.npz tube.stl
plan phantom.nii.gz --labels 1,2,3 --diameter 12mm --organ upper-tract --out way
plan phantom.nii.gz --labels 2 --diameter 6mm --inflate 2mm --organ upper-tract --frame RAS \
--out way
plan phantom.nii.gz --labels 1,2,3 --start 1 --end 2 --via 2 --diameter 6mm --head-step 1mm \
--out way
plan phantom.stl --diameter 5mm --voxel 2mm --organ upper-tract --out way
plan phantom.stl --diameter 11mm --voxel 2mm --inflate 3mm --head-step 1mm --organ upper-tract \
--out way
plan phantom.stl --diameter 11mm --voxel 2mm --soft-wall 3mm --head-step 1mm \
--organ upper-tract --out way
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --out way
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --via 18mm,12mm,50mm --organ colon \
--label-error 5mm --out way
plan halves.nii.gz --labels 1,2 --start 1 --end 2 --diameter 5mm --link 8mm --head-step 1mm \
--out way
plan halves.nii.gz --labels all --diameter 5mm --link 8mm --head-step 1mm --organ colon \
--route in-out-in --slip 0.5 --out way
plan open.stl --start largest-opening --diameter 5mm --link 8mm --head-step 1mm --out way
plan tube.stl --part 1 --repair --frame LPS --diameter 5mm --link 8mm --length 60mm \
--head-step 1mm --organ colon --out way
plan tube.stl --unit cm --voxel 8mm --diameter 50mm --link 80mm --head-step 10mm --organ colon \
--out way
plan tube.stl --diameter 5mm --link 8mm --head-step 1mm --organ colon --angle-limit 10deg --out way
plan tube.stl --diameter 17mm --link 8mm --head-step 1mm --organ colon --soft-wall 2mm --out way
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --organ colon --largest --out way
plan tube.nii.gz --diameter 5mm --link 8mm --head-step 1mm --organ colon --compare --export \
--out way
plan tube.nii.gz --robot arm.yaml --head-step 1mm --organ colon --out way
plan tube.nii.gz --robot short.yaml --head-step 1mm --organ colon --out way
plan tube.nii.gz --robot two_sections.yaml --head-step 1mm --organ colon --out way
plan tube.nii.gz --robot colonoscope.yaml --diameter 8mm --organ colon --out way
plan tube.stl --unit cm --voxel 8mm --robot colonoscope.yaml --head-step 5mm --organ colon --out way
duct fit tube.nii.gz --organ colon --as superellipsoids --pieces 4 --out fit.json
duct fit tube.stl --organ colon --max-error 0.01mm --pieces 12 --least-squares --out fit.json
duct fit tube.stl --organ colon --pieces 1
duct limits tube.nii.gz --organ colon --diameter 6mm --link 1cm --out limits.png
duct limits cones.json --diameter 5mm --link 12mm
duct fit phantom.nii.gz --labels 3 --organ upper-tract --max-error 2mm --out fit.yaml
duct show phantom.stl --organ upper-tract --voxel 2mm --spacing 10mm
"""
"""The same, of commands that take long."""

UNSTABLE = {
    *("seconds", "time_s", "sha256", "versions", "iterations", "evaluations", "samples"),
    "outside_place_mm",
}
"""Fields whose values differ between runs, machines or versions of SciPy."""


def write_data(path: Path) -> None:
    """Write made-up measurements: a smooth contraction with a fixed error."""
    pressure = np.linspace(0.0, 0.8, 20)
    contraction = 9.0 * (1.0 - np.exp(-((pressure / 0.4) ** 2))) + 0.05 * np.sin(37.0 * pressure)
    rows = [f"{p:.6f},{x:.6f}" for p, x in zip(pressure, contraction, strict=True)]
    path.write_text("\n".join(["pressure [MPa],contraction [mm]", *rows, ""]), encoding="utf-8")


def write_inputs(folder: Path) -> None:
    """Write the files that the commands read."""
    from bozzini.cli.main import main

    write_data(folder / "data.csv")
    mesh = write_tracts(folder).mesh
    centres = mesh.triangles_center + CURVE.min(axis=0) - 12.0
    inside = (centres - CURVE[0]) @ (CURVE[1] - CURVE[0]) > 0.0
    inside &= (centres - CURVE[-1]) @ (CURVE[-2] - CURVE[-1]) > 0.0
    trimesh.Trimesh(mesh.vertices, mesh.faces[inside]).export(folder / "open.stl")
    write_scan(folder / "ct.nii.gz")
    with contextlib.redirect_stdout(io.StringIO()):
        for name in ("phantom.nii.gz", "phantom.stl"):
            assert main(["phantom", "--voxel", "4mm", "--out", str(folder / name)]) == 0
    for path in EXAMPLES.glob("*.yaml"):
        shutil.copy(path, folder)
    for name, count in (("arm", 7), ("short", 3)):
        write_robot(folder / f"{name}.yaml", count)
    moving = yaml.safe_load((folder / "two_sections.yaml").read_text(encoding="utf-8"))
    for section in moving["sections"]:
        section["line_weight"] = "0.1 N/m"
    (folder / "moving.yaml").write_text(yaml.safe_dump(moving), encoding="utf-8")
    rows = ["time [s],T1 tension [N],T4 tension [N]", "0,0,0", "0.02,1,0.5", "0.04,0.2,0.5", ""]
    (folder / "pulls.csv").write_text("\n".join(rows), encoding="utf-8")
    balls = [((0, 0, 0), 5), ((2, 0, 20), 6), ((9, 0, 38), 4)]
    shapes = [{"centre": list(centre), "radius": radius} for centre, radius in balls]
    cones = {"format": "bozzini shapes", "version": 1, "kind": "cones", "shapes": shapes}
    (folder / "cones.json").write_text(json.dumps(cones), encoding="utf-8")


def write_robot(path: Path, count: int) -> None:
    """Write a robot of some sections of 15 mm with three tendons each."""
    sections = [
        {
            "length": 15.0,
            "radius": 2.5,
            "tendons": [
                {"name": f"s{index}{'abc'[k]}", "offset": 2.0, "angle": f"{turn} deg"}
                for k, turn in enumerate((0, 120, 240))
            ],
        }
        for index in range(count)
    ]
    path.write_text(yaml.safe_dump({"name": path.stem, "sections": sections}), encoding="utf-8")


def shorten(value: Any) -> Any:
    """Return a JSON value with long lists and objects cut to three entries, texts cut."""
    if isinstance(value, dict):
        kept = list(value)
        if len(kept) > 50:
            kept = [kept[0], kept[len(kept) // 2], kept[-1]]
        short = {key: None if key in UNSTABLE else shorten(value[key]) for key in kept}
        return short if len(kept) == len(value) else {"number of keys": len(value)} | short
    if isinstance(value, list):
        if len(value) > 8:
            picked = (0, len(value) // 2, len(value) - 1)
            return [len(value), *(shorten(value[place]) for place in picked)]
        return [shorten(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, str):
        return value[:40]
    return value


def run(line: str) -> dict[str, Any]:
    """Return exit code, shortened answer and written files of the last command of a line."""
    from bozzini.cli.main import main

    for command in line.split(" && "):
        before = set(Path().rglob("*"))
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main([*shlex.split(command), "--json"])
    answer = json.loads(out.getvalue()) if out.getvalue() else None
    found = {"exit": code, "answer": shorten(answer)}
    written = sorted(path for path in set(Path().rglob("*")) - before if path.is_file())
    if written:
        found["files"] = {path.as_posix(): describe_file(path, answer) for path in written}
    return found


def describe_file(path: Path, answer: Any) -> Any:
    """Return the shortened content of a JSON, YAML or CSV file, null of others."""
    if path.suffix in (".json", ".yaml"):
        load = json.loads if path.suffix == ".json" else yaml.safe_load
        content = load(path.read_text(encoding="utf-8"))
        return "the answer" if content == answer else shorten(content)
    if path.suffix == ".csv":
        names, *rows = [row.split(",") for row in path.read_text(encoding="utf-8").splitlines()]
        table = [
            [
                None if name in UNSTABLE else read_cell(cell)
                for name, cell in zip(names, row, strict=True)
            ]
            for row in rows
        ]
        return shorten([names, *table])
    return None


def read_cell(text: str) -> float | str:
    """Return the number in a cell of a table, or its text."""
    try:
        return float(text)
    except ValueError:
        return text


def run_in_copy(line: str, inputs: Path) -> dict[str, Any]:
    """Return what `run` does, in a copy of the folder of inputs."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        shutil.copytree(inputs, ".", dirs_exist_ok=True)
        return run(line)


def list_lines() -> list[str]:
    """Return the lines of all commands."""
    return [line for line in (COMMANDS + SLOW_COMMANDS).splitlines() if line]


if __name__ == "__main__":
    kept = json.loads(RECORDS.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as inputs:
        write_inputs(Path(inputs))
        for line in list_lines():
            if line.startswith(tuple(sys.argv[1:]) or ""):
                kept[line] = run_in_copy(line, Path(inputs))
    rows = [
        f"{json.dumps(line)}: {json.dumps(kept[line])}" for line in list_lines() if line in kept
    ]
    RECORDS.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
