"""Studies: rows by number, one table whatever the engine, errors as rows, refusals in one line."""

from __future__ import annotations

import functools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.stats import truncnorm

from bozzini.effector import Effector, effector_preset, sweep
from bozzini.errors import BozziniError, InputError, OutputError
from bozzini.io.records import read_record
from bozzini.io.schema import make_schema
from bozzini.muscle import EnergyMuscle
from bozzini.muscle import preset as muscle_preset
from bozzini.study import Engine, Sampling, Study, StudySpec, read_rows, run_study
from bozzini.study.factors import draw_rows
from bozzini.study.jobs import ERROR, find_source

SERIAL = Engine(workers=1)
EFFECTOR: dict[str, Any] = {
    "format": "bozzini-study-1",
    "job": "effector-design",
    "fixed": {"preset": "prototype", "deflection": "12 mm"},
    "factors": {
        "offset": {"range": ["1.2 mm", "4.5 mm"]},
        "flexural_rigidity": {"range": ["50 N mm^2", "400 N mm^2"], "scale": "log"},
        "segments": {"integers": [10, 20]},
        "muscle.modulus": {"normal": ["0.56 MPa", "30 kPa"], "clip": ["0.5 MPa", "0.7 MPa"]},
        "muscle.braid_angle": {"values": ["34 deg", "36 deg", "56 deg"]},
    },
    "sampling": {"method": "sobol", "count": 300, "seed": 7},
}


def fail_at_three(x: float, power: int = 2) -> dict[str, float]:
    if x == 3.0:
        raise ZeroDivisionError("three")
    if x == 4.0:
        raise InputError("x is 4: it must be another number")
    return {"value": x**power}


def branin(x: float, y: float) -> dict[str, float]:
    value = (y - 5.1 / (4 * np.pi**2) * x**2 + 5 / np.pi * x - 6) ** 2
    value += 10 * (1 - 1 / (8 * np.pi)) * np.cos(x) + 10
    return {"value": float(value), "size": abs(x) + abs(y)}


def make_study(base: Path = Path(), **changes: Any) -> Study:
    return Study(read_record(EFFECTOR | changes, StudySpec), base)


def make_function_study(function: str = "fail_at_three", **changes: Any) -> Study:
    given = {
        "job": f"tests.study.test_sweep_rows:{function}",
        "fixed": {"power": 3},
        "factors": {"x": {"integers": [1, 6]}},
        "sampling": {"method": "grid"},
        "outputs": ["value"],
    }
    return make_study(**(given | changes))


@pytest.mark.parametrize("method", ["grid", "sobol", "random"])
def test_a_row_depends_on_its_number_alone(method: str) -> None:
    count = None if method == "grid" else 300
    sampling = Sampling(method=method, count=count, seed=3)  # type: ignore[arg-type]
    axes = make_study().axes
    whole = draw_rows(axes, sampling, first=0, count=300)
    for first, number in ((0, 1), (1, 7), (37, 100), (299, 1)):
        part = draw_rows(axes, sampling, first=first, count=number)
        for name, values in part.items():
            assert np.array_equal(values, whole[name][first : first + number])


def test_factors_are_distributed_as_stated() -> None:
    drawn = make_study().draw(0, 4096)
    assert drawn["offset"].min() > 1.2 and drawn["offset"].max() < 4.5
    assert np.mean(drawn["offset"]) == pytest.approx(0.5 * (1.2 + 4.5), abs=0.01)
    logarithm = np.log(drawn["flexural_rigidity"].astype(float))
    assert np.mean(logarithm) == pytest.approx(0.5 * (np.log(50) + np.log(400)), abs=0.01)
    segments, counts = np.unique(drawn["segments"], return_counts=True)
    assert segments.tolist() == list(range(10, 21))
    assert counts == pytest.approx(4096 / 11, rel=0.05)
    modulus = drawn["muscle.modulus"]
    assert modulus.min() >= 0.5 and np.median(modulus) == pytest.approx(0.5609, abs=1e-3)
    assert set(np.degrees(drawn["muscle.braid_angle"].astype(float)).round(9)) == {34, 36, 56}


@pytest.mark.parametrize("ends", [(-1, 2), (6, 9), (9, 10), (-10, -9)])
def test_a_clipped_normal_is_what_is_left_of_it(ends: tuple[float, float]) -> None:
    factors = {"x": {"normal": [3, 2], "clip": [3 + 2 * end for end in ends], "levels": 2001}}
    study = make_function_study(factors=factors)
    drawn = study.draw(0, study.rows)["x"].astype(float)
    law = truncnorm(*ends, loc=3, scale=2)
    for share in (0.1, 0.5, 0.9):
        assert np.quantile(drawn, share) == pytest.approx(law.ppf(share), rel=1e-3)


def test_grid_has_every_combination_last_factor_fastest() -> None:
    study = make_study(
        factors={
            "offset": {"range": ["2 mm", "4 mm"], "levels": 3},
            "segments": {"integers": [12, 13]},
        },
        sampling={"method": "grid"},
    )
    rows = study.draw(0, study.rows)
    assert rows["offset"].tolist() == [2, 2, 3, 3, 4, 4]
    assert rows["segments"].tolist() == [12, 13] * 3


def test_study_is_the_sweep(tmp_path: Path) -> None:
    study = make_study(
        factors={
            "offset": {"values": ["1 mm", "3 mm", "4 mm"]},
            "segments": {"integers": [12, 15]},
        },
        sampling={"method": "grid"},
    )
    found = run_study(study, tmp_path / "out", engine=SERIAL)
    rows = found.read()
    effector = Effector(effector_preset("prototype"))
    alone = sweep(
        effector, {"offset": [1.0, 3.0, 4.0], "segments": [12, 13, 14, 15]}, deflection=12.0
    )
    assert rows["feasible"].tolist() == [row.feasible for row in alone.rows]
    for row, (_, line) in zip(alone.rows, rows.iterrows(), strict=True):
        assert (line["reason"] == "") == row.feasible
        if row.built:
            assert line["area_mm2"] == row.area
            assert line["needed_pressure_MPa"] == row.needed_pressure


def test_chunks_and_a_second_run_change_nothing(tmp_path: Path) -> None:
    first = run_study(make_study(), tmp_path / "a", engine=SERIAL)
    assert first.converged and 0 < first.feasible < 300
    assert first.feasible + sum(first.reasons.values()) == 300
    small = make_study(chunk=17)
    assert small.key == make_study().key != make_study(sampling={"method": "grid"}).key
    run_study(small, tmp_path / "b", engine=SERIAL)
    assert len(list((tmp_path / "b" / "rows").iterdir())) == 18
    rows = read_rows(tmp_path / "a")
    assert read_rows(tmp_path / "b").equals(rows)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "b").rglob("*")}
    run_study(small, tmp_path / "b", engine=SERIAL)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "b").rglob("*")} == before


def test_damaged_and_missing_parts_are_computed_again(tmp_path: Path) -> None:
    study = make_study(chunk=50)
    run_study(study, tmp_path / "whole", engine=SERIAL)
    folder = tmp_path / "broken"
    run_study(study, folder, engine=SERIAL)
    parts = sorted((folder / "rows").iterdir())
    parts[0].write_bytes(parts[0].read_bytes()[: parts[0].stat().st_size // 2])
    parts[1].unlink()
    parts[2].write_bytes(parts[3].read_bytes())  # whole, but of other rows
    run_study(make_study(chunk=50, sampling={"method": "sobol", "count": 50, "seed": 8}),
              tmp_path / "other", engine=SERIAL)  # fmt: skip
    parts[4].write_bytes((tmp_path / "other" / "rows" / parts[0].name).read_bytes())
    data = bytearray(parts[5].read_bytes())
    data[200] ^= 255  # inside its pages, before the footer
    parts[5].write_bytes(data)
    (folder / "rows" / ".part-000001.xyz.parquet").write_bytes(b"left over")
    run_study(study, folder, engine=SERIAL)
    assert read_rows(folder).equals(read_rows(tmp_path / "whole"))
    assert not list((folder / "rows").glob(".*"))


def test_a_row_that_fails_is_a_row_with_a_reason(tmp_path: Path) -> None:
    study = make_function_study(constraints={"value": {"at_most": 100}})
    found = run_study(study, tmp_path / "out", engine=SERIAL)
    rows = found.read()
    assert found.converged and len(rows) == 6
    assert rows["x"].tolist() == [1, 2, 3, 4, 5, 6]
    assert rows["code"].tolist() == [0, 0, ERROR, 1, 0, 0]
    assert rows["reason"][2] == "ZeroDivisionError: three"
    assert rows["reason"][3] == "x is 4: it must be another number"
    assert rows["feasible"].tolist() == [True, True, False, False, False, False]
    assert np.isnan(rows["value"][2]) and rows["value"][4] == 125.0


def give_back(x: int, y: float) -> dict[str, float]:
    return {"value": sum(y for _ in range(x)), "root": math.nan if y < 0.0 else y}


def test_whole_numbers_and_what_is_not_finite(tmp_path: Path) -> None:
    study = make_function_study(
        job="tests.study.test_sweep_rows:give_back",
        fixed={},
        factors={"x": {"integers": [1, 2]}, "y": {"values": [-1, 1]}},
        outputs=["value", "root"],
    )
    rows = run_study(study, tmp_path / "out", engine=SERIAL).read()
    assert rows["value"].tolist() == [-1, 1, -2, 2]
    assert rows["feasible"].tolist() == [False, True] * 2
    assert rows["reason"].tolist() == ["an output is not finite", ""] * 2


def test_muscle_tolerance_is_the_model(tmp_path: Path) -> None:
    study = make_study(
        job="muscle-tolerance",
        fixed={"preset": "fitted-45", "pressure": "400 kPa", "load": "0.5 N"},
        factors={
            "modulus": {"normal": ["0.56 MPa", "0.03 MPa"]},
            "braid_angle": {"values": ["34 deg", "36 deg", "60 deg"]},
        },
        sampling={"method": "random", "count": 30, "seed": 1},
    )
    rows = run_study(study, tmp_path / "out", engine=SERIAL).read()
    for _, row in rows.iterrows():
        if row["braid_angle_rad"] > 1.0:
            assert row["code"] == 1 and "60 deg" in row["reason"]
            continue
        muscle = muscle_preset(
            "fitted-45", modulus=row["modulus_MPa"], braid_angle=row["braid_angle_rad"]
        )
        expected = float(EnergyMuscle(muscle).contraction(0.4, 0.5))
        assert row["contraction_mm"] == pytest.approx(expected, rel=1e-12)


def test_robot_sections(tmp_path: Path) -> None:
    robot = Path(__file__).resolve().parents[2] / "examples" / "two_sections.yaml"
    study = make_study(
        base=robot.parent,
        job="robot-sections",
        fixed={"robot": robot.name, "displacement.T1": "2 mm"},
        factors={
            "sections.1.length": {"values": ["30 mm", "40 mm"]},
            "sections.9.length": {"values": ["30 mm"]},
        },
        sampling={"method": "grid"},
    )
    rows = run_study(study, tmp_path / "bad", engine=SERIAL).read()
    assert (rows["code"] == 1).all() and "'9' must be in 1 to 2" in rows["reason"][0]
    good = make_study(
        base=robot.parent,
        job="robot-sections",
        fixed={"robot": robot.name},
        factors={
            "sections.1.length": {"values": ["30 mm", "40 mm"]},
            "displacement.T1": {"values": ["0 mm", "2 mm"]},
        },
        sampling={"method": "grid"},
    )
    rows = run_study(good, tmp_path / "good", engine=SERIAL).read()
    assert rows["reason"].tolist() == [""] * 4
    assert rows["length_mm"][2] - rows["length_mm"][0] == pytest.approx(10.0)
    assert rows["bend_rad"][0] == pytest.approx(0.0, abs=1e-9)
    # The bend of an arc is the displacement over the tendon's offset, whatever the length.
    assert rows["bend_rad"][1] == pytest.approx(rows["bend_rad"][3], rel=1e-6)


@pytest.mark.parametrize("method", ["differential-evolution", "tpe"])
def test_searches_find_the_least(tmp_path: Path, method: str) -> None:
    pytest.importorskip("optuna")
    study = make_function_study(
        "branin",
        fixed={},
        factors={"x": {"range": [-5, 10]}, "y": {"range": [0, 15]}},
        sampling=None,
        search={"minimise": ["value"], "method": method, "evaluations": 150, "seed": 2},
        constraints={"size": {"at_most": 14}},
    )
    found = run_study(study, tmp_path / "out", engine=SERIAL)
    rows = found.read()
    best = rows[rows["feasible"]]["value"].min()
    assert found.converged and 100 <= len(rows) <= 400
    assert rows["row"].tolist() == list(range(len(rows)))
    assert 0.397887 <= best < (6.0 if method == "tpe" else 0.5)
    again = run_study(study, tmp_path / "again", engine=SERIAL)
    assert again.read().equals(rows)


def test_search_for_two_aims_gives_a_front(tmp_path: Path) -> None:
    pytest.importorskip("pymoo")
    from bozzini.plot.study import find_front

    search = {"minimise": ["needed_pressure", "-area"], "method": "nsga2", "evaluations": 600}
    study = make_study(sampling=None, search=search)
    rows = run_study(study, tmp_path / "out", engine=SERIAL).read()
    rows = rows[rows["feasible"]]
    points = np.stack([rows["needed_pressure_MPa"], -rows["area_mm2"]], axis=1)
    front = points[find_front(points)]
    others = run_study(
        make_study(sampling={"method": "random", "count": 600, "seed": 1}),
        tmp_path / "drawn",
        engine=SERIAL,
    ).read()
    drawn = others[others["feasible"]]
    tried = np.stack([drawn["needed_pressure_MPa"], -drawn["area_mm2"]], axis=1)
    # As many designs at random better hardly any of those found.
    bettered = (tried[:, np.newaxis] < front).all(axis=-1).any(axis=0)
    assert len(front) >= 5 and bettered.mean() < 0.2


def test_front_is_what_none_betters() -> None:
    from bozzini.plot.study import find_front

    points = np.random.default_rng(0).normal(size=(200, 2))
    front = set(find_front(points).tolist())
    for i, point in enumerate(points):
        others = np.delete(points, i, axis=0)
        assert (i in front) == (not (others <= point).all(axis=1).any())


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"job": "effector"}, "there is no job 'effector'"),
    ({"job": "no_such_module:f", "outputs": ["a"]}, "cannot be imported"),
    ({"job": "math:sqrt", "outputs": ["a"]}, "job 'math:sqrt' has no source in Python"),
    ({"job": "builtins:dict", "outputs": ["a"]}, "has no source in Python"),
    ({"job": "builtins:print", "outputs": ["a"]}, "has no source in Python"),
    ({"job": "numpy:sin", "outputs": ["a"]}, "has no source in Python"),
    ({"job": "operator:itemgetter", "outputs": ["a"]}, "no signature found"),
    ({"job": "sys:exit", "outputs": ["a"]}, "has no source in Python"),
    ({"job": "textwrap:dedent", "outputs": ["a"]}, "does not take the inputs deflection, preset"),
    ({"format": "x"}, "must be bozzini-study-1"),
    ({"factors": {}}, "factors is empty"),
    ({"factors": {"ofset": {"range": [1, 2]}}}, "did you mean 'offset'"),
    ({"factors": {"offset": {"range": ["2 mm", "1 mm"]}}}, "a lower and a higher"),
    ({"factors": {"offset": {"range": ["2 kg", "3 kg"]}}}, "wrong kind of unit"),
    ({"factors": {"offset": {"range": [1, 2], "values": [1]}}}, "range and values"),
    (
        {"factors": {"offset": {"range": ["-1 mm", "2 mm"]}}},
        "-1 mm: it must lie in .0.001, 1000. mm",
    ),
    ({"factors": {"offset": {"values": ["3 mm", "2 m"]}}}, "2000 mm: it must lie in"),
    ({"factors": {"offset": {"normal": [3, 1], "clip": [0, 4]}}}, "0 mm: it must lie in"),
    ({"factors": {"segments": {"integers": [0, 5]}}}, "0: it must lie in .1, 1000."),
    ({"factors": {"offset": {"normal": [1, 0]}}}, "standard deviation"),
    ({"factors": {"offset": {"values": []}}}, "empty"),
    ({"factors": {"segments": {"range": [1, 5]}}}, "give integers"),
    ({"factors": {"segments": {"values": [1.5]}}}, "whole numbers"),
    ({"fixed": {}, "factors": {"preset": {"range": [1, 5]}}}, "takes values or files"),
    ({"fixed": {"offset": "2 mm"}}, "fixed and a factor"),
    ({"fixed": {"preset": "x"}}, "must be one of measured, prototype, thesis"),
    ({"sampling": {"method": "grid", "count": 5}}, "a grid has none"),
    ({"sampling": {"method": "sobol"}}, "has no count"),
    ({"sampling": None}, "either sampling or search"),
    (
        {"job": "robot-sections", "fixed": {}, "factors": {"tension.T1": {"values": [1]}}},
        "no robot",
    ),
    (
        {
            "job": "insertion-feasibility",
            "factors": {"phantom": {"integers": [1, 2]}},
            "fixed": {"diameter": 5, "link_length": 5, "tract": "a.stl"},
        },
        "has tract and phantom: fix or vary tract or phantom",
    ),
    ({"outputs": ["volume"]}, "outputs has 'volume'"),
    ({"constraints": {"volume": {"at_most": 1}}}, "there is no output 'volume'"),
    ({"constraints": {"area": {"at_most": "1 mm"}}}, "wrong kind of unit"),
    ({"constraints": {"area": {"at_least": 2, "at_most": 1}}}, "no value is both"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG, ids=[message for _, message in WRONG])
def test_refusals(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(EFFECTOR | changes))
    with pytest.raises(BozziniError, match=message) as caught:
        Study.load(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_the_source_of_a_wrapped_function_is_found() -> None:
    class Callable:
        def __call__(self, x: float) -> float:
            return x

    wrapped = functools.lru_cache(functools.partial(functools.lru_cache(fail_at_three), power=1))
    for function in (fail_at_three, wrapped, Callable(), Callable):
        assert find_source(function) == __file__
    for function in (math.sqrt, len, dict, np.sin, functools.partial(math.sqrt), [].append):
        assert find_source(function) is None


def test_a_folder_of_another_study_is_refused(tmp_path: Path) -> None:
    run_study(make_function_study(), tmp_path / "out", engine=SERIAL)
    with pytest.raises(OutputError, match="holds another study"):
        run_study(make_function_study(fixed={"power": 1}), tmp_path / "out", engine=SERIAL)
    part = tmp_path / "out" / "rows" / "part-000000.parquet"
    (part.parent / "part-000009.parquet").write_bytes(part.read_bytes())
    with pytest.raises(OutputError, match="part-000009.parquet is none of the 1 parts"):
        run_study(make_function_study(), tmp_path / "out", engine=SERIAL)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(OutputError, match="holds other files"):
        run_study(make_function_study(), tmp_path / "mine", engine=SERIAL)


def test_schema_knows_every_field() -> None:
    schema = json.loads(json.dumps(make_schema(StudySpec, "study")))
    assert set(schema["properties"]) == set(StudySpec.__dataclass_fields__)
    factor = schema["properties"]["factors"]["additionalProperties"]
    assert {"range", "integers", "normal", "values", "files"} < set(factor["properties"])
    assert schema["required"] == ["format", "job", "factors"]
