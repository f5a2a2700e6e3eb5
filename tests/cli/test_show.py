"""``bozzini show`` and ``bozzini record``: every file that has a shape, pages and films of it."""

from __future__ import annotations

import base64
import gzip
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bozzini import Plan, duct
from bozzini.cli.main import main
from bozzini.continuum import ContinuumRobot
from bozzini.muscle import MuscleFile, preset, write_muscle
from bozzini.plot.style import ClearanceScale
from bozzini.scene.film import _encode_gif
from tests.cli.plan_cases import SCOPE, Outcome, Tracts
from tests.plot.fake_motion import make_plan
from tests.scene.decode_view import decode_view

ROBOT = Path(__file__).parents[2] / "examples" / "two_sections.yaml"


@pytest.fixture
def call(capsys):
    def call(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = main([*map(str, arguments)])
        return Outcome(code, *capsys.readouterr())

    return call


@pytest.fixture(scope="module")
def plan(tracts: Tracts, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("plan") / "made"
    assert main(["plan", str(tracts.surface), *SCOPE, "--quiet", "--out", str(folder)]) in (0, 1)
    return folder / "plan.npz"


def read_view(path: Path):
    packed = re.search(r'id="view">([^<]*)<', path.read_text(encoding="utf-8"))
    assert packed is not None
    return decode_view(gzip.decompress(base64.b64decode(packed[1])))


@pytest.mark.slow
def test_a_plan_is_shown_in_its_own_tract_and_in_no_other(call, plan, tracts, tmp_path):
    page = tmp_path / "page.html"
    done = call("show", plan, tracts.surface, "--out", page, "--json", "--quiet")
    assert done.code == 0 and done.result["bytes"] == page.stat().st_size
    view = read_view(page)
    wall = next(item for item in view["surfaces"] if item["name"] == "wall")
    # Vertices are kept to 0.01 mm, each face where it was.
    ours = np.sort(wall["vertices"][wall["faces"]].mean(axis=1), axis=0)
    np.testing.assert_allclose(ours, np.sort(tracts.mesh.triangles_center, axis=0), atol=0.02)
    assert view["bodies"][0]["joints"].shape == Plan.load(plan).joints.shape
    other = tmp_path / "other.stl"
    tracts.mesh.copy().apply_scale(1.01).export(other)
    done = call("show", plan, other, "--out", tmp_path / "no.html")
    assert done.code == 2 and "is not the file that the plan was made from" in done.err
    assert done.err.count("\n") == 1 and not (tmp_path / "no.html").exists()
    alone = call("show", plan, "--out", tmp_path / "alone.html", "--json", "--quiet")
    assert "inscribed tube" in alone.result["surfaces"]


@pytest.mark.slow
def test_a_plan_that_does_not_name_its_file_is_compared_with_the_wall(call, plan, tracts, tmp_path):
    made = Plan.load(plan)
    nameless = tmp_path / "nameless.npz"
    replace(made, input=replace(made.input, sha256=None, file="phantom")).save(nameless)
    page = tmp_path / "page.html"
    assert call("show", nameless, tracts.surface, "--out", page, "--quiet").code == 0
    # The same lumen in another form is the same, one that is wider, or elsewhere, is another.
    done = call("show", nameless, tracts.volume, "--out", page, "--quiet", "--force")
    assert done.code == 0
    for name, other in (
        ("wide", tracts.mesh.copy().apply_scale(1.3)),
        ("away", tracts.mesh.copy().apply_translation([0, 9, 0])),
    ):
        other.export(tmp_path / f"{name}.stl")
        film = tmp_path / "film.gif"
        for command in (
            ["show", nameless, tmp_path / f"{name}.stl", "--out", tmp_path / "no.html"],
            ["record", nameless, tmp_path / f"{name}.stl", "--out", film, "--style", "x-ray"],
        ):
            done = call(*command, "--quiet")
            assert done.code == 2 and "is not what the plan was made from" in done.err
            assert done.err.count("\n") == 1 and not film.exists()
    assert not (tmp_path / "no.html").exists()


def test_of_two_walls_one_must_be_the_plans(call, plan, tracts, tmp_path):
    others = []
    for k in (1, 2):
        others.append(tmp_path / f"other{k}.stl")
        tracts.mesh.copy().apply_translation([40 * k, 0, 0]).export(others[-1])
    page = tmp_path / "page.html"
    done = call("show", plan, *others, "--out", page, "--quiet")
    assert done.code == 2 and "is not the file" in done.err and not page.exists()
    assert call("show", plan, others[0], tracts.surface, "--out", page, "--quiet").code == 0
    walls = [item for item in read_view(page)["surfaces"] if item["name"] == "wall"]
    assert len(walls) == 2


@pytest.mark.slow
def test_a_plans_tract_is_read_as_the_plan_says_and_not_otherwise(call, tracts, tmp_path):
    folder = tmp_path / "made"
    only = ["--labels", "1", "--link", "5mm", "--diameter", "5mm", "--head-step", "1mm"]
    assert call("plan", tracts.halves, *only, "--quiet", "--out", folder).code in (0, 1)
    made, page = folder / "plan.npz", tmp_path / "page.html"
    assert call("show", made, tracts.halves, "--out", page, "--quiet").code == 0
    high = read_view(page)["surfaces"][-1]["vertices"][:, 2].max()
    again = ["--out", page, "--quiet", "--force"]
    assert call("show", made, tracts.halves, "--labels", "1", *again).code == 0
    assert read_view(page)["surfaces"][-1]["vertices"][:, 2].max() == high
    assert high < 0.9 * tracts.mesh.vertices[:, 2].max()
    done = call("show", made, tracts.halves, "--labels", "2", *again)
    assert done.code == 2 and "--labels" in done.err and done.err.count("\n") == 1


def test_everything_with_a_shape_goes_on_one_page(call, tmp_path):
    duct.save(duct.RoundCones(np.array([[0.0, 0, 0], [30.0, 0, 0]]), np.array([5.0, 6.0])),
              tmp_path / "shapes.json")  # fmt: skip
    muscle = preset("effector-45")
    write_muscle(tmp_path / "muscle.yaml", MuscleFile(muscle=muscle, model="energy"))
    (tmp_path / "tips.csv").write_text("x_mm,y_mm,z_mm\n1,2,3\n4,5,6\n")
    names = [tmp_path / "shapes.json", ROBOT, tmp_path / "muscle.yaml", tmp_path / "tips.csv"]
    page = tmp_path / "page.html"
    assert call("show", *names, "--out", page, "--quiet").code == 0
    view = read_view(page)
    robot = ContinuumRobot.from_yaml(ROBOT)
    bodies = {body["name"]: body["joints"] for body in view["bodies"]}
    assert np.linalg.norm(np.ptp(bodies[robot.name], axis=1)) == pytest.approx(robot.length)
    assert bodies["end-effector"][0, 0, 2] == pytest.approx(muscle.length)
    assert view["title"] == "shapes.json, two_sections.yaml, muscle.yaml, tips.csv"
    points = {cloud["name"]: cloud["points"] for cloud in view["clouds"]}
    np.testing.assert_allclose(points["tips"], [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.yaml", "name: x\n", "has no 'shapes', 'sections', 'muscle' or 'camera'"),
        ("a.json", "[1", "a.json"),
        ("a.csv", "u,v\n1,2\n", "it needs x, y and z"),
        ("a.csv", "name: x\nsections: # of a robot\n- {a: 1, b: 2}\n", "it needs x, y and z"),
        ("a.csv", "x_mm,y_mm,z_mm\n", "holds no points"),
        ("a.npz", "x", "is not a Bozzini plan"),
        ("a.stl", "x", "a.stl"),
    ],
)
def test_a_file_that_cannot_be_shown_is_one_line(call, tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    done = call("show", tmp_path / name, "--out", tmp_path / "page.html", "--quiet")
    assert done.code == 2 and words in done.err and done.err.count("\n") == 1
    assert not (tmp_path / "page.html").exists()


def test_what_is_in_the_way_or_has_no_effect_is_refused(call, tmp_path):
    page = tmp_path / "page.html"
    assert call("show", ROBOT, "--out", page, "--quiet").code == 0
    again = call("show", ROBOT, "--out", page, "--quiet")
    assert again.code == 2 and "--force" in again.err
    assert call("show", ROBOT, "--out", page, "--quiet", "--force").code == 0
    odd = call("show", ROBOT, "--out", page, "--force", "--labels", "1")
    assert odd.code == 2 and "there is no tract among the files" in odd.err


def test_a_notebook_shows_a_plan_cut_off_from_the_notebook(tmp_path):
    cell = make_plan().show()
    html = cell._repr_html_()
    assert html.startswith("<iframe srcdoc=") and 'sandbox="allow-scripts"' in html
    assert "<script>" not in html  # escaped: it runs in the frame alone
    assert read_view(cell.save(tmp_path / "page.html"))["bodies"][0]["radius"] == 2.0


@pytest.mark.slow
def test_a_film_has_as_many_pictures_as_it_says_and_they_differ(call, tmp_path):
    make_plan(dent=3.9).save(tmp_path / "plan.npz")
    film = tmp_path / "film.gif"
    done = call("record", tmp_path / "plan.npz", "--out", film, "--style", "x-ray", "--duration",
                "0.5s", "--rate", "8", "--json", "--quiet")  # fmt: skip
    assert done.code == 0 and done.result["style"] == "x-ray"
    with Image.open(film) as pictures:
        assert pictures.n_frames == done.result["pictures"] <= 5
        first = np.asarray(pictures.convert("RGB"), dtype=float)
        pictures.seek(pictures.n_frames - 1)
        last = np.asarray(pictures.convert("RGB"), dtype=float)
    assert first.std() > 8.0 and (np.abs(first - last).max(axis=-1) > 30).mean() > 0.002


def test_a_gif_keeps_the_colours_of_a_small_scope(tmp_path):
    colors = np.array([ClearanceScale(low=-1.0, high=5.0).color(value) for value in (-1, 0, 2, 5)])
    across, down = np.meshgrid(np.linspace(0, 150, 960), np.linspace(0, 150, 540))
    picture = np.stack([across, 0.5 * (across + down), down], axis=-1).astype(np.uint8)
    for k, color in enumerate(colors):
        picture[100 * k + 40 : 100 * k + 50, 400:420] = 255 * color
    _encode_gif(tmp_path / "film.gif", iter([picture, picture[::-1]]), 2.0)
    with Image.open(tmp_path / "film.gif") as film:
        found = np.asarray(film.convert("RGB"), dtype=float)
    for k, color in enumerate(colors):
        np.testing.assert_allclose(found[100 * k + 45, 410], 255 * color, atol=20)


def test_a_film_needs_its_extra_and_a_legal_rate(call, tmp_path, monkeypatch):
    make_plan().save(tmp_path / "plan.npz")
    film = tmp_path / "film.mp4"
    wrong = call("record", tmp_path / "plan.npz", "--out", film, "--rate", "99")
    assert wrong.code == 2 and "99" in wrong.err and "[1, 60]" in wrong.err
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    done = call("record", tmp_path / "plan.npz", "--out", film)
    assert done.code == 2 and "bozzini[film]" in done.err and not film.exists()


@pytest.mark.slow
def test_the_page_is_filmed_as_it_is_shown(call, tmp_path):
    from bozzini.scene.film import find_browser

    make_plan(dent=3.9).save(tmp_path / "plan.npz")
    film = tmp_path / "film.mp4"
    options = ["--style", "page", "--duration", "0.5s", "--rate", "4", "--json", "--quiet"]
    done = call("record", tmp_path / "plan.npz", "--out", film, *options)
    if find_browser() is None:
        assert done.code == 2 and "Chromium" in done.err
        return
    assert done.code == 0 and done.result["pictures"] == 2
    from imageio_ffmpeg import count_frames_and_secs

    frames, seconds = count_frames_and_secs(str(film))
    assert frames == 2 and json.loads(done.out)["style"] == "page"
    assert seconds == pytest.approx(0.5, abs=0.01)


def test_a_browser_that_fails_is_one_line(call, tmp_path, monkeypatch):
    from bozzini.scene import film

    monkeypatch.setattr(film, "BROWSERS", ("false",))
    make_plan().save(tmp_path / "plan.npz")
    options = ["--out", tmp_path / "film.gif", "--duration", "0.2s", "--quiet"]
    done = call("record", tmp_path / "plan.npz", *options)
    assert done.code == 2 and "cannot show the page" in done.err and done.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["plan.npz"]
