"""The pages about the thesis name all that is in it, and its figures are made from the package."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

from bozzini.cli.main import root
from bozzini.motion import move_free_chain
from tests.test_gallery import measure_change

DOCS = Path(__file__).resolve().parents[1] / "docs"

_spec = importlib.util.spec_from_file_location("make_thesis", DOCS / "make_thesis.py")
assert _spec is not None and _spec.loader is not None
thesis = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(thesis)

SECTIONS = """
    1.1 1.2 1.3 2.1 2.2 2.2.1 2.2.2 2.2.3 2.2.4 2.2.5 2.2.6 2.2.7 2.2.8 2.2.9 2.2.10 2.3
    3.1 3.2 3.3 3.3.1 3.3.2 3.3.3 3.3.4 3.4 3.5 4.1 4.2 4.3 4.4 4.5 4.6 4.7 4.8
    5.1 5.2 5.2.1 5.2.2 5.3 5.3.1 5.3.2 5.3.2.1 5.3.2.2 5.3.2.3
    5.3.3 5.3.3.1 5.3.3.2 5.3.3.3 5.3.4 5.3.5 5.4
    6.1 6.2 A B C
""".split()
"""All sections of the thesis."""

EQUATIONS = {"2": 56, "3": 25, "4": 16, "5": 34, "6": 6}
FIGURES = {"1": 6, "2": 1, "3": 17, "4": 24, "5": 32, "B": 1}
TABLES = {"2": 1, "4": 4}
"""Largest number in each chapter; all from 1 on are there."""

APPENDIX_FIGURES = {"C.2", "C.3"}
"""There is no C.1 in the text that we have."""

FIGURE_NUMBERS = {f"{c}.{k}" for c, n in FIGURES.items() for k in range(1, n + 1)}
FIGURE_NUMBERS |= APPENDIX_FIGURES


def _make_page() -> str:
    """Return the page of the figures below its title."""
    return "\n\n".join(thesis.format_page(json.loads(thesis.VALUES.read_text("utf-8"))))


def _expand(text: str, mark: str) -> set[str]:
    """Return the numbers after a mark, such as "Figs 5.1–5.6", with spans filled."""
    found = set()
    number = r"[\dABC]\.\d+"
    for run in re.findall(rf"{mark} ((?:{number}(?:–| to |, | and )?)+)", text):
        for first, last in re.findall(rf"({number})(?:(?:–| to )({number}))?", run):
            chapter, start = first.split(".")
            found |= {f"{chapter}.{k}" for k in range(int(start), int((last or first)[2:]) + 1)}
    return found


def _list_heads() -> list[str]:
    """Return the first column of every row before the errata."""
    text = (DOCS / "thesis.md").read_text("utf-8").partition("## Errata")[0]
    return [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")]


def test_a_row_for_every_section() -> None:
    starts = (re.match(r"(\d(?:\.\d+)+|[ABC])(?:[, ]|$)", head) for head in _list_heads())
    named = {start[1] for start in starts if start}
    assert named == set(SECTIONS)


def test_a_row_without_a_command_says_so() -> None:
    text = (DOCS / "thesis.md").read_text("utf-8").partition("## Errata")[0]
    rows = [line.split("|")[1:3] for line in text.splitlines() if re.match(r"\| [\dABCT]", line)]
    told = ("`bozzini ", "no command", "nothing", "as above", "chapters 2,")
    silent = [head for head, here in rows if not any(words in here for words in told)]
    # Models of muscles: their two commands stand above the table.
    assert all(re.match(r" 2\.2\.[1-9],", head) for head in silent) and len(silent) == 9


def test_a_row_for_every_equation() -> None:
    text = " ".join(_list_heads()).replace("(", "Eq ").replace(")–Eq ", "–").replace(")", "")
    assert _expand(text, "Eq") == {
        f"{c}.{k}" for c, n in EQUATIONS.items() for k in range(1, n + 1)
    }


def test_the_footnote_to_5_21_has_the_signs_that_solve_it() -> None:
    """Both pairs that the page states bring the footnote's point back, upper signs together."""
    (row,) = re.findall(
        r"^\| footnote to \(5\.21\) \|.*$", (DOCS / "thesis.md").read_text(encoding="utf-8"), re.M
    )
    number = r"(−?[\d.]+) (±|∓) ([\d.]+)i"
    found = re.findall(number, row.split("|")[3])
    values = [
        complex(float(real.replace("−", "-")), float(size) * (1.0 if sign == "±" else -1.0))
        for real, sign, size in found
    ]
    across, along, u, v = values
    p, q = np.array([[0.0, 15.0], [10.0, 10.0]]), np.array([[0.0, 0.0], [4.0, 1.0]])
    for share, way in ((across, along), (v, 1.0 - u)):  # u of (5.21) is 1 at the first rung
        back = (1.0 - share) * ((1.0 - way) * p[0] + way * p[1])
        back = back + share * ((1.0 - way) * q[0] + way * q[1])
        assert back == pytest.approx(np.array([10.0, -5.0]) + 0j, abs=0.02)


def test_the_hypothesis_of_5_3_5_is_refuted_for_ducts_only() -> None:
    texts = [(DOCS / name).read_text("utf-8") for name in ("thesis.md", "theory/motion.md")]
    for text in (" ".join(text.split()) for text in [*texts, _make_page()]):
        assert "hypothesis is false" not in text
        assert re.search(r"refuted for ducts, not for a curve|For ducts that is refuted", text)


def test_a_row_for_every_figure_and_table() -> None:
    text = " ".join(_list_heads())
    assert _expand(text, "(?:Figs|Fig\\.)") == FIGURE_NUMBERS
    assert _expand(text, "Tables?") == {
        f"{c}.{k}" for c, n in TABLES.items() for k in range(1, n + 1)
    }


def _list_posed() -> list[tuple[list[str], str]]:
    """Return the commands of each row that gives poses of the thesis's section, and the values."""
    found = []
    for line in (DOCS / "thesis.md").read_text("utf-8").splitlines():
        cells = line.split(" | ")
        if len(cells) == 3 and cells[1].startswith("`bozzini effector pose thesis"):
            whole, *more = re.findall(r"`([^`]+)`", cells[1])
            commands = [whole]
            for options in more:  # each adds to the one before
                commands.append(f"{commands[-1]} {options}")
            found.append((commands, cells[2].partition("; ")[0]))
    return found


@pytest.mark.parametrize(("commands", "values"), _list_posed())
def test_commands_give_the_values_beside_them(commands: list[str], values: str) -> None:
    shown = []
    for command in commands:
        result = CliRunner().invoke(root, shlex.split(command)[1:])
        assert result.exit_code == 0, result.output
        shown += [abs(float(word)) for word in re.findall(r"\d+\.\d+", result.stdout)]
    told = re.findall(r"(\d+\.(\d+))(?= mm| N|°)", values)
    assert len(told) >= 3
    for number, digits in told:
        half = 0.51 * 10.0 ** -len(digits)  # what is shown is rounded itself
        assert any(abs(value - float(number)) <= half for value in shown), number


def test_poses_of_four_rows_are_tried() -> None:
    assert len(_list_posed()) == 4


def test_every_figure_is_drawn_or_has_a_reason() -> None:
    titles = [thesis.read_notes(draw)[0] for draw in thesis.list_figures().values()]
    drawn = [number for title in titles for number in thesis.list_numbers(title)]
    left = [number for row in thesis.NOT_DRAWN for number in thesis.list_numbers(row)]
    assert sorted(drawn + left) == sorted(FIGURE_NUMBERS)
    assert {f"5.{k}" for k in range(3, 33)} | APPENDIX_FIGURES <= set(drawn)
    assert "not drawn yet" not in _make_page().lower()


def test_every_drawn_figure_is_linked_from_its_row() -> None:
    text = (DOCS / "thesis.md").read_text("utf-8").partition("## Errata")[0]
    for name, draw in thesis.list_figures().items():
        numbers = set(thesis.list_numbers(thesis.read_notes(draw)[0]))
        rows = [line for line in text.splitlines() if f"thesis-figures.md#fig_{name})" in line]
        shown = set().union(*(_expand(row.split("|")[1], "(?:Figs|Fig\\.)") for row in rows))
        assert numbers <= shown, name


def test_every_figure_has_its_value_on_the_page() -> None:
    values = json.loads(thesis.VALUES.read_text("utf-8"))
    assert set(values) == set(thesis.list_figures()), "run: make thesis"
    assert all(values.values())
    page = _make_page()
    assert all(f"- **Value**: {value}\n" in page for value in values.values())


def test_every_figure_has_its_picture() -> None:
    pictures = {path.stem.removeprefix("fig_") for path in thesis.PICTURES.glob("*.png")}
    assert pictures == set(thesis.list_figures())
    assert sum(path.stat().st_size for path in thesis.PICTURES.glob("*.png")) < 4_000_000


@pytest.mark.slow
@pytest.mark.parametrize("name", thesis.list_figures())
def test_figures_are_made_and_their_values_hold(name: str, tmp_path: Path) -> None:
    matplotlib.use("Agg")
    path, value = thesis.make_picture(name, folder=tmp_path)
    pixels = imread(path)
    assert pixels.shape[1] == thesis.WIDTH
    assert np.std(pixels[..., :3]) > 0.02  # something is drawn
    assert measure_change(path, thesis.PICTURES / path.name) < 0.15  # fonts may differ
    number = r"[-+−]?\d+(?:\.\d+)?(?:e-?\d+)?"
    shown = json.loads(thesis.VALUES.read_text("utf-8"))[name]
    assert re.sub(number, "#", value) == re.sub(number, "#", shown)
    for new, old in zip(re.findall(number, value), re.findall(number, shown), strict=True):
        a, b = (float(part.replace("−", "-")) for part in (new, old))
        assert a == pytest.approx(b, rel=0.02, abs=0.02)


def test_the_tractrix_is_no_least_move_over_a_finite_step() -> None:
    start, heads = [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [1.0, 0.0]]
    moves = {}
    for scheme in ("exact", "least"):
        tail = move_free_chain(start, heads, scheme=scheme)[-1, 1]
        moves[scheme] = np.linalg.norm(tail - [0.0, 1.0])
    assert moves["least"] == pytest.approx(np.sqrt(2.0) - 1.0)
    assert moves["exact"] == pytest.approx(np.hypot(1.0 - np.tanh(1.0), 1.0 - 1.0 / np.cosh(1.0)))
    assert moves["exact"] > 1.02 * moves["least"]


def test_ways_fall_along_a_chain_and_displacements_need_not() -> None:
    chain = np.stack([np.zeros(9), np.arange(9.0)], axis=1)
    along = np.linspace(0.0, 6.0, 601)
    turn = 2.0 * np.pi * along / 6.0
    straight = np.stack([along, 0.0 * along], axis=1)
    closed = np.stack([np.sin(turn), np.cos(turn) - 1.0], axis=1)
    for heads, last in ((straight, 5), (closed, 1)):
        poses = move_free_chain(chain, heads)
        ways = np.linalg.norm(np.diff(poses, axis=0), axis=2).sum(axis=0)
        ends = np.linalg.norm(poses[-1] - poses[0], axis=1)
        assert np.all(np.diff(ways) < 0.0)
        assert ends[last] > 1.005 * ends[last - 1]
