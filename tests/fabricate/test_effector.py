"""Holders, fittings and template: what the files hold is what the design says."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.effector import EffectorDesign, PlacedMuscle, effector_preset
from bozzini.errors import GeometryError, InputError
from bozzini.fabricate import HolderOptions, build_holders, draw_template, write_holders, write_step
from bozzini.muscle import preset
from tests.fabricate.read_back import read_cylinders, read_step

DESIGN = effector_preset("prototype", holder_diameter=11.0)
NEAR = {"rtol": 0.0, "atol": 1e-5}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("holders") / "out"
    write_holders(DESIGN, out)
    return out


def find_holes(walls, diameter):
    return [wall for wall in walls if wall.inside and abs(wall.diameter - diameter) < 1e-4]


def polar(points):
    points = np.array(points)
    order = np.argsort(np.mod(np.arctan2(points[:, 1], points[:, 0]), math.tau))
    x, y = points[order, :2].T
    return np.mod(np.arctan2(y, x), math.tau), np.hypot(x, y)


@pytest.mark.parametrize("name", ["holder-proximal", "holder-distal"])
def test_holders_have_the_angles_and_offsets_of_the_design(folder, name):
    walls = read_cylinders(folder / f"{name}.stl")
    holes = find_holes(walls, DESIGN.hole_diameter)
    angle, offset = polar([hole.point for hole in holes])
    np.testing.assert_allclose(angle, np.sort(np.mod(DESIGN.angles, math.tau)), **NEAR)
    np.testing.assert_allclose(offset, DESIGN.offset, **NEAR)
    for hole in holes:
        np.testing.assert_allclose(hole.way, [0.0, 0.0, 1.0], **NEAR)
    for diameter in (DESIGN.bore_diameter, DESIGN.coil_diameter + HolderOptions().clearance):
        (bore,) = find_holes(walls, diameter)
        np.testing.assert_allclose(bore.point, 0.0, **NEAR)
    (outside,) = (wall for wall in walls if not wall.inside)
    assert outside.diameter == pytest.approx(DESIGN.holder_diameter, abs=1e-5)


def test_the_seat_of_the_coil_is_at_the_inner_face(folder):
    seat = DESIGN.coil_diameter + HolderOptions().clearance
    for name, low, high in (("proximal", -2.0, 0.0), ("distal", 0.0, 2.0)):
        (wall,) = find_holes(read_cylinders(folder / f"holder-{name}.stl"), seat)
        assert (min(wall.rings), max(wall.rings)) == pytest.approx((low, high))


def test_the_air_goes_through_the_proximal_fitting_only(folder):
    given = HolderOptions()
    walls = read_cylinders(folder / "fitting-proximal.stl")
    (bore,) = (wall for wall in walls if wall.inside)
    reach = given.proximal_length + given.nozzle_length
    assert (min(bore.rings), max(bore.rings)) == pytest.approx((-reach, given.nozzle_length))
    assert bore.diameter == pytest.approx(given.air_bore, abs=1e-5)
    pin = read_cylinders(folder / "fitting-distal.stl")
    assert not any(wall.inside for wall in pin)
    sizes = sorted(wall.diameter for wall in pin)
    assert sizes == pytest.approx(
        [given.nozzle_diameter, DESIGN.hole_diameter - given.clearance], abs=1e-5
    )


def test_volumes_are_those_of_the_closed_forms():
    proximal, distal, fitting, pin = build_holders(DESIGN)
    d, quarter = DESIGN, math.pi / 4.0
    across = d.holder_diameter**2 - 3 * d.hole_diameter**2
    for part, length in ((proximal, 5.0), (distal, d.holder_length)):
        bores = d.bore_diameter**2 * (length - 2.0) + (d.coil_diameter + 0.1) ** 2 * 2.0
        assert part.volume == pytest.approx(quarter * (across * length - bores), rel=1e-12)
    assert fitting.volume == pytest.approx(quarter * (6.0 + 1.9**2 * 5.0 - 0.4**2 * 11.0))
    assert pin.volume == pytest.approx(quarter * (3.0 + 1.9**2 * d.holder_length))
    for part in (proximal, distal, fitting, pin):
        assert part.mesh(0.3).volume == pytest.approx(part.volume, rel=0.02)


@st.composite
def designs(draw):
    degrees = draw(st.lists(st.integers(0, 359), min_size=1, max_size=5, unique=True))
    muscle = preset("fitted-45")
    return EffectorDesign(
        muscles=tuple(
            PlacedMuscle(name=f"M{k}", muscle=muscle, angle=math.radians(angle))
            for k, angle in enumerate(degrees)
        ),
        offset=draw(st.floats(3.0, 9.0)),
        holder_diameter=draw(st.floats(9.0, 24.0)),
        hole_diameter=draw(st.floats(1.2, 2.5)),
        bore_diameter=draw(st.floats(1.0, 3.9)),
    )


@settings(max_examples=8)
@given(design=designs())
def test_a_random_design_is_made_or_its_thinnest_wall_is_named(design, tmp_path_factory):
    hole, given = design.hole_diameter, HolderOptions()
    seat = max(design.bore_diameter, design.coil_diameter + given.clearance)
    places = design.offset * np.exp(1j * design.angles)
    apart = np.abs(places[:, None] - places)[np.triu_indices(len(places), 1)]
    walls = [
        design.holder_diameter / 2 - design.offset - hole / 2,
        design.offset - (hole + seat) / 2,
    ]
    least = min([*walls, *(apart - hole)])
    out = tmp_path_factory.mktemp("random") / "out"
    if least < given.wall - 1e-6:
        with pytest.raises(
            GeometryError, match=r"walls of 0\.3 mm need at least|at least 0\.3 mm must be"
        ):
            write_holders(design, out)
        assert not out.exists()
        return
    write_holders(design, out)
    for name in ("holder-proximal", "holder-distal"):
        holes = find_holes(read_cylinders(out / f"{name}.stl"), hole)
        angle, offset = polar([wall.point for wall in holes])
        np.testing.assert_allclose(np.exp(1j * angle), np.exp(1j * np.sort(design.angles)), **NEAR)
        np.testing.assert_allclose(offset, design.offset, **NEAR)


def test_the_template_is_true_to_scale(folder):
    root = ET.fromstring((folder / "template.svg").read_text(encoding="utf-8"))
    wide, tall = (float(root.get(side).removesuffix("mm")) for side in ("width", "height"))
    assert [float(n) for n in root.get("viewBox").split()] == pytest.approx([0, 0, wide, tall])
    (check,) = (line for line in root.findall(".//{*}line") if line.get("id") == "check")
    assert float(check.get("x2")) - float(check.get("x1")) == pytest.approx(50.0)
    circles = {
        c.get("id"): [float(c.get(n)) for n in ("cx", "cy", "r")]
        for c in root.findall(".//{*}circle")
    }
    x0, y0, radius = circles["outline"]
    assert 2.0 * radius == DESIGN.holder_diameter
    assert circles["pitch"][2] == DESIGN.offset
    for placed in DESIGN.muscles:
        x, y, r = circles[f"muscle {placed.name}"]
        assert 2.0 * r == DESIGN.hole_diameter
        assert math.hypot(x - x0, y - y0) == pytest.approx(DESIGN.offset, abs=1e-5)
        way = np.exp(1j * math.atan2(y0 - y, x - x0))
        assert way == pytest.approx(np.exp(1j * placed.angle), abs=1e-5)
    for shape in root.iter():
        numbers = [float(shape.get(n)) for n in ("x1", "x2", "cx", "x") if shape.get(n)]
        assert all(0.0 <= number <= wide for number in numbers)


def test_template_takes_any_name():
    muscle = preset("fitted-45")
    odd = PlacedMuscle(name="<&\"'>", muscle=muscle, angle=0.0)
    root = ET.fromstring(draw_template(DESIGN.replace(muscles=(odd,))))
    assert f"muscle {odd.name}" in {c.get("id") for c in root.findall(".//{*}circle")}


@pytest.mark.slow
def test_step_files_have_the_same_holes(tmp_path):
    pytest.importorskip("OCP", reason="the extra 'cad' is not installed")
    for part in build_holders(DESIGN):
        found = read_step(write_step(part, tmp_path / f"{part.name}.step"))
        for channel in part.channels:
            for diameter in set(channel.diameter):
                mine = [p for p, _, d in found if abs(d - diameter) < 1e-9]
                gaps = [np.linalg.norm(p[:2] - channel.centre[0, :2]) for p in mine]
                assert min(gaps) < 1e-9
        assert all(abs(way[2] - 1.0) < 1e-12 for _, way, _ in found)


@pytest.mark.parametrize("depth", [0.0, 2.0])
@pytest.mark.parametrize("change", [{}, {"offset": 2.5}, {"offset": 3.1}])
def test_what_a_refusal_says_fits_fits_and_no_less(change, depth):
    """As printed, 9 mm with holes of 2 and 3.5 mm: what is named can be made, 0.01 mm less not."""
    printed, options = effector_preset("prototype", **change), HolderOptions(seat_depth=depth)
    low, high = (3.05, 3.2) if depth == 0.0 else (3.35, 3.2)
    if low <= printed.offset <= high:
        build_holders(printed, options)
        return
    with pytest.raises(GeometryError) as refused:
        build_holders(printed, options)
    told = re.search(
        r"^(.*) is .* least ([\d.]+) mm; the smallest .* ([\d.]+) mm, with an offset of ([\d.]+)",
        str(refused.value),
    )
    name, least, holder, offset = told[1].replace(" ", "_"), *map(float, told.groups()[1:])
    smallest = printed.replace(holder_diameter=holder, offset=offset)
    own = smallest if name == "offset" else printed
    for fitting in (smallest, own.replace(**{name: least})):
        build_holders(fitting, options)
    for tight in (
        smallest.replace(holder_diameter=holder - 0.01),
        own.replace(**{name: least - 0.01}),
    ):
        with pytest.raises(GeometryError):
            build_holders(tight, options)


@pytest.mark.parametrize(
    ("design", "options", "words"),
    [
        (
            effector_preset("prototype"),
            {},
            r"holder diameter is 9 mm: muscle holes of 2 mm, 4 mm off the axis, with walls of "
            r"0.3 mm need at least 10.6 mm; the smallest holder round the seat of the coil of "
            r"4.1 mm is 9.3 mm",
        ),
        (DESIGN, {"wall": 0.6}, "nozzle of 1 mm is left a wall of 0.3 mm where at least 0.6"),
        (DESIGN, {"nozzle_diameter": 1.9}, r"nozzle diameter is 1.9 mm: it must be below 1.9 mm"),
        (DESIGN, {"nozzle_diameter": 0.45, "wall": 0.02}, "wall is 0.02 mm"),
        (DESIGN, {"nozzle_diameter": 0.5, "wall": 0.05}, "bore of 0.5 mm and would not hold"),
        (DESIGN, {"seat_depth": 5.0}, "proximal length is 5 mm: a seat of 5 mm needs at least"),
        (DESIGN.replace(holder_length=0.0), {}, "holder length is 0 mm"),
        (DESIGN.replace(bore_diameter=0.0), {}, "bore diameter is 0 mm"),
        (None, {}, "design is of type NoneType"),
    ],
)
def test_what_cannot_be_made_is_named(design, options, words):
    with pytest.raises(InputError, match=words):
        build_holders(design, HolderOptions(**options))
