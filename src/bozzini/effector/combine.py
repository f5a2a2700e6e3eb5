"""Two muscles pressed one after the other: the thesis's direction cosines and eight steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_points
from ..errors import GeometryError, InputError
from . import _pose_kernels
from .effector import Effector
from .forward import raise_open

__all__ = ["combine_bends", "find_resultant", "take_order"]

Floats = NDArray[np.float64]


def find_resultant(angles: ArrayLike, forces: ArrayLike) -> Floats:
    """Return ``(l_r, m_r)`` of the thesis's (4.7): where the resultant acts, over the offset.

    It is the centre of the forces and not a direction: its norm is below 1 (0.72 for the thesis's
    example), and the moment is ``a * norm * sum(forces)``.

    Parameters
    ----------
    angles : array_like, shape (m,)
        Angles of the muscles [rad].
    forces : array_like, shape (..., m)
        Pulls [N], 0 or more.

    Returns
    -------
    (..., 2) ndarray
        Centre of the forces over the offset; 0 where there is no force.

    Raises
    ------
    InputError
        If a value is not finite, a force is negative, or the shapes do not go together.
    """
    places = check_array("angles", angles)
    if places.ndim != 1:
        raise InputError(f"angles has shape {places.shape}: it must be (m,)")
    check_points("angles", places, dim=places.size)
    pulls = check_points("forces", check_array("forces", forces), dim=places.size)
    if pulls.size and pulls.min() < 0.0:
        raise InputError(f"force is {pulls.min():g} N: it must lie in [0, inf) N")
    units = np.stack([np.cos(places), np.sin(places)], axis=-1)
    total = pulls.sum(axis=-1, keepdims=True)
    return np.asarray(pulls @ units / np.where(total > 0.0, total, 1.0))


def take_order(effector: Effector, order: Sequence[str] | None) -> NDArray[np.int64]:
    """Return the places of the muscles in the order of pressing; the ones not named come after.

    Raises
    ------
    InputError
        If a name is unknown or there twice.
    """
    if order is not None and not isinstance(order, Sequence):
        raise InputError(f"order is {order!r:.60}: it must be a sequence of names")
    named = [effector.design.index(name) for name in order or ()]
    if len(set(named)) != len(named):
        raise InputError(f"order is {list(order or ())}: each muscle may be there once")
    rest = [place for place in range(len(effector.models)) if place not in named]
    return np.array(named + rest, dtype=np.int64)


def combine_bends(
    effector: Effector, contractions: Floats, forces: Floats, order: NDArray[np.int64]
) -> Floats:
    """Return backbones (k, n + 1, 3) [mm] by the thesis's steps 1 to 8, node by node.

    At each node: turn the second muscle's displacement ``D2`` by the angle of the first muscle's
    last piece, about the axis normal to it and the section's axis; then go from the first muscle's
    place along the turned ``D2`` until the plane of the resultant is met. What is printed and not
    taken: step 7 says "step 4" for step 6, and the axis (4.9) is no unit vector and not defined
    where the section is straight. Where both displacements lie in the plane they are added.

    Parameters
    ----------
    effector : Effector
        Section and muscles.
    contractions, forces : (k, m) ndarray
        Of each muscle alone [mm, N].
    order : (m,) ndarray of int
        Places of the muscles in the order of pressing.

    Raises
    ------
    InputError
        If more than two muscles of a case are contracted: the steps are for two.
    GeometryError
        If a turned displacement is parallel to the plane and does not lie in it.
    """
    packed = effector.packed
    pressed = contractions[:, order] > 0.0
    most = int(pressed.sum(axis=-1).max(initial=0))
    if most > 2:
        raise InputError(
            f"{most} muscles are contracted: the thesis's steps are for at most 2; "
            "method='superposition' takes any number"
        )
    ranks = np.argsort(~pressed, axis=-1, kind="stable")
    pair = np.full((2, contractions.shape[0]), -1, dtype=np.int64)
    for i in range(min(2, order.size)):
        there = pressed.sum(axis=-1) > i
        pair[i, there] = order[ranks[there, i]]
    joints = effector.design.segments + 1
    backbones = np.empty((contractions.shape[0], joints, 3))
    case, node, failed = _pose_kernels.combine_steps(
        packed.linkage,
        packed.cosines,
        packed.sines,
        contractions,
        forces,
        pair[0],
        pair[1],
        np.empty((4, joints)),
        backbones,
    )
    if failed > 0:
        raise_open(effector.design, float(contractions[case].max()), failed)
    if case >= 0:
        first, second = (effector.design.names[place] for place in pair[:, case])
        raise GeometryError(
            f"muscles {first} and {second}: at joint {node} the thesis's step 7 has no answer, the "
            "turned displacement is parallel to the plane of the resultant; "
            "method='superposition' has one"
        )
    return backbones
