"""The rule behind the phantom: its legs, its radii, and what would make it unclean."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ._line import Leg, measure_turn

__all__ = ["HEADINGS", "compute_radii", "find_fault", "plan_legs"]

LIMB_GAP = 8.0
"""Smallest gap between two limbs of a valid phantom [mm]."""

BEND_GAP = 6.0
"""Smallest difference of bend radius and lumen radius in a valid phantom [mm]."""

# Headings (right, front, up): the lumen goes down the back, turns left and forward into the
# stomach, sweeps right through the J, backs up to the pylorus and rounds the C of the duodenum.
HEADINGS = {
    "upper": (0.0, -0.08, -1.0),
    "lower": (-0.05, 0.12, -1.0),
    "hiatus": (-0.45, 0.30, -1.0),
    "body": (-0.22, 0.25, -1.0),
    "antrum": (0.90, -0.25, 0.30),
    "superior": (0.75, -0.60, 0.20),
    "descending": (0.05, -0.12, -1.0),
    "horizontal": (-1.0, 0.12, 0.05),
    "ascending": (-0.45, 0.25, 0.85),
}


def plan_legs(
    size: Mapping[str, float], headings: Mapping[str, tuple[float, float, float]]
) -> tuple[list[Leg], str]:
    """Share the lengths of the parts out among straight pieces and bends."""
    names = list(HEADINGS)
    flexure, wide = size["flexure_bend"], 120.0
    bend = {
        "upper": 0.0, "lower": wide, "hiatus": wide / 2, "body": 1.5 * size["stomach_bend"],
        "antrum": size["stomach_bend"], "superior": 1.5 * flexure, "descending": flexure,
        "horizontal": flexure, "ascending": flexure,
    }  # fmt: skip
    arc = {names[0]: 0.0}
    for before, name in zip(names[:-1], names[1:], strict=True):
        arc[name] = bend[name] * measure_turn(headings[before], headings[name])
    gullet = size["oesophagus_length"] - arc["lower"] - arc["hiatus"]
    stomach = size["stomach_length"] - arc["body"] - arc["antrum"]
    straight = {
        "upper": 0.5 * gullet,
        "lower": 0.4 * gullet,
        "hiatus": 0.1 * gullet,
        "body": 0.62 * stomach,
        "antrum": 0.38 * stomach,
        "superior": size["superior_length"] - arc["superior"] - arc["descending"] / 2,
        "descending": size["descending_length"] - (arc["descending"] + arc["horizontal"]) / 2,
        "horizontal": size["horizontal_length"] - (arc["horizontal"] + arc["ascending"]) / 2,
        "ascending": size["ascending_length"] - arc["ascending"] / 2,
    }
    least = min(straight, key=lambda name: straight[name])
    fault = ""
    if straight[least] < 1.0:
        fault = f"no room for the bends of the {least} part"
        straight = {name: max(length, 1.0) for name, length in straight.items()}
    legs = [Leg(heading=headings[name], bend=bend[name], straight=straight[name]) for name in names]
    return legs, fault


def compute_radii(
    along: NDArray[np.float64], size: Mapping[str, float], junction: float, pylorus: float
) -> NDArray[np.float64]:
    """Return the radius along the line, eased between knots [mm]."""
    stomach = pylorus - junction
    gullet, body, antrum = (
        size[name] / 2 for name in ("oesophagus_diameter", "body_diameter", "antrum_diameter")
    )
    narrow, bowel = size["pylorus_diameter"] / 2, size["duodenum_diameter"] / 2
    knots = [
        (0.0, gullet),
        (junction, gullet),
        (junction + 0.26 * stomach, body),
        (junction + 0.40 * stomach, body),
        (junction + 0.68 * stomach, antrum),
        (junction + 0.80 * stomach, antrum),
        (pylorus - 4.0, narrow),
        (pylorus + 3.0, narrow),
        (pylorus + 22.0, 1.06 * bowel),  # the bulb
        (pylorus + 50.0, bowel),
        (float(along[-1]), bowel),
    ]
    places = np.array([place for place, _ in knots])
    values = np.array([value for _, value in knots])
    left = np.clip(np.searchsorted(places, along, side="right") - 1, 0, len(places) - 2)
    part = np.clip((along - places[left]) / (places[left + 1] - places[left]), 0.0, 1.0)
    ease = part * part * (3.0 - 2.0 * part)
    return np.asarray(values[left] + ease * (values[left + 1] - values[left]))


def find_fault(
    points: NDArray[np.float64],
    radii: NDArray[np.float64],
    bends: NDArray[np.float64],
    along: NDArray[np.float64],
) -> str:
    """Say why the union of balls would not be a clean tube, or nothing."""
    slope = np.abs(np.diff(radii) / np.diff(along))
    if slope.max() > 0.9:
        return f"the radius changes by {slope.max():.2f} mm per mm"
    room = float((bends - radii).min())
    if room < BEND_GAP:
        return f"a bend is only {room:.1f} mm wider than its lumen, at least {BEND_GAP:g} is legal"
    between = np.linalg.norm(points[:, None] - points[None], axis=2)
    reach = radii[:, None] + radii[None]
    # Samples so far apart along the line cannot be neighbours around one bend.
    limbs = np.abs(along[:, None] - along[None]) > 0.5 * math.pi * (reach + LIMB_GAP)
    gap = float(np.where(limbs, between - reach, np.inf).min())
    if gap < LIMB_GAP:
        return f"two limbs are {gap:.1f} mm apart, at least {LIMB_GAP:g} is legal"
    return ""
