"""Whether a circle or a ball can roll along a wall: relative curvature (thesis 5.3.5, corrected).

A circle of radius R rolls along a wall and touches it in one place only if its own curvature is the
larger one there, ``1/R - k > 0``, where k is the wall's curvature towards the circle: positive
where the wall curls around it. On a surface the same holds for both principal curvatures, the
eigenvalues of the shape operator ``S = I^-1 II``.

The thesis prints the opposite sign, by which no circle rolls on a flat wall, and for a surface the
second fundamental form alone, which is right only for orthonormal parameters. Both are kept here
as `printed_curve` and `printed_surface`, to compare.

The test is local. It shows neither that the circle fits between two walls nor how long a link may
be; `bozzini.motion.traverse` has that.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bozzini.checks import broadcast, check_array, check_number, check_points
from bozzini.duct.base import Duct, SampledField
from bozzini.duct.checks import check_places, check_size
from bozzini.errors import GeometryError, InputError


def relative_curvature(curvatures: ArrayLike, radius: float) -> NDArray[np.float64]:
    """Return ``1/radius - curvature`` [1/mm]: positive where a circle or ball rolls.

    Parameters
    ----------
    curvatures : (...) float
        Of the wall towards the circle [1/mm].
    radius : float
        Of the circle [mm].
    """
    check_size("radius", radius)
    return np.asarray(1.0 / radius - _check("curvatures", curvatures))


def is_traversable(curvatures: ArrayLike, radius: float) -> bool:
    """Return whether a circle or ball rolls everywhere: every relative curvature is positive.

    A necessary condition only; see the module.
    """
    return bool(np.all(relative_curvature(curvatures, radius) > 0.0))


def find_rolling_radius(curvatures: ArrayLike) -> float:
    """Return the radius [mm] below which a circle or ball rolls everywhere; may be infinite."""
    largest = float(np.max(_check("curvatures", curvatures), initial=0.0))
    return math.inf if largest <= 0.0 else 1.0 / largest


def measure_curve(
    first: ArrayLike, second: ArrayLike, *, side: str = "left"
) -> NDArray[np.float64]:
    """Return the (...) curvature of a plane curve towards one side [1/mm].

    Parameters
    ----------
    first, second : (..., 2) float
        First and second derivative of the curve by any parameter [mm per unit of it].
    side : {"left", "right"}
        On which side of the direction along the curve the circle is.

    Raises
    ------
    InputError
        If the first derivative vanishes, or the side is neither.
    """
    if side not in ("left", "right"):
        raise InputError(f"side is {side!r}: it must be 'left' or 'right'")
    one, two = _check_vectors(2, first=first, second=second)
    speed = np.linalg.norm(one, axis=-1)
    if np.any(speed == 0.0):
        raise InputError("first derivative of the curve is 0 somewhere: it must not stand still")
    turn = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    return np.asarray((1.0 if side == "left" else -1.0) * turn / speed**3)


def measure_surface(
    first_u: ArrayLike,
    first_v: ArrayLike,
    second_uu: ArrayLike,
    second_uv: ArrayLike,
    second_vv: ArrayLike,
    *,
    toward: ArrayLike,
) -> NDArray[np.float64]:
    """Return the (..., 2) principal curvatures of a surface towards the ball [1/mm], rising.

    Eigenvalues of the shape operator ``S = I^-1 II``, whatever the parameters.

    Parameters
    ----------
    first_u, first_v : (..., 3) float
        First derivatives of the surface.
    second_uu, second_uv, second_vv : (..., 3) float
        Second derivatives.
    toward : (..., 3) float
        Any direction to the ball's side of the surface.

    Raises
    ------
    InputError
        If the first derivatives are parallel, or `toward` lies in the surface.
    """
    one, two = _fundamental_forms(first_u, first_v, second_uu, second_uv, second_vv, toward)
    lower = np.linalg.inv(np.linalg.cholesky(one))
    return np.asarray(np.linalg.eigvalsh(lower @ two @ np.swapaxes(lower, -1, -2)))


def measure_wall(
    duct: Duct, points: ArrayLike, *, step: float | None = None
) -> NDArray[np.float64]:
    """Return the (..., dim - 1) principal curvatures of a duct's wall towards its inside [1/mm].

    From differences of the signed distance: its second derivatives in the tangent plane, over the
    length of its gradient.

    Parameters
    ----------
    duct : Duct
        3-D or planar.
    points : (..., dim) float
        On the wall, or near it (then of the level set there) [mm].
    step : float, optional
        Of the differences [mm]: by default two nodes of a sampled field, else 1e-3 of the smallest
        side of the duct's box.

    Raises
    ------
    GeometryError
        If the distance has no gradient at a point.
    """
    dim = duct.dim
    array = check_places("points", points, dim=dim)
    if step is None:
        if isinstance(duct, SampledField):
            step = 2.0 * float(duct.spacing.max())
        else:
            step = 1e-3 * float((duct.bounds[1] - duct.bounds[0]).min())
    check_number("step", step, low=0.0, low_open=True, unit="mm")
    steps = step * np.eye(dim)
    gradient = np.empty(array.shape)
    hessian = np.empty((*array.shape, dim))
    middle = duct.signed_distance(array)
    for a in range(dim):
        ahead = duct.signed_distance(array + steps[a])
        back = duct.signed_distance(array - steps[a])
        gradient[..., a] = (ahead - back) / (2.0 * step)
        hessian[..., a, a] = (ahead - 2.0 * middle + back) / step**2
        for b in range(a):
            mixed = (
                duct.signed_distance(array + steps[a] + steps[b])
                - duct.signed_distance(array + steps[a] - steps[b])
                - duct.signed_distance(array - steps[a] + steps[b])
                + duct.signed_distance(array - steps[a] - steps[b])
            ) / (4.0 * step**2)
            hessian[..., a, b] = hessian[..., b, a] = mixed
    size = np.linalg.norm(gradient, axis=-1)
    if np.any(size < 0.1):
        index = np.unravel_index(int(np.argmin(size)), size.shape)
        place = ", ".join(f"{value:g}" for value in array[index])
        raise GeometryError(f"the distance has no gradient at ({place}) mm: not a wall there")
    # Rows of the last two factors of a singular value decomposition span the tangent plane.
    tangent = np.linalg.svd(gradient[..., None, :])[2][..., 1:, :]
    within = tangent @ hessian @ np.swapaxes(tangent, -1, -2) / size[..., None, None]
    return np.asarray(np.linalg.eigvalsh(within))


def measure_mesh(vertices: ArrayLike, faces: ArrayLike) -> NDArray[np.float64]:
    """Return the (n, 2) principal curvatures at the vertices of a mesh, towards its inside [1/mm].

    By quadrics fitted around every vertex (libigl, after Panozzo, Puppo and Rocca 2010).

    Parameters
    ----------
    vertices : (n, 3) float
        [mm].
    faces : (m, 3) int
        Triangles, seen counter-clockwise from outside.

    Raises
    ------
    InputError
        If the arrays have the wrong shape or name vertices that are not there.
    """
    import igl

    places = check_points("vertices", vertices)
    triangles = np.asarray(faces)
    if places.ndim != 2 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise InputError(
            f"vertices and faces have shapes {places.shape} and {triangles.shape}: they must be "
            "(n, 3) and (m, 3)"
        )
    if len(triangles) == 0 or triangles.min() < 0 or triangles.max() >= len(places):
        raise InputError(f"faces name vertices outside [0, {len(places) - 1}]")
    found = igl.principal_curvature(
        np.ascontiguousarray(places), np.ascontiguousarray(triangles, dtype=np.int64)
    )
    return np.sort(np.stack([found[2], found[3]], axis=-1), axis=-1)


def printed_curve(first: ArrayLike, second: ArrayLike, radius: float) -> NDArray[np.float64]:
    """Return the thesis's relative curvature of a graph as printed [1/mm]; its sign is wrong.

    ``z'' / (1 + z'^2)^(3/2) - 1/R``, positive, by the thesis, where a circle rolls. A flat wall
    gives -1/R.

    Parameters
    ----------
    first, second : (...) float
        Slope of the graph, and its second derivative [1/mm].
    radius : float
        Of the circle [mm].
    """
    check_size("radius", radius)
    slope, bend = broadcast(("first", _check("first", first)), ("second", _check("second", second)))
    return np.asarray(bend / (1.0 + slope**2) ** 1.5 - 1.0 / radius)


def printed_surface(
    first_u: ArrayLike,
    first_v: ArrayLike,
    second_uu: ArrayLike,
    second_uv: ArrayLike,
    second_vv: ArrayLike,
    *,
    toward: ArrayLike,
    radius: float,
) -> NDArray[np.float64]:
    """Return the smaller eigenvalue of the thesis's relative curvature matrix, as printed.

    ``II - 1/R``, without the first fundamental form: it depends on the parameters of the surface.
    The parameters are those of `measure_surface`, and the ball's radius [mm].
    """
    check_size("radius", radius)
    _, two = _fundamental_forms(first_u, first_v, second_uu, second_uv, second_vv, toward)
    return np.asarray(np.linalg.eigvalsh(two - np.eye(2) / radius)[..., 0])


def _fundamental_forms(
    first_u: ArrayLike,
    first_v: ArrayLike,
    second_uu: ArrayLike,
    second_uv: ArrayLike,
    second_vv: ArrayLike,
    toward: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return both fundamental forms (..., 2, 2), the normal on the side of `toward`."""
    u, v, uu, uv, vv, side = _check_vectors(
        3,
        first_u=first_u,
        first_v=first_v,
        second_uu=second_uu,
        second_uv=second_uv,
        second_vv=second_vv,
        toward=toward,
    )
    normal = np.cross(u, v)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    scale = np.linalg.norm(u, axis=-1, keepdims=True) * np.linalg.norm(v, axis=-1, keepdims=True)
    if np.any(size <= 1e-12 * scale):
        raise InputError("first derivatives of the surface are parallel somewhere")
    normal = normal / size
    sign = np.sign(np.sum(normal * side, axis=-1, keepdims=True))
    if np.any(sign == 0.0):
        raise InputError("toward lies in the surface somewhere: it must point to one side")
    normal = sign * normal

    def form(
        a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return np.stack([np.stack([a, b], axis=-1), np.stack([b, c], axis=-1)], axis=-2)

    one = form(*(np.sum(a * b, axis=-1) for a, b in ((u, u), (u, v), (v, v))))
    two = form(*(np.sum(second * normal, axis=-1) for second in (uu, uv, vv)))
    return one, two


def _check(name: str, values: ArrayLike) -> NDArray[np.float64]:
    array = check_array(name, values)
    if not np.all(np.isfinite(array)):
        raise InputError(f"{name} are not all finite")
    if array.size == 0:
        raise InputError(f"{name} is empty: there must be at least one number")
    return array


def _check_vectors(dim: int, **vectors: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    """Return vectors (..., dim) in one shape."""
    return broadcast(*((name, check_points(name, v, dim=dim)) for name, v in vectors.items()))
