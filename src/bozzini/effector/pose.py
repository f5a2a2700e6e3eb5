"""The pose of the end-effector under a pressure for each muscle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import GeometryError, InputError
from . import _equilibrium_kernels as kernels
from . import _pose_kernels
from ._settle import Settled, describe, settle_muscles
from .combine import combine_bends, take_order
from .effector import Effector
from .forward import describe_end, raise_open

__all__ = ["POSE_METHODS", "EffectorPose", "pose"]

Floats = NDArray[np.float64]

POSE_METHODS = ("superposition", "thesis")


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectorPose:
    """Poses of an end-effector, base at the origin and straight along +z.

    Attributes
    ----------
    pressures : (..., m) ndarray
        Pressures [MPa], muscles in the order of the design.
    contraction, force : (..., m) ndarray
        Contraction [mm] and pull [N] of each muscle alone on the section.
    iterations : (..., m) ndarray of int
        Steps of each muscle's equilibrium.
    lateral_vector : (..., 2) ndarray
        x and y of `tip` [mm].
    lateral : (...) ndarray
        Lateral deflection of `tip` [mm].
    azimuth : (...) ndarray
        Direction of `lateral_vector` from +x about +z [rad], in [-pi, pi]; 0 if it is zero.
    demanded_lateral : (...) ndarray
        Lateral deflection that the forces ask for [mm]; more than `lateral` where saturated.
    tip, holder_tip : (..., 3) ndarray
        End of the backbone, and of the holder straight on from there [mm].
    direction : (..., 3) ndarray
        Unit vector of the backbone's last piece.
    backbone : (..., n + 1, 3) ndarray
        Joints of the backbone [mm].
    saturated : (...) ndarray of bool
        Whether a muscle alone, or all together, ask for more than the largest deflection. The pose
        is the one of largest deflection then.
    converged : (...) ndarray of bool
        Whether every muscle's equilibrium was found.
    reason : (...) ndarray of str
        What is wrong where it is saturated or not converged; empty elsewhere.
    length_error : (...) ndarray
        Length of the backbone's pieces together less the design's [mm]: 0 by superposition; what
        the thesis's steps lose or add.
    """

    pressures: Floats
    contraction: Floats
    force: Floats
    iterations: NDArray[np.int64]
    lateral_vector: Floats
    lateral: Floats
    azimuth: Floats
    demanded_lateral: Floats
    tip: Floats
    holder_tip: Floats
    direction: Floats
    backbone: Floats
    saturated: NDArray[np.bool_]
    converged: NDArray[np.bool_]
    reason: NDArray[np.str_]
    length_error: Floats


def pose(
    effector: Effector,
    pressures: ArrayLike | Mapping[str, ArrayLike],
    *,
    method: str = "superposition",
    order: Sequence[str] | None = None,
) -> EffectorPose:
    """Return the pose of an end-effector under a pressure for each muscle.

    Each muscle's pull is that of its equilibrium alone on the section (`balance`).

    - ``"superposition"``: the pulls add as vectors ``F_i (cos angle_i, sin angle_i)``; the section
      bends in the plane of the sum, as one muscle there bends it to ``c |sum|``. So the lateral
      deflection is the sum of those of the muscles alone, which is what the thesis's inverse
      (4.13) assumes. It keeps the backbone's length, does not depend on an order, is exact for one
      muscle, and takes any number of them. That muscles which pull together hinder each other is
      not in it.
    - ``"thesis"``: the eight steps of section 4.4, for one or two muscles, which change the
      backbone's length (`length_error`: -3 to +8 mm on the prototype at contractions of 5.7 to 6.9
      mm) and depend on the order in which muscles are pressed. The lateral deflection disagrees
      with the thesis's own inverse, by up to 9 mm there.

    Parameters
    ----------
    effector : Effector
        Section and muscles.
    pressures : array_like, shape (..., m), or mapping
        Pressures [MPa] in the order of the design, or by name; by name, one left out is 0.
    method : str
        ``"superposition"`` or ``"thesis"``.
    order : sequence of str, optional
        Order in which muscles are pressed, for ``"thesis"``; the design's by default.

    Raises
    ------
    InputError
        If a pressure, a name, the method or the order is not legal, or a model has no answer.
    GeometryError
        If the thesis's steps have no answer.
    """
    if method not in POSE_METHODS:
        raise InputError(f"method is '{method}': it must be one of {list(POSE_METHODS)}")
    if order is not None and method != "thesis":
        raise InputError("an order of pressing is given: only method='thesis' depends on one")
    table = effector.take_pressures(pressures)
    shape, count, joints = table.shape[:-1], table.shape[-1], effector.design.segments + 1
    settled = settle_muscles(effector, table.reshape(-1, count))
    packed = effector.packed
    forces = settled.lateral / packed.compliance
    if method == "thesis":
        places = take_order(effector, order)
        backbone = combine_bends(effector, settled.contraction, forces, places)
        pieces = backbone[:, 1:] - backbone[:, :-1]
        lengths = np.sqrt(np.einsum("kij,kij->ki", pieces, pieces))
        with np.errstate(invalid="ignore", divide="ignore"):
            ends = pieces[:, -1] / lengths[:, -1:]
        if not np.all(np.isfinite(ends)):
            raise GeometryError(
                "the thesis's steps leave the last piece without a length; "
                "method='superposition' keeps it"
            )
        vector = backbone[:, -1, :2]
        lateral = np.hypot(vector[:, 0], vector[:, 1])
        demanded = lateral
        error = lengths.sum(axis=-1) - effector.design.backbone_length
    else:
        size = settled.lateral.shape[0]
        vectors = np.empty((size, 4))
        backbone, ends = np.empty((size, joints, 3)), np.empty((size, 3))
        case, failed = _pose_kernels.superpose(
            packed.linkage,
            packed.peak.contraction,
            packed.peak.lateral,
            packed.cosines,
            packed.sines,
            settled.contraction,
            settled.lateral,
            np.empty((2, joints)),
            vectors,
            backbone,
            ends,
        )
        if failed > 0:
            raise_open(effector.design, float(vectors[case, 3]), failed)
        vector, demanded = vectors[:, :2], vectors[:, 2]
        lateral = np.minimum(demanded, packed.peak.lateral)
        error = np.zeros(size)
    saturated, reason = _explain(effector, settled, demanded, superposed=method != "thesis")
    tip = backbone[:, -1]
    holder_tip = tip + effector.design.holder_length * ends
    return EffectorPose(
        pressures=table,
        contraction=settled.contraction.reshape(table.shape),
        force=forces.reshape(table.shape),
        iterations=settled.iterations.reshape(table.shape),
        lateral_vector=vector.reshape(*shape, 2),
        lateral=lateral.reshape(shape),
        azimuth=np.arctan2(vector[:, 1], vector[:, 0]).reshape(shape),
        demanded_lateral=demanded.reshape(shape),
        tip=tip.reshape(*shape, 3),
        holder_tip=holder_tip.reshape(*shape, 3),
        direction=ends.reshape(*shape, 3),
        backbone=backbone.reshape(*shape, joints, 3),
        saturated=saturated.reshape(shape),
        converged=np.asarray((settled.code <= kernels.SLACK).all(axis=-1).reshape(shape)),
        reason=reason.reshape(shape),
        length_error=error.reshape(shape),
    )


def _explain(
    effector: Effector, settled: Settled, demanded: Floats, *, superposed: bool
) -> tuple[NDArray[np.bool_], NDArray[np.str_]]:
    """Return which poses are saturated, and the reasons."""
    peak = effector.packed.peak.lateral
    beyond = demanded > peak * (1.0 + _pose_kernels.ROUND_OFF) if superposed else demanded < 0.0
    saturated = beyond | (settled.code == kernels.SATURATED).any(axis=-1)
    wrong = saturated | (settled.code > kernels.SLACK).any(axis=-1)
    if not wrong.any():
        return saturated, np.zeros(demanded.shape, dtype="<U1")
    reasons = [""] * demanded.size
    for i in np.flatnonzero(wrong):
        parts = []
        for j, name in enumerate(effector.design.names):
            code = int(settled.code[i, j])
            said = describe(effector, code, settled.contraction[i, j], settled.residual[i, j])
            if said:
                parts.append(f"muscle {name} {said}")
        if beyond[i]:
            parts.append(
                f"saturated: the muscles ask for {demanded[i]:.4g} mm, at {peak:.4g} mm, "
                f"{describe_end(effector.design)}"
            )
        reasons[i] = "; ".join(parts)
    return saturated, np.array(reasons, dtype=np.str_)
