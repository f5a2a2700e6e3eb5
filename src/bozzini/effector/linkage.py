"""One muscle's linkage: where the section is at a contraction (thesis 4.3), and its conflicts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_points, check_range, refuse_first, show_range
from ..errors import GeometryError, InputError
from ..muscle import Muscle
from ..muscle.design import LOCKING_ANGLE
from ..numeric.arrays import Floats
from ..results import Shown
from .design import EffectorDesign
from .kernels import linkage as kernels

Linkage = tuple[float, float, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkageBend(Shown):
    """The section bent by one muscle, in the plane of backbone and muscle.

    Points are (lateral, axial) [mm]: lateral from the straight backbone towards the muscle.

    Attributes
    ----------
    contraction : (...) ndarray
        Contraction of the muscle [mm].
    backbone, muscle : (..., n + 1, 2) ndarray
        Joints of the backbone and ends of the links on the muscle [mm].
    backbone_angle : (..., n + 1) ndarray
        Angle of the piece before each joint from the axis [rad]; 0 at the first.
    link_angle : (..., n + 1) ndarray
        Angle of each link from the straight section's, the same way round [rad]. It runs ahead of
        the backbone: the last link, the end plate, is not normal to the backbone in this model.
    tip : (..., 2) ndarray
        End of the backbone [mm].
    holder_tip : (..., 2) ndarray
        End of the holder, straight on from the last piece [mm].
    lateral : (...) ndarray
        Lateral deflection of `tip` [mm], the thesis's ``delta_e``.
    total : (...) ndarray
        Distance of `tip` from where it was when straight [mm].
    spacing : (..., n + 1) ndarray
        Distance from each end of a link to the line of the backbone's piece before it [mm]; it is
        less than the offset, since nothing guides the muscle between the turns.
    """

    contraction: Floats
    backbone: Floats
    muscle: Floats
    backbone_angle: Floats
    link_angle: Floats
    tip: Floats
    holder_tip: Floats
    lateral: Floats
    total: Floats
    spacing: Floats


@dataclass(frozen=True, kw_only=True)
class Peak:
    """How far one muscle can deflect the section.

    Attributes
    ----------
    contraction : float
        Contraction [mm] up to which the lateral deflection rises.
    lateral : float
        Lateral deflection there [mm].
    is_maximum : bool
        Whether more contraction gives less deflection; if not, it is as far as the linkage goes.
    """

    contraction: float
    lateral: float
    is_maximum: bool


def bend(design: EffectorDesign, contraction: ArrayLike) -> LinkageBend:
    """Return the section bent by one muscle, a closed form of the thesis's problem (4.4).

    The minimum that (4.4) asks for is zero: each segment is one intersection of two circles, in the
    uncrossed mode. The lag of link behind backbone after segment k is
    ``sin(lag_k) = (l + m)/(2 a) (1 - (m/l)**k)``, with a segment's backbone ``l``, muscle ``m`` and
    offset ``a``; all closes at any contraction if ``a >= (l + m)/2``.

    Small contractions are this model's weak side: the deflection grows with the square of the
    contraction, where a section of constant curvature grows in proportion (0.64 against 5.6 mm at
    1 mm of the prototype). Do not trust it below about 2 mm.

    Parameters
    ----------
    design : EffectorDesign
        The section.
    contraction : array_like
        Contraction [mm], from 0 to below the backbone's length.

    Raises
    ------
    InputError
        If a contraction is outside its range.
    GeometryError
        If a segment cannot close; the message names it and what to change.
    """
    contractions = _take_contraction(design, contraction)
    linkage = take_linkage(design)
    joints = (*contractions.shape, design.segments + 1)
    backbone, muscle = np.empty((*joints, 2)), np.empty((*joints, 2))
    angle, link = np.empty(joints), np.empty(joints)
    index, failed = kernels.fill_linkages(
        linkage,
        contractions.reshape(-1),
        backbone.reshape(-1, design.segments + 1, 2),
        muscle.reshape(-1, design.segments + 1, 2),
        angle.reshape(-1, design.segments + 1),
        link.reshape(-1, design.segments + 1),
    )
    if failed:
        raise refuse_open(design, float(contractions.flat[index]), failed)
    tip = backbone[..., -1, :]
    ahead = (tip - backbone[..., -2, :]) * (design.segments / design.backbone_length)
    straight = np.array([0.0, design.backbone_length])
    return LinkageBend(
        contraction=contractions,
        backbone=backbone,
        muscle=muscle,
        backbone_angle=angle,
        link_angle=link,
        tip=tip,
        holder_tip=tip + design.holder_length * ahead,
        lateral=np.asarray(tip[..., 0]),
        total=np.asarray(np.linalg.norm(tip - straight, axis=-1)),
        spacing=design.offset * np.cos(link - angle),
    )


def lateral_deflection(design: EffectorDesign, contraction: ArrayLike) -> Floats:
    """Return the lateral deflection of the backbone's end [mm] at contractions [mm].

    Raises
    ------
    InputError, GeometryError
        As `bend` does.
    """
    return measure_laterals(design, contraction)[0]


def lateral_slope(design: EffectorDesign, contraction: ArrayLike) -> Floats:
    """Return ``d lateral / d contraction`` [mm/mm] at contractions [mm].

    Raises
    ------
    InputError, GeometryError
        As `bend` does.
    """
    return measure_laterals(design, contraction)[1]


def find_peak(design: EffectorDesign) -> Peak:
    """Return the end of the branch on which more contraction gives more lateral deflection."""
    return _find_peak(take_linkage(design))


def contraction_for_lateral(design: EffectorDesign, lateral: ArrayLike) -> Floats:
    """Return the contraction [mm] that gives a lateral deflection [mm], on the rising branch.

    Raises
    ------
    InputError
        If a deflection is not in [0, `find_peak`].
    """
    laterals = _take_array("lateral", lateral)
    peak = find_peak(design)
    beyond = ~((laterals >= 0.0) & (laterals <= peak.lateral))
    refuse_first(
        beyond,
        "lateral deflection",
        laterals,
        lambda index: (
            f"it must lie in {show_range(laterals, index, 0.0, peak.lateral)} mm, what this "
            "section can reach"
        ),
        unit="mm",
    )
    contractions = np.empty(laterals.shape)
    kernels.find_contractions(
        take_linkage(design), laterals.reshape(-1), peak.contraction, contractions.reshape(-1)
    )
    return contractions


def place_curve(points: ArrayLike, azimuth: ArrayLike) -> Floats:
    """Turn planar curves (..., k, 2) of a `LinkageBend` to azimuths (...) [rad]: (..., k, 3) [mm].

    Raises
    ------
    InputError
        If a value is not finite, or the shapes do not go together.
    """
    plane = check_points("points", points, dim=2)
    turned = check_array("azimuth", azimuth)
    check_range("azimuth", turned, -1e6, 1e6, "rad")
    turned = turned[..., np.newaxis]
    try:
        np.broadcast_shapes(plane.shape[:-1], turned.shape)
    except ValueError:
        raise InputError(
            f"points {plane.shape} and azimuth {turned.shape[:-1]} do not go together: give one "
            "azimuth for each curve"
        ) from None
    across, along = np.broadcast_arrays(plane[..., 0], plane[..., 1])
    return np.stack(
        np.broadcast_arrays(across * np.cos(turned), across * np.sin(turned), along), axis=-1
    )


def describe_end(design: EffectorDesign) -> str:
    """Return what ends the rising branch of a design: its peak, or a segment that cannot close."""
    peak, count = find_peak(design), design.segments
    if peak.is_maximum:
        return "the most there is"
    if kernels.find_end(take_linkage(design)) >= design.backbone_length:
        return "with no muscle left to contract"
    rest = design.backbone_length / count
    return (
        f"as far as the linkage closes: beyond {peak.contraction:.4g} mm of contraction the joint "
        f"of segment {count} of {count} would come nearer than {abs(rest - design.offset):.4g} mm "
        f"to the muscle, where [{abs(rest - design.offset):.4g}, {rest + design.offset:.4g}] mm is "
        f"legal; use more segments or a larger offset: {_always_closes(design, peak.contraction)}"
    )


def take_linkage(design: EffectorDesign) -> Linkage:
    """Return the design as `kernels` takes it."""
    return design.offset, design.backbone_length, design.segments


@lru_cache(maxsize=1024)
def _find_peak(linkage: Linkage) -> Peak:
    end = kernels.find_end(linkage)
    contraction, lateral, is_maximum = kernels.find_top(linkage, end)
    return Peak(contraction=float(contraction), lateral=float(lateral), is_maximum=bool(is_maximum))


def measure_laterals(design: EffectorDesign, contraction: ArrayLike) -> tuple[Floats, Floats]:
    """Return `lateral_deflection` and `lateral_slope`."""
    contractions = _take_contraction(design, contraction)
    laterals, slopes = np.empty(contractions.shape), np.empty(contractions.shape)
    index, failed = kernels.fill_laterals(
        take_linkage(design), contractions.reshape(-1), laterals.reshape(-1), slopes.reshape(-1)
    )
    if failed:
        raise refuse_open(design, float(contractions.flat[index]), failed)
    return laterals, slopes


def _take_array(name: str, values: ArrayLike) -> Floats:
    return np.array(check_array(name, values), order="C")


def _take_contraction(design: EffectorDesign, contraction: ArrayLike) -> Floats:
    contractions = _take_array("contraction", contraction)
    length = design.backbone_length
    beyond = ~((contractions >= 0.0) & (contractions < length))
    must = f"it must lie in [0, {length:g}) mm"
    refuse_first(beyond, "contraction", contractions, must, unit="mm")
    return contractions


def refuse_open(design: EffectorDesign, contraction: float, segment: int) -> GeometryError:
    """Return the error of a segment, from 1 on, that cannot close at a contraction."""
    rest = design.backbone_length / design.segments
    short = rest - contraction / design.segments
    sine = kernels.measure_lag(take_linkage(design), contraction, segment - 1)
    apart = math.sqrt(design.offset**2 + short**2 - 2.0 * design.offset * short * sine)
    return GeometryError(
        f"contraction is {contraction:g} mm: segment {segment} of {design.segments} cannot close, "
        f"its joint is D = {apart:g} mm from the muscle where [{abs(rest - design.offset):g}, "
        f"{rest + design.offset:g}] mm is legal; contract less, or use more segments or a larger "
        f"offset: {_always_closes(design, contraction)}"
    )


def _always_closes(design: EffectorDesign, contraction: float) -> str:
    half = (design.backbone_length - 0.5 * contraction) / design.segments
    return f"(l0 + l_a)/(2 n) = {half:g} mm always closes"


SAMPLES = 400


def find_conflicts(design: EffectorDesign) -> tuple[str, ...]:
    """Return one line for each pair of parts that do not fit; none of them is an error.

    They are findings and not errors because the thesis's own tables need an offset of 4 mm, which
    its 9 mm holder has no space for. Looked at are the holes in the holder, neighbouring muscles at
    rest, the muscle against the coil as it drifts inwards and gets thicker, and whether every
    segment closes at every contraction.

    Parameters
    ----------
    design : EffectorDesign
        The section.
    """
    found = []
    low = 0.5 * (design.bore_diameter + design.hole_diameter)
    high = 0.5 * (design.holder_diameter - design.hole_diameter)
    if not low <= design.offset <= high:
        found.append(
            f"offset is {design.offset:g} mm: a {design.holder_diameter:g} mm holder with a "
            f"{design.bore_diameter:g} mm bore and {design.hole_diameter:g} mm holes has space for "
            f"[{low:g}, {high:g}] mm"
        )
    placed = design.muscles
    for i, one in enumerate(placed):
        for other in placed[:i]:
            apart = 2.0 * design.offset * abs(math.sin(0.5 * (one.angle - other.angle)))
            need = one.muscle.braid_radius + other.muscle.braid_radius
            if apart < need:
                found.append(
                    f"muscles {other.name} and {one.name} are {apart:g} mm apart: their radii "
                    f"need {need:g} mm"
                )
    for one in placed:
        contraction = _find_contact(design, one.muscle)
        if contraction is not None:
            found.append(
                f"muscle {one.name} touches the {design.coil_diameter:g} mm coil from a "
                f"contraction of {contraction:.3g} mm on"
            )
    end = kernels.find_end(take_linkage(design))
    if end < design.backbone_length:
        found.append(
            f"offset is {design.offset:g} mm: from a contraction of {end:.4g} mm on not every "
            f"segment closes; the section is used up to {find_peak(design).contraction:.4g} mm"
        )
    return tuple(found)


def _find_contact(design: EffectorDesign, muscle: Muscle) -> float | None:
    """Contraction from which muscle and coil overlap, to a sample; None if they do not."""
    cosine = math.cos(muscle.braid_angle)
    locked = muscle.active_length * (1.0 - math.cos(LOCKING_ANGLE) / cosine)
    contraction = np.linspace(0.0, min(find_peak(design).contraction, locked), SAMPLES)
    stretch = 1.0 - contraction / muscle.active_length
    radius = muscle.braid_radius * np.sqrt(1.0 - (stretch * cosine) ** 2)
    radius /= math.sin(muscle.braid_angle)
    touching = _measure_spacing(design, contraction) < 0.5 * design.coil_diameter + radius
    return float(contraction[np.argmax(touching)]) if touching.any() else None


def _measure_spacing(
    design: EffectorDesign, contraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Least distance from the muscle's joints to the backbone's lines [mm]: at the last joint."""
    linkage = take_linkage(design)
    sines = [kernels.measure_lag(linkage, x, design.segments) for x in contraction]
    return design.offset * np.sqrt(1.0 - np.minimum(sines, 1.0) ** 2)
