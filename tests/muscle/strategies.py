"""Hypothesis strategies over most of the legal space of muscles and pressures.

Lengths run from 0.1 to 1000 mm, outer radii from 0.05 to 50 mm and moduli from 1e-6 to
1000 MPa: decades inside what is legal, which is 1e-3 to 1e4 mm, 1e-3 to 1e3 mm and from 1e-9 MPa.
There are always 30 strands, of 2 to 10,000.
"""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

from bozzini.muscle import Muscle
from bozzini.muscle.design import BRAID_ANGLES, PRESSURE_LIMIT

SHARES = st.floats(0.0, 1.0)


def spread(low: float, high: float) -> st.SearchStrategy[float]:
    """Floats between two positive ones, even in their logarithm."""
    return st.floats(math.log(low), math.log(high)).map(lambda x: min(max(math.exp(x), low), high))


@st.composite
def muscles(draw: Any, **fixed: Any) -> Muscle:
    """Any muscle of these ranges, with gap, friction and the like at their legal edges too."""
    outer = draw(spread(0.05, 50.0))
    muscle = Muscle(
        length=draw(spread(0.1, 1000.0)),
        outer_radius=outer,
        inner_radius=outer * draw(st.floats(0.0501, 0.989)),
        gap=0.0,
        strands=30,
        strand_modulus=3000.0,
        strand_radius=math.pi * outer / 30.0 * draw(st.floats(0.2, 0.99)),
        end_length=0.0,
        braid_angle=draw(st.floats(*BRAID_ANGLES)),
        modulus=draw(spread(1e-6, 1e3)),
        poisson_ratio=draw(st.sampled_from([0.0, 0.3, 0.49, 0.499, 0.499999])),
    )
    for name in ("gap", "friction_length", "mooney_ratio", "dead_length", "end_length"):
        _, high = muscle.legal_range(name)
        share = draw(st.one_of(st.sampled_from([0.0, 1.0]), SHARES))
        muscle = muscle.replace(**{name: high * share})
    return muscle.replace(**fixed)


def pressures(muscle: Muscle) -> st.SearchStrategy[float]:
    """Pressures from none to far above what matters for a muscle, and legal."""
    scale = muscle.modulus
    return st.one_of(
        st.just(0.0), spread(1e-5 * scale, 1e3 * scale).map(lambda p: min(p, PRESSURE_LIMIT))
    )
