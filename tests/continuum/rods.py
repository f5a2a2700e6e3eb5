"""Robots and independent routes for the tests of the energy and the rod model."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from bozzini.continuum import ContinuumRobot, Helix, Section, Tendon

LENGTH = 100.0
BENDING, TORSION = 1000.0, 770.0


def make_robot(
    tendons, *, discs=20, sections=1, stiffness=(BENDING, TORSION), radius=10.0, **other
):
    """One section with these tendons, or several with one list of tendons each."""
    lists = [tendons] if sections == 1 else tendons
    return ContinuumRobot(
        tuple(
            Section(
                length=LENGTH / sections,
                radius=radius,
                tendons=tuple(own),
                discs=discs,
                bending_stiffness=stiffness[0],
                torsional_stiffness=stiffness[1],
                **other,
            )
            for own in lists
        )
    )


def cross_tendons(count=4, offset=4.0, angle=0.0, prefix="t", **other):
    """Parallel tendons, evenly around the backbone."""
    return [
        Tendon(name=f"{prefix}{k}", offset=offset, angle=angle + 2.0 * math.pi * k / count, **other)
        for k in range(count)
    ]


def helix(name, turns, angle=0.0, offset=4.0):
    return Tendon(name=name, offset=offset, angle=Helix(turns=turns, start=angle), end=LENGTH)


def taper(name, angle=0.0, start=6.0, end=2.0):
    return Tendon(name=name, offset=((0.0, start), (LENGTH, end)), angle=angle)


def draw_robot(rng, pushes):
    """A robot of 1 to 3 sections with tendons of any routing, a share of them rods."""
    sections, start = [], 0.0
    for index in range(int(rng.integers(1, 4))):
        length, tendons = float(rng.uniform(30.0, 70.0)), []
        for number in range(int(rng.integers(2, 5))):
            end = start + length * float(rng.choice([1.0, 1.0, 0.6]))
            angle = float(rng.uniform(0.0, 7.0))
            if rng.random() >= 0.4:
                angle = ((0.0, angle), (end, angle + float(rng.uniform(-3.0, 3.0))))
            places = (0.0, 0.5 * end, end)
            offset = float(rng.uniform(2.0, 5.0)) if rng.random() < 0.5 else ()
            if offset == ():
                offset = tuple(zip(places, rng.uniform(2.0, 5.0, 3), strict=True))
            tendons.append(
                Tendon(
                    name=f"t{index}{number}",
                    offset=offset,
                    angle=angle,
                    end=end,
                    pushes=bool(rng.random() < pushes),
                    interpolation=str(rng.choice(["linear", "cubic"])),
                )
            )
        sections.append(
            Section(
                length=length,
                radius=6.0,
                discs=int(rng.integers(10, 20)),
                bending_stiffness=rng.uniform(100.0, 800.0),
                tendons=tuple(tendons),
            )
        )
        start += length
    return ContinuumRobot(tuple(sections))


def draw_command(rng, robot):
    """Displacements of its tendons [mm], rather let out than pulled."""
    return 1.5 * rng.normal(size=len(robot.tendons)) - 1.0


ROUTINGS = {
    "parallel pair": (
        (Tendon(name="a", offset=4.0), Tendon(name="b", offset=4.0, angle=1.5708)),
        (3.0, 3.0),
    ),
    "taper": ((taper("a"),), (4.0,)),
    "taper pair": ((taper("a"), taper("b", 0.5 * math.pi)), (4.0, 2.0)),
    "quarter-turn pair": ((helix("a", 0.25), helix("b", 0.25, 0.5 * math.pi)), (3.0, 3.0)),
    "full-turn helix": ((helix("a", 1.0),), (6.0,)),
    "full-turn pair": ((helix("a", 1.0), helix("b", 1.0, 0.5 * math.pi)), (4.0, 3.0)),
    "straight and full turn": (
        (Tendon(name="a", offset=4.0), helix("b", 1.0, 0.5 * math.pi)),
        (3.0, 3.0),
    ),
}
"""Tendons and the tensions [N] that the rod is put under."""


def cross_matrix(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def place_tendon(tendon, s, h=1e-4):
    """Place, slope and second derivative (3,) of a tendon in the cross-section's frame."""
    s = min(max(s, h), LENGTH - h)
    path = tendon.place_at(np.array([s - h, s, s + h]))
    slope = tendon.slope_at(np.array([s - h, s, s + h]))
    return (
        np.append(path[1], 0.0),
        np.append(slope[1], 0.0),
        np.append((slope[2] - slope[0]) / (2.0 * h), 0.0),
    )


def follow_law(tendons, tensions):
    """Tip and displacements by ``K u = -sum T r x t``, without load: a Picard iteration per s."""
    stiff = np.array([BENDING, BENDING, TORSION])
    axis = np.array([0.0, 0.0, 1.0])

    def rates(s, y):
        places = [
            (np.append(tendon.place_at(s), 0.0), np.append(tendon.slope_at(s), 0.0))
            for tendon in tendons
        ]
        u = np.zeros(3)
        for _ in range(500):
            moment = np.zeros(3)
            for (r, slope), pull in zip(places, tensions, strict=True):
                way = axis + np.cross(u, r) + slope
                moment -= pull * np.cross(r, way / np.linalg.norm(way))
            u, before = moment / stiff, u
            if np.abs(u - before).max() < 1e-14:
                break
        turn = y[3:12].reshape(3, 3)
        shorter = [
            np.linalg.norm(axis + slope) - np.linalg.norm(axis + np.cross(u, r) + slope)
            for r, slope in places
        ]
        return np.concatenate([turn[:, 2], (turn @ cross_matrix(u)).ravel(), shorter])

    start = np.concatenate([np.zeros(3), np.eye(3).ravel(), np.zeros(len(tensions))])
    done = solve_ivp(rates, (0.0, LENGTH), start, rtol=1e-9, atol=1e-10, method="DOP853")
    return done.y[:3, -1], done.y[12:, -1]


def integrate_published(tendons, tensions, force, moment, base_moment, *, axial=1e6, shear=1e5):
    """Rucker and Webster (2011), eq. 14 to 20, from the base on: tip, and what is off at the end.

    With shear and stretch, as an initial-value problem under a base moment that is given. The
    last two are the errors of force [N] and moment [N mm] against the boundary conditions.
    """
    stiff, bend = np.diag([shear, shear, axial]), np.diag([BENDING, BENDING, TORSION])
    axis = np.array([0.0, 0.0, 1.0])

    def strain(values, s, turn, inner_force, inner_moment):
        v, u = values[:3], values[3:]
        f, m = stiff @ (v - axis), bend @ u
        for tendon, pull in zip(tendons, tensions, strict=True):
            r, slope, _ = place_tendon(tendon, s)
            way = v + np.cross(u, r) + slope
            way = pull * way / np.linalg.norm(way)
            f, m = f + way, m + np.cross(r, way)
        return np.concatenate([f - turn.T @ inner_force, m - turn.T @ inner_moment])

    def rates(s, y):
        turn, v, u = y[3:12].reshape(3, 3), y[12:15], y[15:18]
        whole = np.zeros((6, 6))
        whole[:3, :3], whole[3:, 3:] = stiff, bend
        right = np.concatenate(
            [
                -np.cross(u, stiff @ (v - axis)),
                -np.cross(u, bend @ u) - np.cross(v, stiff @ (v - axis)),
            ]
        )
        for tendon, pull in zip(tendons, tensions, strict=True):
            r, slope, second = place_tendon(tendon, s)
            way = np.cross(u, r) + slope + v
            hat = cross_matrix(way)
            a_part = -pull * hat @ hat / np.linalg.norm(way) ** 3
            b_part = cross_matrix(r) @ a_part
            bent = a_part @ (np.cross(u, way) + np.cross(u, slope) + second)
            whole[:3, :3] += a_part
            whole[3:, :3] += b_part
            whole[:3, 3:] -= a_part @ cross_matrix(r)
            whole[3:, 3:] -= b_part @ cross_matrix(r)
            right -= np.concatenate([bent, np.cross(r, bent)])
        change = np.linalg.solve(whole, right)
        return np.concatenate([turn @ v, (turn @ cross_matrix(u)).ravel(), change])

    first = fsolve(
        strain, [0, 0, 1, 0, 0, 0], args=(0.0, np.eye(3), force, base_moment), xtol=1e-13
    )
    start = np.concatenate([np.zeros(3), np.eye(3).ravel(), first])
    done = solve_ivp(rates, (0.0, LENGTH), start, rtol=1e-8, atol=1e-9, method="DOP853")
    end = done.y[:, -1]
    off = strain(end[12:], LENGTH, end[3:12].reshape(3, 3), force, moment)
    return end[:3], off[:3], off[3:]


def bend_cantilever(force):
    """Sideways and axial place of the end under a force across the straight rod: the elastica.

    With elliptic integrals (Bisshopp and Drucker 1945); parameter m = k^2.
    """
    load = math.sqrt(force * LENGTH**2 / BENDING)

    def miss(m):
        return ellipk(m) - ellipkinc(math.asin(min(1.0, 1.0 / math.sqrt(2.0 * m))), m) - load

    m = brentq(miss, 0.5 + 1e-13, 1.0 - 1e-13, xtol=1e-15)
    least = math.asin(1.0 / math.sqrt(2.0 * m))
    sideways = LENGTH * (1.0 - 2.0 / load * (ellipe(m) - ellipeinc(least, m)))
    return sideways, LENGTH * math.sqrt(2.0 * (2.0 * m - 1.0)) / load


def chain_linkage(shortening, count, offset=4.0):
    """Tip of the thesis's 7-bar chain by reflections, for tendons at 0 and 90 degrees."""
    part = np.asarray(shortening) / (2.0 * offset * count)
    m = np.append(part, math.sqrt(1.0 - part @ part))
    turn = (np.eye(3) - 2.0 * np.outer(m, m)) @ np.diag([1.0, 1.0, -1.0])
    place, frame = np.zeros(3), np.eye(3)
    for _ in range(count):
        place = place + LENGTH / count * frame @ m
        frame = frame @ turn
    return place
