"""Whether unions hang together: few questions, the same answer in any order."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bozzini.duct.search import find_split, link_gauges
from bozzini.duct.shapes import super_ellipses as super_ellipsoid
from bozzini.duct.shapes.super_ellipses import (
    SuperEllipses,
    SuperEllipsoids,
    dual_norm,
    join_norm,
    largest_radius,
    least_radius,
)
from bozzini.errors import GeometryError

SEEDS = st.integers(0, 10**6)


@given(seed=SEEDS, count=st.integers(1, 12), share=st.floats(0.0, 0.5))
def test_a_split_is_found_as_by_a_graph_with_few_questions(seed, count, share):
    random = np.random.default_rng(seed)
    overlap = np.triu(random.uniform(size=(count, count)) < share, 1)
    overlap |= overlap.T
    gaps = random.uniform(-1.0, 1.0, (count, count))
    gaps += gaps.T
    known = overlap & np.triu(random.uniform(size=(count, count)) < 0.5, 1)
    known |= known.T
    far = ~overlap & np.triu(random.uniform(size=(count, count)) < 0.5, 1)
    asked = []

    def meet(i, j):
        asked.append((i, j))
        return bool(overlap[i, j])

    split = find_split(gaps, meet, links=known, far=far | far.T)
    graph = nx.from_numpy_array(overlap)
    first = nx.node_connected_component(graph, 0)
    assert (split is None) == (len(first) == count)
    if split is not None:
        across = [(i, j) for i in first for j in range(count) if j not in first]
        least = min(gaps[pair] for pair in across)
        assert gaps[split] == least
        assert (split[0] in first) != (split[1] in first)
    assert len(set(asked)) == len(asked)
    assert not any(known[pair] or far[pair] for pair in asked)
    # Each yes joins two parts: there are no more of them than parts to join.
    joined = nx.number_connected_components(nx.from_numpy_array(known))
    assert sum(overlap[pair] for pair in asked) == joined - nx.number_connected_components(graph)


def test_neighbours_in_order_are_asked_first_then_the_nearest():
    gaps = np.abs(np.subtract.outer(np.arange(5.0), np.arange(5.0)))
    gaps[0, 4] = gaps[4, 0] = 0.5
    asked = []
    assert find_split(gaps, lambda i, j: bool(asked.append((i, j)))) == (0, 4)
    assert asked[:5] == [(0, 1), (1, 2), (2, 3), (3, 4), (0, 4)]
    assert len(asked) == 10


@given(seed=SEEDS, clearance=st.floats(0.0, 3.0))
def test_linked_shapes_share_a_point_of_the_line_between_their_centres(seed, clearance):
    random = np.random.default_rng(seed)
    duct = SuperEllipses(
        random.uniform(-8.0, 8.0, (2, 2)),
        random.uniform(0.5, 9.0, (2, 2)),
        powers=random.uniform(1.0, 20.0, 2),
        angles=random.uniform(-3.0, 3.0, 2),
        connected=False,
    )
    levels = 1.0 - clearance / duct.least_radii
    links, gaps = link_gauges(duct.centres, duct.evaluate_gauge(duct.centres), levels)
    line = duct.centres[0] + np.linspace(0.0, 1.0, 5001)[:, None] * np.diff(duct.centres, axis=0)
    off = (duct.evaluate_gauge(line) - levels).max(axis=1).min()
    step = np.linalg.norm(line[1] - line[0]) / duct.least_radii.min()
    if links[0, 1]:
        assert off <= step
        assert gaps[0, 1] <= 0.0
        assert duct.measure_seam(0, 1) >= clearance - 1e-4
    else:
        assert off > -1e-12
        assert gaps[0, 1] > 0.0 or levels.min() < 0.0


def chain(count=60):
    """A winding chain of long shapes, turned at random."""
    random = np.random.default_rng(4)
    s = np.linspace(0.0, 180.0, count)
    return {
        "centres": np.stack([s, 15.0 * np.sin(s / 15.0), 8.0 * np.cos(s / 20.0)], axis=1),
        "half_axes": random.uniform(4.0, 12.0, (count, 3)),
        "e1": random.uniform(0.2, 1.8, count),
        "e2": random.uniform(0.2, 1.8, count),
        "rotations": Rotation.random(count, random_state=1).as_matrix(),
    }


def test_shuffled_shapes_need_no_search(monkeypatch):
    def search(*_):
        pytest.fail("the lines between the centres are enough")

    monkeypatch.setattr(super_ellipsoid, "_overlap", search)
    order = np.random.default_rng(0).permutation(60)
    SuperEllipsoids(**{name: values[order] for name, values in chain().items()})


@pytest.mark.slow
@given(seed=SEEDS)
def test_the_order_of_shapes_does_not_matter(seed):
    random = np.random.default_rng(seed)
    count = 5
    shapes = {name: values[:count] for name, values in chain().items()}
    shapes["half_axes"] = shapes["half_axes"] * random.uniform(0.1, 0.5, (count, 3))

    def hangs(order):
        try:
            SuperEllipsoids(**{name: values[order] for name, values in shapes.items()})
        except GeometryError:
            return False
        return True

    assert hangs(np.arange(count)) == hangs(random.permutation(count))


@given(
    a=st.floats(0.1, 10.0),
    b=st.floats(0.1, 10.0),
    power=st.one_of(st.sampled_from([1.0, 2.0, 20.0]), st.floats(1.0, 20.0)),
    turn=st.floats(0.0, np.pi / 2.0),
)
def test_norms_and_radii_are_those_of_the_curve(a, b, power, turn):
    angle = np.linspace(0.0, np.pi / 2.0, 20_001)
    x, y = np.cos(angle), np.sin(angle)
    p = np.full_like(x, power)
    curve = np.stack([x, y]) / join_norm(x / a, y / b, p)
    radii = np.linalg.norm(curve, axis=0)
    one = [np.array([value]) for value in (a, b, power)]
    assert least_radius(*one)[0] == pytest.approx(radii.min(), rel=1e-5)
    assert largest_radius(*one)[0] == pytest.approx(radii.max(), rel=1e-5)
    way = np.array([np.cos(turn), np.sin(turn)])
    reach = dual_norm(*(np.array([value]) for value in (a * way[0], b * way[1], power)))[0]
    assert reach == pytest.approx((way @ curve).max(), rel=1e-5)
