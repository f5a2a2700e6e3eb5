"""How long a link may be in a circular bend: closed forms, one for each thing that may limit it.

The bend is a torus, or the ring between two circles in the plane; its limbs are straight. A link is
a segment between two joints with a body of some radius around it (a capsule).

They refute for ducts the hypothesis of thesis 5.3.5, that a link may be as long as the diameter of
a circle that rolls along the wall; under one curve alone such a link can ride in that circle.
`validation.thesis.traverse_curvature` has the test by rolling circles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from bozzini.checks import check_integer, check_number, show_apart
from bozzini.errors import InputError

SIZE_MIN_MM, SIZE_MAX_MM = 1e-6, 1e6
"""Radius and half width of a bend lie between these."""

ANGLE_MIN_RAD = 1e-6
"""A bend by less is straight."""


@dataclass(frozen=True, kw_only=True)
class Bend:
    """A circular bend of a lumen of constant width, and the body that is to pass.

    Parameters
    ----------
    radius : float
        Of the centreline [mm].
    half_width : float
        Distance from the centreline to the wall [mm].
    body_radius : float
        Of the link [mm], smaller than the half width.
    angle : float
        By which the bend turns [rad]. Straight limbs follow on both sides.

    Raises
    ------
    InputError
        If a length is not in [1e-6, 1e6] mm, the body does not fit, or the angle is not in
        [1e-6, pi] rad.
    """

    radius: float
    half_width: float
    body_radius: float = 0.0
    angle: float = math.pi

    def __post_init__(self) -> None:
        for name, size in (("radius of the bend", self.radius), ("half width", self.half_width)):
            check_number(name, size, low=SIZE_MIN_MM, high=SIZE_MAX_MM, unit="mm")
        check_number("body radius", self.body_radius, low=0.0, unit="mm")
        check_number("angle of the bend", self.angle, low=ANGLE_MIN_RAD, high=math.pi, unit="rad")
        if self.body_radius >= self.half_width:
            shown = show_apart(self.body_radius, self.half_width)
            raise InputError(
                f"body radius is {shown[0]} mm: it must lie in "
                f"[0, {shown[1]}) mm, below the half width"
            )

    @property
    def clearance(self) -> float:
        """How far the body's axis may be from the centreline [mm]."""
        return self.half_width - self.body_radius

    @property
    def inner(self) -> float:
        """Smallest radius of the body's axis [mm]; 0 if the bend has no inner wall for it."""
        return max(self.radius - self.clearance, 0.0)

    @property
    def outer(self) -> float:
        """Largest radius of the body's axis [mm]."""
        return self.radius + self.clearance

    def limit_rigid(self, *, flat_ends: bool = False) -> float:
        """Return the longest rigid link that gets through at all [mm].

        It is tangent to the inner wall in the middle, and its ends touch the outer wall:
        ``2 sqrt((b - r)^2 - (a + r)^2) = 4 sqrt(R_c (R_t - r))``, with the walls at ``a`` and
        ``b``. In a bend by less than ``2 acos((a + r)/(b - r))`` the ends touch the outer walls of
        the limbs, ``2 ((b - r) - (a + r) cos(angle/2)) / sin(angle/2)``. Where the bend has no
        inner wall, ``2 (b - r)``.

        Parameters
        ----------
        flat_ends : bool
            The body is a cylinder whose flat ends are the joints, instead of a capsule. Only for
            a bend that holds the whole link.

        Raises
        ------
        InputError
            If `flat_ends` is asked for in a bend by too small an angle, or with no inner wall.

        Notes
        -----
        A link that comes by has to take every direction from one limb's to the other's. The
        longest segment in a direction touches the inner wall; the sum of its two parts is convex
        in the direction, so it is shortest at the half angle.
        """
        a, b = self.inner, self.outer
        if flat_ends:
            return self._limit_flat()
        if self.radius <= self.clearance:
            return 2.0 * b
        half = 0.5 * self.angle
        if half >= math.acos(a / b):
            return 4.0 * math.sqrt(self.radius * self.clearance)
        # b - a cos(half), without taking nearly equal numbers from each other.
        return 2.0 * (2.0 * self.clearance + 2.0 * a * math.sin(0.5 * half) ** 2) / math.sin(half)

    def _limit_flat(self) -> float:
        b = self.radius + self.half_width
        far = self.radius - self.half_width + 2.0 * self.body_radius
        if self.radius <= self.clearance:
            raise InputError("flat ends are only for a bend with an inner wall for the body")
        if 0.5 * self.angle < math.acos(far / b):
            shown = show_apart(self.angle, 2.0 * math.acos(far / b), digits=4)
            raise InputError(
                f"angle of the bend is {shown[0]} rad: with flat ends it must lie in "
                f"[{shown[1]}, pi] rad"
            )
        return 2.0 * math.sqrt((b - far) * (b + far))

    def limit_on_centreline(self) -> float:
        """Return the longest link with both joints on the centreline, body inside [mm].

        The sagitta is at most the clearance: ``2 sqrt((R_t - r)(2 R_c - R_t + r))``; no chord is
        longer than ``2 R_c``. For a bend that holds the whole link. This is the number for chains
        that follow their leader.
        """
        sagitta = min(self.clearance, self.radius)
        return 2.0 * math.sqrt(sagitta * (2.0 * self.radius - sagitta))

    def limit_with_head_at(self, head_radius: float) -> float:
        """Return the longest link whose head stays on a radius, tail free, body inside [mm].

        ``sqrt(rho^2 - (a + r)^2) + sqrt((b - r)^2 - (a + r)^2)``: tangent to the inner wall, tail
        at the outer one. Swinging wide (a head nearer to the outer wall) allows more, up to
        `limit_rigid`.

        Parameters
        ----------
        head_radius : float
            Distance of the head from the middle of the bend [mm].
        """
        rho = check_number("head radius", head_radius, low=self.inner, high=self.outer, unit="mm")
        a, b = self.inner, self.outer
        return math.sqrt((rho - a) * (rho + a)) + math.sqrt((b - a) * (b + a))

    def limit_of_tractrix(self, head_radius: float | None = None) -> float:
        """Return the longest link that a tractrix pulls round for ever without touching [mm].

        The tail settles on the radius ``sqrt(rho^2 - L^2)``, where the link is tangent to the
        tail's circle, so the tail is what comes nearest to the inner wall:
        ``sqrt(rho^2 - (a + r)^2)``.

        Parameters
        ----------
        head_radius : float, optional
            Of the head [mm]; by default on the centreline.
        """
        rho = self._choose_head(head_radius)
        return math.sqrt((rho - self.inner) * (rho + self.inner))

    def first_joint_lock(self, links: int = 1) -> float:
        """Return the shortest link that locks in a U turn if only its joints are constrained [mm].

        The thesis's own problem, head on the centreline: a tail that slides on the inner wall
        stands still once the link is normal to the wall, at ``L = rho + (a + r)`` for a head on
        the radius rho. The first link's head is at ``R_c``, the second's has settled on the inner
        wall: ``2 (a + r)``. Longer chains lock earlier still.

        Above it some lengths pass by a jump of the tail and others do not: it is where locking
        begins, not a largest link. Links below it may cut the wall, see
        `measure_joint_only_depth`.

        Parameters
        ----------
        links : {1, 2}
            How many links the chain has.

        Raises
        ------
        InputError
            If the bend has no inner wall or is no U turn; with two links, if the first one's tail
            does not settle on the inner wall (`limit_of_tractrix` is more than ``2 (a + r)``).
        """
        check_integer("links", links, low=1, high=2)
        if self.radius <= self.clearance:
            raise InputError("a bend without an inner wall does not lock a link")
        if self.angle < math.pi:
            raise InputError(
                f"angle of the bend is {self.angle:g} rad: the formula is for a U turn, pi"
            )
        a = self.inner
        if links == 1:
            return self.radius + a
        if self.limit_of_tractrix() > 2.0 * a:
            shown = show_apart(a, self.radius / math.sqrt(5.0), self.radius)
            raise InputError(
                f"inner radius for the body's axis is {shown[0]} mm: for two links it must lie in "
                f"[{shown[1]}, {shown[2]}) mm"
            )
        return 2.0 * a

    def measure_joint_only_depth(self, length: float) -> float:
        """Return how deep a link cuts the inner wall whose joints alone are kept inside [mm].

        Head on the centreline, tail on the inner wall: the distance of the link from the middle of
        the bend is twice the triangle's area over the length. 0 if its foot is not on the link.

        Parameters
        ----------
        length : float
            Of the link [mm], in ``[R_c - (a + r), R_c + (a + r)]``: others have no such place.
        """
        a, c = self.inner, self.radius
        check_number("length", length, low=c - a, high=c + a, low_open=True, unit="mm")
        along = (length * length + a * a - c * c) / (2.0 * length)
        if along <= 0.0:
            return 0.0
        # Heron, as the product of two differences of squares.
        square = ((c + a) ** 2 - length**2) * (length**2 - (c - a) ** 2)
        return a - math.sqrt(max(square, 0.0)) / (2.0 * length)

    def _choose_head(self, head_radius: float | None) -> float:
        if head_radius is None:
            return self.radius
        return check_number("head radius", head_radius, low=self.inner, high=self.outer, unit="mm")


def limit_by_turning(curvature: float) -> float:
    """Return the length below which the tail of a link on a curve never goes backwards [mm].

    ``2 / curvature``: for both joints on a curve of at most this curvature, no body and no width,
    Schur's comparison theorem gives an angle below 90 degrees between chord and curve at either
    end. Tight for a U turn, not necessary on a wavy curve.

    Parameters
    ----------
    curvature : float
        Largest curvature of the curve [1/mm]; 0 gives infinity.
    """
    check_number("curvature", curvature, low=0.0, unit="1/mm")
    return math.inf if curvature == 0.0 else 2.0 / curvature
