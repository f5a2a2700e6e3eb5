"""Chains moved by their heads: the thesis's motion as a command."""

from __future__ import annotations

import json
import math

import numpy as np
import pandas as pd
import pytest

from bozzini.cli.main import main
from bozzini.duct import Circles, Polygon, StitchedQuads, save
from bozzini.errors import InputError
from bozzini.motion.chain_task import ChainTask, read_points


def _write(path, points):
    names = [f"{axis} [mm]" for axis in "xyz"[: len(points[0])]]
    pd.DataFrame(points, columns=names).to_csv(path, index=False)
    return str(path)


def test_a_link_pulled_at_right_angles_runs_on_the_tractrix(tmp_path):
    path = _write(tmp_path / "p.csv", [[0.0, 0.0], [0.0, 30.0]])
    start = _write(tmp_path / "s.csv", [[0.0, 0.0], [10.0, 0.0]])
    found = ChainTask(path=path, start=start).run()
    # Of a tractrix with the link L, the tail is L sech(s / L) aside when the head has gone s.
    assert found.joints[-1, 1, 0] == pytest.approx(10.0 / math.cosh(3.0), rel=1e-9)
    assert found.residual < 1e-9 and found.tail_way < found.head_way == pytest.approx(30.0)
    slipping = ChainTask(path=path, start=start, slip=1.0).run()
    assert np.allclose(slipping.joints[-1] - slipping.joints[0], [0.0, 30.0])


def test_a_chain_keeps_its_joints_in_quadrilaterals_and_out_of_circles(tmp_path, capsys):
    x = np.linspace(0.0, 120.0, 7)
    middle = np.stack([x, 14.0 * np.sin(x / 20.0)], axis=1)
    duct = StitchedQuads(middle + [0.0, 9.0], middle - [0.0, 9.0])
    save(duct, tmp_path / "quads.json")
    path = _write(tmp_path / "p.csv", 0.5 * (middle[:-1] + middle[1:]))
    command = ["duct", "chain", path, "--links", "12", "--json", "--quiet"]
    table = tmp_path / "chain.csv"
    shapes = ["--shapes", str(tmp_path / "quads.json")]
    assert main([*command, *shapes, "--out", str(table)]) == 0
    answer = json.loads(capsys.readouterr().out)
    frame = pd.read_csv(table)
    ends = frame[frame["step"] == frame["step"].max()][["x [mm]", "y [mm]"]].to_numpy()
    assert len(ends) == 13 and duct.signed_distance(ends).max() < 0.0
    assert answer["depth_mm"] >= 0.0 and answer["links"] == 12
    # The same with a stone that the path goes around.
    field = Polygon([[0.0, -40.0], [100.0, -40.0], [100.0, 40.0], [0.0, 40.0]])
    stone = Circles(np.array([[50.0, 0.0]]), np.array([12.0]))
    save(field, tmp_path / "field.json")
    save(stone, tmp_path / "stone.json")
    around = [[5.0, 0.0], [30.0, 16.0], [70.0, 16.0], [95.0, 0.0]]
    found = ChainTask(
        path=_write(tmp_path / "q.csv", around),
        shapes=str(tmp_path / "field.json"),
        obstacles=str(tmp_path / "stone.json"),
        links=15,
    ).run()
    inside = found.joints[field.signed_distance(found.joints) < 0.0]
    assert found.converged and stone.signed_distance(inside).min() > 0.0
    assert found.plot().get_xlabel() == "x [mm]"


def test_a_place_twice_in_a_row_is_passed_once(tmp_path):
    once = [[0.0, 0.0], [5.0, 1.0], [9.0, 8.0]]
    twice = [once[0], *once, once[2]]
    found, again = (
        ChainTask(path=_write(tmp_path / f"{len(points)}.csv", points), links=3).run()
        for points in (once, twice)
    )
    assert np.array_equal(found.joints[-1], again.joints[-1])
    with pytest.raises(InputError, match="one place in all rows"):
        ChainTask(path=_write(tmp_path / "p.csv", once[:1] * 2)).run()


def test_uneven_links_keep_their_lengths(tmp_path):
    path = _write(tmp_path / "p.csv", [[0.0, 0.0], [0.0, 30.0]])
    start = _write(tmp_path / "s.csv", [[0.0, 0.0], [10.0, 0.0], [14.0, 0.0]])
    assert ChainTask(path=path, start=start).run().residual < 1e-9


def test_points_have_units(tmp_path):
    file = tmp_path / "p.csv"
    file.write_text("x [cm],y_mm\n1,2\n3,4\n")
    assert read_points(str(file)).tolist() == [[10.0, 2.0], [30.0, 4.0]]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("one.csv", "1 row(s): a path needs two or more"),
        ("p.csv --obstacles field.json", "obstacles without shapes"),
        ("p.csv --shapes field.json --start p.csv", "start is for a free chain"),
        ("space.csv --shapes field.json", "3 coordinates"),
        ("p.csv --start p.csv --link 3mm", "link and start both"),
        ("bad.csv", "no column 'y'"),
        ("p.csv --slip 2", "slip"),
    ],
)
def test_wrong_input_is_one_line(tmp_path, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    _write(tmp_path / "one.csv", [[0.0, 0.0]])
    _write(tmp_path / "p.csv", [[1.0, 0.0], [2.0, 0.0]])
    _write(tmp_path / "space.csv", [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    (tmp_path / "bad.csv").write_text("x\n1\n2\n")
    save(Polygon([[0.0, -4.0], [10.0, -4.0], [10.0, 4.0], [0.0, 4.0]]), "field.json")
    assert main(["duct", "chain", *words.split(), "--quiet"]) == 2
    said = capsys.readouterr().err.strip()
    assert told in said and "\n" not in said
