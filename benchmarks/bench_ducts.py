"""Planar ducts: the signed distance at 100,000 points in every representation of one pipe."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bozzini.duct import (
    BetweenCurves,
    Circles,
    Duct,
    Polygon,
    StitchedQuads,
    SuperEllipses,
    union,
    without,
)

POINTS = 100_000
LENGTH = 200.0


def middle(x: np.ndarray) -> np.ndarray:
    return np.stack([x, 12.0 * np.sin(x / 30.0)], axis=-1)


def side(x: np.ndarray, half: float) -> np.ndarray:
    return middle(x) + np.array([0.0, half])


def make_quads() -> StitchedQuads:
    x = np.linspace(0.0, LENGTH, 31)
    return StitchedQuads(side(x, 8.0), side(x, -8.0))


def make_polygon() -> Polygon:
    return make_quads().outline


def make_curves() -> BetweenCurves:
    return BetweenCurves(
        lambda x: side(x, -8.0), lambda x: side(x, 8.0), span=(0.0, LENGTH), tolerance=0.01
    )


def make_ellipses() -> SuperEllipses:
    x = np.linspace(0.0, LENGTH, 31)
    slope = np.arctan(0.4 * np.cos(x / 30.0))
    return SuperEllipses(middle(x), np.full((31, 2), 8.0), powers=np.full(31, 4.0), angles=slope)


def make_obstacles() -> Duct:
    return without(make_ellipses(), Circles(middle(np.array([60.0, 120.0])), [2.0, 3.0]))


def make_union() -> Duct:
    return union(make_ellipses(), make_quads())


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("31 super-ellipses", make_ellipses),
        ("30 stitched quads", make_quads),
        ("polygon of 62 edges", make_polygon),
        ("two curves to 0.01 mm", make_curves),
        ("super-ellipses less two circles", make_obstacles),
        ("union of super-ellipses and quads", make_union),
        ("sampled every 0.5 mm", lambda: make_ellipses().sample(0.5)),
    ],
)
def bench_signed_distance_in_the_plane(benchmark: Any, name: str, make: Callable[[], Duct]) -> None:
    duct = make()
    points = np.random.default_rng(0).uniform(*duct.bounds, (POINTS, 2))
    benchmark.pedantic(duct.signed_distance, args=(points,), rounds=9, warmup_rounds=1)
    took = benchmark.stats.stats.min / POINTS
    benchmark.extra_info.update(
        what=f"signed distance at a point of a planar duct, {name}",
        measured=f"{took * 1e6:.2f} µs",
    )
