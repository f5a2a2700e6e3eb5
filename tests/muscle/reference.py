"""Plain NumPy and SciPy versions of the muscle models, from the physics and not from the code."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad, solve_bvp, trapezoid
from scipy.optimize import minimize_scalar

from bozzini.muscle import Muscle

NODES, WEIGHTS = np.polynomial.legendre.leggauss(80)


def strain_energy(muscle: Muscle, stretch, swell, radius):
    """Energy density of the incompressible wall at a rest radius, from its principal stretches."""
    hoop = np.sqrt((radius**2 + swell) / stretch) / radius
    squares = [stretch**2, hoop**2, 1.0 / (stretch * hoop) ** 2]
    first = muscle.modulus / 6.0 * (1.0 - muscle.mooney_ratio)
    second = muscle.modulus / 6.0 * muscle.mooney_ratio
    inverse = sum(1.0 / square for square in squares)
    return first * (sum(squares) - 3.0) + second * (inverse - 3.0)


def wall_energy(muscle: Muscle, stretch: float, swell: float) -> float:
    """Energy per rest length over 2 pi, by adaptive quadrature."""
    value, _ = quad(
        lambda radius: radius * strain_energy(muscle, stretch, swell, radius),
        muscle.inner_radius,
        muscle.outer_radius,
        epsabs=0.0,
        epsrel=1e-13,
    )
    return value


def fast_wall_energy(muscle: Muscle, stretch: float, swell: float) -> float:
    """The same by Gauss's rule."""
    half = 0.5 * (muscle.outer_radius - muscle.inner_radius)
    radius = muscle.inner_radius + half * (1.0 + NODES)
    return half * float(np.sum(WEIGHTS * radius * strain_energy(muscle, stretch, swell, radius)))


def fill_of_braid(muscle: Muscle, stretch: float) -> float:
    """The swell of a tube that fills the braid, from the lengths of its strands."""
    strand = 1.0 / math.cos(muscle.braid_angle)
    turns = strand * math.sin(muscle.braid_angle) / (2.0 * math.pi * muscle.braid_radius)
    radius = math.sqrt(strand**2 - stretch**2) / (2.0 * math.pi * turns)
    return stretch * radius**2 - muscle.outer_radius**2


def held_energy(muscle: Muscle, pressure: float, stretch: float) -> float:
    """Least potential per active length at a stretch: the braid only bounds the swell above."""

    def potential(swell: float) -> float:
        wall = 2.0 * math.pi * fast_wall_energy(muscle, stretch, swell)
        return wall - pressure * math.pi * (muscle.inner_radius**2 + swell)

    top = fill_of_braid(muscle, stretch)
    bottom = -0.9999 * muscle.inner_radius**2
    step = 1e-6 * muscle.inner_radius**2
    if potential(top) < potential(top - step):
        return potential(top)
    found = minimize_scalar(
        potential, bounds=(bottom, top), method="bounded", options={"xatol": 1e-11, "maxiter": 500}
    )
    return float(found.fun)


def pull(muscle: Muscle, pressure: float, contraction: float) -> float:
    """The pull as the slope of the least potential in the length, by central differences."""
    stretch = 1.0 - contraction / muscle.active_length
    step = 1e-3

    def slope(h: float) -> float:
        ahead = held_energy(muscle, pressure, stretch + h)
        return (ahead - held_energy(muscle, pressure, stretch - h)) / (2.0 * h)

    return (64.0 * slope(step / 4) - 20.0 * slope(step / 2) + slope(step)) / 45.0


def taper(muscle: Muscle, pressure: float, load: float, stretch: float) -> float:
    """By how much one trellis end is shorter than its strands on the cylinder [mm].

    Hamilton's equations of the net along a strand, as a boundary value problem.
    """
    c0, s0, end = (
        math.cos(muscle.braid_angle),
        math.sin(muscle.braid_angle),
        muscle.braid_radius,
    )
    rate = s0 / end

    def wall(radius: float) -> float:
        local = math.sqrt(1.0 - (rate * radius) ** 2) / c0
        swell = local * radius**2 - muscle.outer_radius**2
        return 2.0 * math.pi * c0 * fast_wall_energy(muscle, local, swell)

    def parts(radius, momentum):
        push = pressure * math.pi * radius**2 + load
        square = 1.0 - (rate * radius) ** 2
        outward = -momentum * np.sqrt(square / (push**2 + momentum**2))
        return push, outward, np.sqrt(square - outward**2)

    def equations(_, state):
        radius, momentum = state
        push, outward, along = parts(radius, momentum)
        h = 1e-5
        wall_slope = [(wall(r + h) - wall(r - h)) / (2.0 * h) for r in radius]
        change = 2.0 * math.pi * pressure * radius * along - push * rate**2 * radius / along
        return np.array([outward, change - wall_slope])

    cylinder = math.sqrt(1.0 - (stretch * c0) ** 2) / rate
    span = 30.0 * end / math.tan(math.asin(rate * cylinder)) ** 2
    strand = np.linspace(0.0, span, 400)
    guess = cylinder + (end - cylinder) * np.exp(-strand / (0.1 * span))
    found = solve_bvp(
        equations,
        lambda first, last: np.array([first[0] - end, last[0] - cylinder]),
        strand,
        np.array([guess, np.zeros_like(guess)]),
        tol=1e-8,
        max_nodes=20000,
    )
    assert found.success
    fine = np.linspace(0.0, span, 20001)
    _, _, along = parts(*found.sol(fine))
    return float(trapezoid(stretch * c0 - along, fine))
