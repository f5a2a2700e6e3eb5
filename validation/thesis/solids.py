"""The thesis's constraint functions of solid ducts (5.3.3, appendix B), as printed, to compare.

None of them is a distance: they have no unit, or change faster than the place does, and two of
them push the wrong way. The ducts of `bozzini.duct` answer in their stead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bozzini.checks import check_array, check_number, check_points
from bozzini.errors import InputError


def super_ellipsoid_form(
    points: ArrayLike, half_axes: ArrayLike, *, e: float, n: float
) -> NDArray[np.float64]:
    """Return eq. 5.30 at points (..., 3) of the shape's own frame; negative inside, no unit.

    With absolute values, which the print leaves out: a negative number has no broken power. The
    exponents are those of `SuperEllipsoids`, ``e2 = e`` and ``e1 = n``: an ellipsoid has 1 and 1,
    where the plane's eq. 5.16 has n = 2.
    """
    array = np.abs(check_points("points", points))
    sides = check_points("half axes", half_axes)
    check_number("e", e, low=0.0, low_open=True)
    check_number("n", n, low=0.0, low_open=True)
    if sides.shape != (3,) or sides.min() <= 0.0:
        raise InputError(f"half axes are {sides.tolist()} mm: three numbers in (0, inf) mm")
    x, y, z = np.moveaxis(array / sides, -1, 0)
    across = (x ** (2.0 / e) + y ** (2.0 / e)) ** (e / n)
    return np.asarray((across + z ** (2.0 / n)) ** (n / 2.0) - 1.0)


@dataclass(frozen=True)
class PrintedCircle:
    """A circle of appendix B.

    Parameters
    ----------
    centre : (3,) float
        [mm].
    radius : float
        [mm].
    phi1, phi2 : float
        Turn of the plane [rad]: about X by phi1 after about Y by phi2, as the printed m_i and n_i
        have it (the text names the axes the other way round).
    """

    centre: tuple[float, float, float]
    radius: float
    phi1: float
    phi2: float

    def __post_init__(self) -> None:
        centre = check_points("centre", self.centre)
        object.__setattr__(self, "centre", tuple(centre.tolist()))
        check_number("radius", self.radius, low=0.0, low_open=True, unit="mm")
        check_number("phi1", self.phi1)
        check_number("phi2", self.phi2)

    @property
    def frame(self) -> NDArray[np.float64]:
        """(3, 3): as columns the spoke of angle 0, that of a right angle, and the normal."""
        c1, s1 = np.cos(self.phi1), np.sin(self.phi1)
        c2, s2 = np.cos(self.phi2), np.sin(self.phi2)
        return np.array([[c2, 0.0, s2], [s1 * s2, c1, -s1 * c2], [-c1 * s2, s1, c1 * c2]])


def cylinder_point(
    start: PrintedCircle, stop: PrintedCircle, *, u: ArrayLike, t: ArrayLike, theta: ArrayLike
) -> NDArray[np.float64]:
    """Return the points (..., 3) of eqs 6.3-6.5: equal angles of both circles' frames joined."""
    share, along, angle = (check_array(k, v) for k, v in (("u", u), ("t", t), ("theta", theta)))
    turn = np.stack(np.broadcast_arrays(share * np.cos(angle), share * np.sin(angle)), axis=-1)
    ends = [
        np.asarray(circle.centre) + circle.radius * turn @ circle.frame[:, :2].T
        for circle in (start, stop)
    ]
    return np.asarray((1.0 - along)[..., None] * ends[0] + along[..., None] * ends[1])


def measure_pinch(start: PrintedCircle, stop: PrintedCircle) -> float:
    """Return the least radius of the printed wall, by the smaller of the circles' radii.

    1 without twist between the frames and no taper; 0 where the wall crosses its own axis.
    """
    from scipy.optimize import minimize_scalar

    one, two = (circle.radius * circle.frame[:, :2] for circle in (start, stop))

    def measure_narrowest(t: float) -> float:
        return float(np.linalg.svd((1.0 - t) * one + t * two, compute_uv=False)[-1])

    places = np.linspace(0.0, 1.0, 101)
    radii = [measure_narrowest(t) for t in places]
    k = int(np.argmin(radii))
    around = (places[max(k - 1, 0)], places[min(k + 1, 100)])
    near = minimize_scalar(
        measure_narrowest, bounds=around, method="bounded", options={"xatol": 1e-12}
    )
    return min(radii[k], float(near.fun)) / min(start.radius, stop.radius)


def invert_cylinder(
    start: PrintedCircle, stop: PrintedCircle, point: ArrayLike
) -> list[tuple[float, float, float]]:
    """Return all (t, u, theta) of eqs 6.3-6.5 at a point (3,), in closed form.

    The point lies in the plane of the blended spokes a(t), b(t) where ``det[x - c(t), a(t), b(t)]
    = 0``, a cubic in t whichever frames the circles have; u and theta are then linear. The thesis
    (5.3.5) takes a numerical solution to be needed.
    """
    x = check_points("point", point)
    c = np.array([start.centre, np.subtract(stop.centre, start.centre)])
    a, b = (
        np.array(
            [
                start.radius * start.frame[:, k],
                stop.radius * stop.frame[:, k] - start.radius * start.frame[:, k],
            ]
        )
        for k in range(2)
    )
    w = np.array([x - c[0], -c[1]])
    cubic = np.zeros(4)
    for i in range(2):
        for j in range(2):
            for k in range(2):
                cubic[3 - i - j - k] += w[i] @ np.cross(a[j], b[k])
    answers = []
    for root in np.roots(cubic):
        if abs(root.imag) > 1e-9 * max(1.0, abs(root)):
            continue
        t = float(root.real)
        spokes = np.stack([a[0] + t * a[1], b[0] + t * b[1]], axis=1)
        (p, q), *_ = np.linalg.lstsq(spokes, w[0] + t * w[1], rcond=None)
        answers.append((t, float(np.hypot(p, q)), float(np.arctan2(q, p))))
    return sorted(answers)


def cylinder_form(circles: list[PrintedCircle], points: ArrayLike) -> NDArray[np.float64]:
    """Return eq. 5.32 at points (..., 3): the sum of ``u_i - 1`` over segments with t in [0, 1].

    No unit; 0 beside every segment. With `measure_pinch` well above 0 a segment holds a point at
    most once; of several roots the smallest u counts.
    """
    array = check_points("points", points)
    flat = array.reshape(-1, 3)
    total = np.zeros(len(flat))
    for start, stop in zip(circles[:-1], circles[1:], strict=True):
        for n, point in enumerate(flat):
            held = [u for t, u, _ in invert_cylinder(start, stop, point) if 0.0 <= t <= 1.0]
            total[n] += min(held) - 1.0 if held else 0.0
    return total.reshape(array.shape[:-1])


def half_space_form(
    points: ArrayLike, triangles: ArrayLike, *, inner: ArrayLike = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """Return eq. 5.33's ``A x + B`` at points (..., 3), one per triangle (m, 3, 3): (..., m).

    Normals of the triangles' own length, turned away from the `inner` point (as printed, the
    origin, which must then lie inside). All are negative inside a convex hull, and only there.
    """
    array = check_points("points", points)
    corners = check_points("triangles", triangles)
    if corners.ndim != 3 or corners.shape[1] != 3:
        raise InputError(f"triangles has shape {corners.shape}: it must be (m, 3, 3)")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    offsets = -np.einsum("ij,ij->i", normals, corners[:, 0])
    side = np.where(normals @ check_points("inner", inner) + offsets > 0.0, -1.0, 1.0)
    return np.asarray(array @ (side[:, None] * normals).T + side * offsets)


def centroid_form(points: ArrayLike, cloud: ArrayLike) -> NDArray[np.float64]:
    """Return eq. 5.34 at points (..., 3): 1 / distance to the cloud's centroid, 0 in its hull.

    [1/mm]. Outside it grows towards the centroid, so that its slope points outwards, and it jumps
    at the wall: a descent leads away from the duct.
    """
    from scipy.spatial import ConvexHull

    array = check_points("points", points)
    samples = check_points("cloud", cloud)
    hull = ConvexHull(samples)
    value = array @ hull.equations[:, :3].T + hull.equations[:, 3]
    away = np.linalg.norm(array - samples.mean(axis=0), axis=-1)
    outside = value.max(axis=-1) > 0.0
    return np.where(outside, 1.0 / np.where(outside, away, 1.0), 0.0)
