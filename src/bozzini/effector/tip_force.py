"""What the tip withstands and what it can press with, across the section."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_points
from ..errors import InputError
from ._settle import settle_muscles
from .design import EffectorDesign
from .effector import Effector
from .forward import lateral_slope
from .inverse import solve_inverse
from .projected import take_place

__all__ = ["TipForce", "passive_stiffness", "tip_force", "tip_stiffness"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class TipForce:
    """The largest force with which the tip presses on something that holds it.

    Attributes
    ----------
    direction : (..., 2) float
        Unit vectors of the force that the tip exerts.
    lateral_vector : (2,) float
        Where the tip is held [mm].
    force : (...) float
        The force [N]; 0 where there is no force exactly in this direction.
    pulls : (m,) float
        Pull of each muscle at the pressure limit with the tip held there [N].
    """

    direction: Floats
    lateral_vector: Floats
    force: Floats
    pulls: Floats


def passive_stiffness(design: EffectorDesign) -> float:
    """Return ``3 EI / L**3`` [N/mm]: the tip's lateral stiffness while muscles keep their pull."""
    return 3.0 * design.rigidity / design.backbone_length**3


def tip_stiffness(effector: Effector, pressures: ArrayLike | Mapping[str, ArrayLike]) -> Floats:
    """Return the lateral stiffness of the tip (..., 2, 2) [N/mm] at constant pressures.

    A lateral force ``f`` at the tip deflects the section, as a beam, by ``s f`` with
    ``s = L**3 / (3 EI)``, and a deflection ``v`` changes the pull of an active muscle by
    ``-k_i (e_i . v) / slope_i``, with its own stiffness ``k_i`` and ``slope = d lateral / d
    contraction``. From ``v = s f + c sum(change of pull_i e_i)``::

        K = (1 + c sum(k_i / slope_i  e_i e_i^T)) / s

    It is exact in the model for one muscle in its own plane. That several muscles are stretched
    each by the part of the deflection along it is an assumption, as superposition is. Muscles
    that do not pull are left out. The linkage hardly moves at small contractions (`bend`), so that
    there a muscle looks too stiff.

    Parameters
    ----------
    effector : Effector
    pressures : array_like, shape (..., m), or mapping
        Pressures [MPa], as in `pose`.

    Raises
    ------
    InputError
        If a pressure is outside its legal range or a model has no stiffness.
    """
    design = effector.design
    table = effector.take_pressures(pressures)
    flat = table.reshape(-1, table.shape[-1])
    settled = settle_muscles(effector, flat)
    passive = passive_stiffness(design)
    units = np.stack([effector.packed.cosines, effector.packed.sines], axis=-1)
    gain = np.zeros(flat.shape)
    slopes = lateral_slope(design, settled.contraction)
    for index, model in enumerate(effector.models):
        active = (settled.contraction[:, index] > 0.0) & (slopes[:, index] > 0.0)
        if np.any(active):
            stiffness = model.stiffness(flat[active, index], settled.contraction[active, index])
            gain[active, index] = design.compliance * stiffness / slopes[active, index]
    matrix = np.eye(2) + np.einsum("nk,ki,kj->nij", gain, units, units)
    return np.asarray(passive * matrix.reshape(*table.shape[:-1], 2, 2))


def tip_force(
    effector: Effector, direction: ArrayLike, *, lateral: ArrayLike = (0.0, 0.0)
) -> TipForce:
    """Return the largest force that the tip exerts in a direction while something holds it.

    Held at ``v``, the tip presses with ``(c sum(F_i e_i) - v) / s``, ``s = L**3 / (3 EI)``: by how
    much further the pulls would deflect it, over the section's compliance. Every pull may be any
    from 0 to that of `MuscleModel.force` at the pressure limit, at the contraction for the part of
    ``v`` along the muscle (none for muscles on the other side). The answer is the largest ``t``
    with ``t direction`` among these forces, all muscles together.

    With ``beam_factor`` 2 and a straight section the reaction of one muscle is ``3 a F / (2 L)``:
    that of a beam clamped at one end and held at the other under an end moment ``a F``.

    Assumed are small deflections from a beam, as everywhere in this model, a backbone that follows
    the tip, and that muscles do not hinder each other. A real section that is held may buckle away.

    Parameters
    ----------
    effector : Effector
    direction : (..., 2) array_like
        Directions of the force of the tip, of any length but zero.
    lateral : (2,) array_like
        Where the tip is held [mm]; 0 is the straight section.

    Raises
    ------
    InputError
        If a direction is zero, the muscles cannot bring the tip to `lateral`, or a model has no
        pull.
    """
    design = effector.design
    vectors = check_points("direction", check_array("direction", direction), dim=2)
    sizes = np.hypot(vectors[..., :1], vectors[..., 1:])
    if np.any(sizes == 0.0):
        raise InputError("direction is (0, 0): it must be a vector of any length but zero")
    toward = vectors / sizes
    place = take_place("lateral", lateral)
    held = solve_inverse(effector, place)
    if not held.reachable:
        raise InputError(
            f"lateral is ({place[0]:g}, {place[1]:g}) mm: the tip cannot be there, {held.reason}"
        )
    pulls = _measure_pulls(effector, held.contraction)
    units = np.stack([effector.packed.cosines, effector.packed.sines], axis=-1)
    amplitudes = design.compliance * pulls
    normals, widths = _find_strips(units, amplitudes)
    room = np.maximum(widths - normals @ place, 0.0)
    rate = toward @ normals.T
    away = rate > 1e-12  # a strip's edge that the direction is not parallel to
    ways = np.where(away, room / np.where(away, rate, 1.0), np.inf)
    distance = ways.min(axis=-1)
    return TipForce(
        direction=toward,
        lateral_vector=place,
        force=np.asarray(passive_stiffness(design) * distance),
        pulls=pulls,
    )


def _measure_pulls(effector: Effector, contraction: Floats) -> Floats:
    """Pull of each muscle at the pressure limit and contractions (m,) [N], 0 if it is slack."""
    limit = effector.design.pressure_limit
    pulls = np.zeros(len(effector.models))
    for index, model in enumerate(effector.models):
        if model.free_contraction(limit) > contraction[index]:
            pulls[index] = max(0.0, float(model.force(limit, contraction[index])))
    return pulls


def _find_strips(units: Floats, amplitudes: Floats) -> tuple[Floats, Floats]:
    """Normals (k, 2) and distances (k,) of the edges of ``{sum a_i e_i, 0 <= a_i <= A_i}``.

    Its edges are parallel to the ``e_i``. If all of these lie on one line the two ends of that
    line's segment are added.
    """
    across = np.stack([-units[:, 1], units[:, 0]], axis=-1)
    normals = np.concatenate([across, -across, units, -units])
    widths = np.maximum(normals @ units.T, 0.0) @ amplitudes
    return normals, widths
