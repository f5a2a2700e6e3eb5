"""Planar bends: as a duct, as a formula, and links in them by brute force."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy import ndimage

from bozzini.duct import Centreline, Polygon


def bend_line(radius, angle, limb, count=120):
    """A limb, an arc around the origin, a limb: points (n, 2), turning to the right."""
    turns = np.linspace(0.0, angle, count + 1)
    arc = radius * np.stack([-np.cos(turns), np.sin(turns)], axis=1)
    ahead = np.array([math.sin(angle), math.cos(angle)])
    return np.concatenate([[arc[0] - [0.0, limb]], arc, [arc[-1] + limb * ahead]])


def bend_duct(radius, half_width, angle, limb, *, inset, count=120, spacing=None):
    """The bend as a polygon, and its centreline, which stops `inset` mm before the closed ends.

    The arcs are polygons around the circles, outer ones circumscribed: within count^-2 of them.
    """
    outer = bend_line(radius + half_width, angle, limb, count)
    inner = bend_line(radius - half_width, angle, limb, count)
    duct = Polygon(np.concatenate([outer, inner[::-1]]))
    way = bend_line(radius, angle, limb - inset, count)
    return duct, Centreline.from_points(way, duct, spacing=spacing or radius / 30.0)


@njit(cache=True)
def bend_room(x, y, inner, outer, angle):
    """Clearance of a point to the walls of an endless bend of at most 180 degrees."""
    sine, cosine = math.sin(angle), math.cos(angle)
    rho = math.sqrt(x * x + y * y)
    # Polar angle along the bend; in the upper part the bend itself.
    turn = math.atan2(y, -x)
    if 0.0 <= turn <= angle:
        return min(rho - inner, outer - rho)
    # Beyond its ends: the limb that is nearer, each a strip beyond its end.
    best = -1e9
    if y <= 0.0:
        best = max(best, min(-x - inner, outer + x))
    along = x * sine + y * cosine
    if along >= 0.0 and turn > angle or along >= 0.0 and turn < angle - math.pi:
        across = -x * cosine + y * sine
        best = max(best, min(across - inner, outer - across))
    return best


@njit(cache=True)
def fill_free(free, low, pitch, headings, length, radius, inner, outer, angle, pad):
    """Mark the poses (x, y of the middle, heading) at which the link is clear by `pad`."""
    grain = 0.02 * (outer - inner)
    for i in range(free.shape[0]):
        for j in range(free.shape[1]):
            x, y = low[0] + i * pitch, low[1] + j * pitch
            if bend_room(x, y, inner, outer, angle) < radius + pad:
                continue
            for k in range(free.shape[2]):
                dx, dy = math.cos(headings[k]), math.sin(headings[k])
                clear = True
                for sign in (1.0, -1.0):
                    t = 0.5 * length
                    while clear and t > 0.0:
                        room = bend_room(x + sign * t * dx, y + sign * t * dy, inner, outer, angle)
                        if room < radius + pad:
                            clear = False
                        t -= max(room - radius - pad, grain)
                free[i, j, k] = clear


def link_passes(length, *, bend, pad, nodes, turns):
    """Whether a link gets from one limb to the other, by the components of its poses.

    A positive `pad` asks for more room, a negative one for less.
    """
    inner, outer = bend.radius - bend.half_width, bend.radius + bend.half_width
    pitch = bend.half_width / nodes
    limb = 0.75 * length
    low = np.array([-outer, -limb])
    far = bend_line(outer, bend.angle, limb)
    high = np.maximum(far.max(axis=0), [0.0, outer])
    counts = np.ceil((high - low) / pitch).astype(int) + 1
    # Headings from along the first limb (pi/2) to along the last (pi/2 - angle), and some more.
    spare = 0.3
    headings = np.linspace(0.5 * math.pi - bend.angle - spare, 0.5 * math.pi + spare, turns)
    free = np.zeros((*counts, turns), dtype=np.bool_)
    fill_free(free, low, pitch, headings, length, bend.body_radius, inner, outer, bend.angle, pad)
    marks, _ = ndimage.label(free, structure=np.ones((3, 3, 3)))
    start = [round((-bend.radius - low[0]) / pitch), round((-0.6 * length - low[1]) / pitch)]
    ahead = np.array([math.sin(bend.angle), math.cos(bend.angle)])
    goal = bend.radius * np.array([-math.cos(bend.angle), math.sin(bend.angle)])
    goal = np.rint((goal + 0.6 * length * ahead - low) / pitch).astype(int)
    first = marks[start[0], start[1], int(np.argmin(abs(headings - 0.5 * math.pi)))]
    last = marks[goal[0], goal[1], int(np.argmin(abs(headings - 0.5 * math.pi + bend.angle)))]
    return bool(first > 0 and first == last)


def pull_joints(length, *, bend, links=1, step=0.01, jump=0.5):
    """Pull a chain round a U turn, joints alone inside, each tail moving least (thesis 5.3).

    Returns whether all of it gets into the far limb without a jump of a tail, and the deepest cut
    of a link into the inner wall.
    """
    a, b, c = bend.inner, bend.outer, bend.radius
    joints = np.array([[-c, -length * (k + 1.0)] for k in range(links + 1)])
    way = np.arange(0.0, length + math.pi * c + 2.0 * length, step)
    depth = 0.0
    for s in way:
        head = s - length
        turn = min(max(head / c, 0.0), math.pi)
        beyond = max(head - math.pi * c, 0.0)
        joints[0] = [-c * math.cos(turn), c * math.sin(turn) + min(head, 0.0) - beyond]
        for k in range(1, links + 1):
            placed = _place_nearest(joints[k - 1], joints[k], length, a, b)
            if placed is None or np.linalg.norm(placed - joints[k]) > jump:
                return False, depth
            joints[k] = placed
            depth = max(depth, a - _distance_to_middle(joints[k - 1], placed))
    return bool(np.all(joints[:, 0] > 0.0)), depth


def _place_nearest(head, tail, length, a, b):
    """The nearest place at a distance from the head whose joint is inside; candidates in turn."""
    aim = tail - head
    free = head + length * aim / np.linalg.norm(aim)
    if _inside(free, a, b):
        return free
    found = [point for r in (a, b) for point in _cross_wall(head, length, r)]
    found = [point for point in found if _inside(point, a, b)]
    return min(found, key=lambda p: np.linalg.norm(p - tail)) if found else None


def _inside(point, a, b):
    x, y = point
    off = math.hypot(x, y) if y >= 0.0 else abs(x)
    return a - 1e-9 <= off <= b + 1e-9


def _cross_wall(head, length, r):
    """Where the circle around the head meets the wall of radius r, and its limbs."""
    size = math.hypot(*head)
    along = (size**2 + r**2 - length**2) / (2.0 * size)
    if r * r - along * along >= 0.0:
        off = math.sqrt(r * r - along * along)
        unit = head / size
        for sign in (1.0, -1.0):
            point = along * unit + sign * off * np.array([-unit[1], unit[0]])
            if point[1] >= 0.0:
                yield point
    for x in (-r, r):
        square = length**2 - (x - head[0]) ** 2
        if square >= 0.0:
            for sign in (1.0, -1.0):
                point = np.array([x, head[1] + sign * math.sqrt(square)])
                if point[1] <= 0.0:
                    yield point


def _distance_to_middle(one, other):
    """Distance of a segment from the inner wall's middle; from its limbs' middle line below."""
    along = other - one
    u = min(max(-(one @ along) / (along @ along), 0.0), 1.0)
    point = one + u * along
    return float(np.hypot(*point)) if point[1] >= 0.0 else math.inf
