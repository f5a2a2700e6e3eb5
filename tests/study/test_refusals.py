"""Refusals of the study package: one clear line with the field and the range, before any work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh

from bozzini.anatomy.surface import tract_from_surface
from bozzini.anatomy.tract import Component, LabelTract, Opening, SurfaceTract
from bozzini.duct import RoundCones
from bozzini.errors import GeometryError, InputError
from bozzini.motion import Scope
from bozzini.study import InsertionOptions, PathOptions, TractFitOptions, run_insertion
from bozzini.study.ends import resolve_places
from bozzini.study.traverse import run_limits
from tests.study.test_ends import COLON, make_tract

SCOPE = Scope(diameter=5.0, link_length=8.0)
TUBE = RoundCones([(0, 0, 0), (0, 0, 40)], [5.0, 5.0])
BALL = trimesh.creation.icosphere(subdivisions=2, radius=20.0)
FAR = (0.0, 0.0, -125.0)
MISSING = (Component(volume=37_700.0, point=FAR),)


@cache
def tract() -> LabelTract:
    return replace(
        make_tract(COLON, split=True),
        label_names={1: "sigmoid", 2: "transverse"},
        landmarks={"appendix orifice": FAR, "AO": FAR, "anus": tuple(COLON[0])},
        openings=(Opening(point=(0.0, 8.0, 50.0), radius=2.0, name="opening 1"),),
    )


@cache
def surface() -> SurfaceTract:
    return tract_from_surface(np.array(BALL.vertices), np.array(BALL.faces), source="ball")


def run(tract: LabelTract | SurfaceTract, *, inputs: Any = None, **options: Any) -> object:
    return run_insertion(tract, SCOPE, options=InsertionOptions(**options), inputs=inputs)


def find(name: str, place: str = "start", **change: Any) -> object:
    given = {"start": None, "end": None, "via": ()} | {place: (name,) if place == "via" else name}
    return resolve_places(replace(tract(), **change), given["start"], given["end"], given["via"])


def limit(**options: Any) -> object:
    fit = options.pop("fit", "")
    return run_limits(TUBE, PathOptions(**options), diameter=9.0, fit=fit)


@pytest.fixture(autouse=True)
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("the distance field is built")

    monkeypatch.setattr("bozzini.study.case.build_field", work)


# fmt: off
REFUSALS: list[tuple[Callable[[], object], type[InputError], str, str]] = [
    # Ends
    (lambda: run(tract(), start=9),
     InputError, "start is label 9, which is not in the lumen", "one of 1, 2"),
    (lambda: run(tract(), start=True),
     InputError, "start is True", "point (x, y, z) in mm, a name, or the"),
    (lambda: run(tract(), start=np.True_),
     InputError, "start is True", "point (x, y, z) in mm, a name, or the"),
    (lambda: run(tract(), end=[0.0, 1.0]), InputError, "end has shape (2,)", "(..., 3)"),
    (lambda: run(tract(), end=[0.0, 500.0, 0.0]),
     GeometryError, "end is (0, 500, 0) mm, which lies outside the lumen by 487",
     "give a point inside it"),
    (lambda: run(surface(), end=1),
     InputError, "end is label 1, but a surface has no labels", "give a point"),
    (lambda: find("AO"),
     GeometryError, "start is landmark 'AO', which lies outside the lumen by 64",
     "give a point inside it"),
    (lambda: find("AO", missing=MISSING),
     GeometryError, "start is landmark 'AO', which lies outside the lumen by 64",
     "(37.7 mL of lumen are missing in the file): give"),
    (lambda: find(FAR),
     GeometryError, "start is (0, 0, -125) mm, which lies outside the lumen by",
     "give a point inside it"),
    (lambda: find("no name"), InputError, "start is 'no name', which names nothing in this tract",
     "one of 1 (sigmoid), 2 (transverse), 'appendix orifice', 'anus', 'largest-opening', 'opening"),
    (lambda: find("caecum", place="end"),
     InputError, "end is 'caecum', which names nothing in this tract", "one of 1 (sigmoid), 2 "),
    (lambda: find("x", place="via", landmarks={}, openings=(), label_names={}),
     InputError, "via is 'x', which names nothing in this tract", "or one of 1, 2"),
    # The one label of a whole lumen is no place in it.
    (lambda: find("no name", labels=(tract().labels > 0).astype(np.uint16), label_names={}),
     InputError, "start is 'no name', which names nothing in this tract", "one of 'appendix ori"),
    # Options
    (lambda: run(tract(), soft_wall=-1.0), InputError, "soft wall is -1 mm", "[0, 100] mm"),
    (lambda: run(tract(), method="magic"),
     InputError, "method is 'magic'", "best, tube, follow, thesis"),
    (lambda: run(tract(), head_step=0.0), InputError, "head step is 0 mm", "[0.001, 10000] mm"),
    (lambda: run(tract(), head_step=9.0), InputError, "head step is 9 mm", "[0.001, 8] mm"),
    (lambda: run(tract(), slip=2.0), InputError, "slip is 2", "[0, 1]"),
    (lambda: run(tract(), angle_limit=4.0), InputError, "angle limit is 4 rad", "(0, 3.14159] rad"),
    (lambda: run(tract(), route=(0.0,)), InputError, "route is (0.0,)", "(0, 1]"),
    (lambda: run(tract(), route=[]), InputError, "route is ()", "(0, 1]"),
    (lambda: run(tract(), route="out"),
     InputError, "route is 'out'", "one of in, in-out, in-out-in"),
    (lambda: run(tract(), route=0.5), InputError, "route is 0.5", "a sequence of fractions"),
    (lambda: run(tract(), method="thesis", slip=0.5),
     InputError, "method 'thesis' has no slip, angle limit or route",
     "leave them out, or use one of best, tube,"),
    (lambda: run(tract(), inflate=-1.0), InputError, "inflation is -1 mm", "[0, 30] mm"),
    (lambda: run(tract(), voxel=0.0), InputError, "voxel is 0 mm", "[0.01, inf) mm"),
    (lambda: run(tract(), label_error=-1.0), InputError, "label error is -1 mm", "[0, 100] mm"),
    (lambda: run(tract(), inputs={"unit": 3}), InputError, "input.unit is 3", "text"),
    (lambda: run(tract(), inputs={"voxel_mm": -1.0}),
     InputError, "input.voxel_mm is -1 mm", "[0, 1e+06] mm"),
    (lambda: TractFitOptions(kind="boxes"),
     InputError, "kind is 'boxes'", "cones, cylinders, superellipsoids"),
    (lambda: TractFitOptions(max_error=0.0), InputError, "--max-error is 0 mm", "(0, inf) mm"),
    (lambda: TractFitOptions(pieces=0), InputError, "--pieces is 0", "[1, 500]"),
    # Shapes
    (lambda: limit(fit="tight"), InputError, "fit is 'tight'", "inscribed, least squares"),
    (lambda: limit(voxel=1e9),
     InputError, "voxel is 1e+09 mm", "it must not exceed the duct's smallest"),
    (lambda: limit(start=3),
     InputError, "start is label 3, but shapes have no labels and no named", "give a point"),
    (lambda: limit(via=((0, 0, 20),)), InputError, "via has no effect on shapes", "leave it out"),
]
# fmt: on
"""What is asked, the error, the field that the message names, and what it states as legal."""


@pytest.mark.parametrize(("call", "error", "field", "legal"), REFUSALS)
def test_refused(
    call: Callable[[], object], error: type[InputError], field: str, legal: str
) -> None:
    with pytest.raises(error) as caught:
        call()
    line = str(caught.value)
    assert line.startswith(field) and legal in line
    assert "\n" not in line and len(line) < 300
