"""The pose of the section under a pressure for each muscle (thesis 4.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_points, check_word
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, check_drawn, measured, tabulated, take_axes
from .equilibrium import Settled, explain_equilibrium, list_muscles, settle_muscles
from .kernels import balance as kernels
from .kernels import pose as pose_kernels
from .linkage import describe_end, refuse_open
from .model import EffectorModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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


def take_order(effector: EffectorModel, order: Sequence[str] | None) -> NDArray[np.int64]:
    """Return the places of the muscles in the order of pressing; the ones not named come after."""
    if order is not None and not isinstance(order, Sequence):
        raise InputError(f"order is {order!r:.60}: it must be a sequence of names")
    named = [effector.design.index(name) for name in order or ()]
    if len(set(named)) != len(named):
        raise InputError(f"order is {list(order or ())}: each muscle may be there once")
    rest = [place for place in range(len(effector.models)) if place not in named]
    return np.array(named + rest, dtype=np.int64)


def combine_bends(
    effector: EffectorModel, contractions: Floats, forces: Floats, order: NDArray[np.int64]
) -> Floats:
    """Return backbones (k, n + 1, 3) [mm] by the thesis's steps 1 to 8, node by node.

    At each node: turn the second muscle's displacement ``D2`` by the angle of the first muscle's
    last piece, about the axis normal to it and the section's axis; then go from the first muscle's
    place along the turned ``D2`` until the plane of the resultant is met. What is printed and not
    taken: step 7 prints "step 4" for step 6, and the axis (4.9) is no unit vector and not defined
    where the section is straight. Where both displacements lie in the plane they are added.
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
    case, node, failed = pose_kernels.combine_steps(
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
        raise refuse_open(effector.design, float(contractions[case].max()), failed)
    if case >= 0:
        first, second = (effector.design.names[place] for place in pair[:, case])
        raise GeometryError(
            f"muscles {first} and {second}: at joint {node} the thesis's step 7 has no answer, the "
            "turned displacement is parallel to the plane of the resultant; "
            "method='superposition' has one"
        )
    return backbones


PoseMethod = Literal["superposition", "thesis"]
POSE_METHODS: tuple[PoseMethod, ...] = get_args(PoseMethod)


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectorPose(Result):
    """Poses of an end-effector, base at the origin and straight along +z.

    Attributes
    ----------
    names : tuple of str
        The muscles, in the order of the design.
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
    settled : (...) ndarray of bool
        Whether every muscle's equilibrium was found.
    reason : (...) ndarray of str
        What is wrong where it has not converged; empty elsewhere.
    length_error : (...) ndarray
        Length of the backbone's pieces together less the design's [mm]: 0 by superposition; what
        the thesis's steps lose or add.
    """

    rows_have_verdict = True

    names: tuple[str, ...]
    pressures: Floats = tabulated("MPa", "pressure_{}", over="names")
    contraction: Floats = measured("mm")
    force: Floats = measured("N")
    iterations: NDArray[np.int64]
    lateral_vector: Floats = measured("mm")
    lateral: Floats = measured("mm")
    azimuth: Floats = measured("rad")
    demanded_lateral: Floats = measured("mm")
    tip: Floats = tabulated("mm", "tip_{}")
    holder_tip: Floats = tabulated("mm", "holder_tip_{}")
    direction: Floats
    backbone: Floats = measured("mm")
    saturated: NDArray[np.bool_]
    settled: NDArray[np.bool_]
    reason: NDArray[np.str_]
    length_error: Floats = measured("mm")

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether the section deflects as the pulls ask for: `settled`, and not `saturated`."""
        return self.settled & ~self.saturated

    @property
    def residual(self) -> Floats:
        """By how much the deflection falls short of what the pulls ask for [mm]."""
        return np.asarray(self.demanded_lateral - self.lateral)

    def to_dict(self) -> Json:
        """Return the poses as plain values, units in the names, ``muscles`` by theirs."""
        muscles = list_muscles(
            self.names,
            pressure_MPa=self.pressures,
            contraction_mm=self.contraction,
            force_N=self.force,
            iterations=self.iterations,
        )
        return super().to_dict() | {"muscles": muscles}

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`, a row for each pose."""
        return {**super().list_columns(), "lateral_mm": np.ravel(self.lateral)}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the backbones, each in the plane of its bend, and return the axes.

        Raises
        ------
        InputError
            If there are more than 100 poses.
        """
        check_drawn(self.lateral.size, "poses")
        axes = take_axes(ax, x="lateral [mm]", y="along the axis [mm]", equal=True)
        for line in self.backbone.reshape(-1, *self.backbone.shape[-2:]):
            axes.plot(np.hypot(line[:, 0], line[:, 1]), line[:, 2], ".-")
        return axes


def pose(
    effector: EffectorModel,
    pressures: ArrayLike | Mapping[str, ArrayLike],
    *,
    method: PoseMethod = "superposition",
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
    check_word("method", method, POSE_METHODS)
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
        case, failed = pose_kernels.superpose(
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
            raise refuse_open(effector.design, float(vectors[case, 3]), failed)
        vector, demanded = vectors[:, :2], vectors[:, 2]
        lateral = np.minimum(demanded, packed.peak.lateral)
        error = np.zeros(size)
    saturated, reason = _explain(effector, settled, demanded, superposed=method != "thesis")
    tip = backbone[:, -1]
    holder_tip = tip + effector.design.holder_length * ends
    return EffectorPose(
        names=effector.design.names,
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
        settled=np.asarray((settled.code <= kernels.SLACK).all(axis=-1).reshape(shape)),
        reason=reason.reshape(shape),
        length_error=error.reshape(shape),
    )


def _explain(
    effector: EffectorModel, settled: Settled, demanded: Floats, *, superposed: bool
) -> tuple[NDArray[np.bool_], NDArray[np.str_]]:
    """Return which poses are saturated, and the reasons."""
    peak = effector.packed.peak.lateral
    beyond = demanded > peak * (1.0 + pose_kernels.ROUND_OFF) if superposed else demanded < 0.0
    saturated = beyond | (settled.code == kernels.SATURATED).any(axis=-1)
    wrong = saturated | (settled.code > kernels.SLACK).any(axis=-1)
    if not wrong.any():
        return saturated, np.zeros(demanded.shape, dtype="<U1")
    reasons = [""] * demanded.size
    for i in np.flatnonzero(wrong):
        parts = []
        for j, name in enumerate(effector.design.names):
            code = int(settled.code[i, j])
            known = code, settled.contraction[i, j], settled.residual[i, j]
            cause = explain_equilibrium(effector, *known)
            if cause:
                parts.append(f"muscle {name} {cause}")
        if beyond[i]:
            parts.append(
                f"saturated: the muscles ask for {demanded[i]:.4g} mm, at {peak:.4g} mm, "
                f"{describe_end(effector.design)}"
            )
        reasons[i] = "; ".join(parts)
    return saturated, np.array(reasons, dtype=np.str_)
