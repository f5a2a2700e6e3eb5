"""Muscles in more detail: moments where the strands cross, and a first estimate (thesis 2.2.7)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...errors import MissingLawError
from .base import CatalogueModel
from .card import BRAID_FIELDS, Card, Law
from .force_balance import pull_ideal

__all__ = ["FAMILY", "BraidTension", "Chen"]

Floats = NDArray[np.float64]

_CHEN = "Chen et al., reference [121] of the thesis"


def _moment(name: str, what: str) -> Law:
    return Law(
        name=name,
        arguments=("pressure [MPa]", "braid angle [rad]"),
        unit="N mm",
        what=what,
        paper=_CHEN,
        required=False,
    )


_FRICTION = ("strand_friction_moment", "bladder_friction_moment")
_ELASTIC = ("bending_moment", "bulging_moment")


class Chen(CatalogueModel):
    """Gaylord's pull less what moments at the crossings of the strands take.

    A moment acts on the angle ``2 theta`` between two strands that cross, and there are
    ``m**2 N / 2`` crossings, with half of the ``m`` strands each way: the work is
    ``m**2 N M d(theta)``, and since ``dl = -b sin(theta) d(theta)`` the force is
    ``m**2 N M / (b sin(theta))``. The print has four times as much, the crossings of ``m`` strands
    each way; ``as_printed=True`` has it too. How the paper defines and counts its moments is not in
    the survey: those given here are of one crossing.

    The moments of friction, of strand on strand and of strand on bladder, change their sign with
    the direction; those of bending the strands and of the bladder that bulges between them do not,
    and resist contraction. All four are laws of pressure and braid angle that only the paper has:
    those not given are left out, and one must be given.
    """

    card = Card(
        name="chen",
        title="Moments at the crossings of the strands",
        authors="Chen et al.",
        reference=_CHEN,
        equation="(2.30)-(2.31)",
        status="partial",
        laws=(
            _moment("strand_friction_moment", "moment of friction at one crossing of strands"),
            _moment("bending_moment", "moment that bends the strands, at one crossing"),
            _moment("bulging_moment", "moment of the bladder that bulges, at one crossing"),
            _moment(
                "bladder_friction_moment", "moment of friction on the bladder, at one crossing"
            ),
        ),
        uses=(*BRAID_FIELDS, "strands"),
        errata=(
            "The factor 4 m**2 N is of m strands each way; with m strands both ways together, as "
            "the survey has it in (2.10), the work at the crossings gives m**2 N.",
        ),
        latex=r"F = \frac{P b^2}{4 \pi N^2} \left(3 \cos^2\theta - 1\right) "
        r"- \frac{m^2 N}{b \sin\theta} \left[M_d + M_r \pm (M_f + M_{tr})\right]",
        latex_printed=r"F = \frac{\pi P}{4} \left(\frac{b}{N \pi}\right)^2 "
        r"\left(3 \cos^2\theta - 1\right) \mp \frac{4 m^2 N}{b \sin\theta} "
        r"\left(M_f \pm M_d \pm M_r + M_{tr}\right)",
        missing=f"the moments of friction, bending and bulging: {_CHEN}",
    )

    def _check(self) -> None:
        given = self.keywords
        if not any(law.name in given for law in self.card.laws):
            names = ", ".join(law.name for law in self.card.laws)
            raise MissingLawError(
                f"the model chen must be given one at least of the laws {names} (pressure [MPa], "
                f"braid angle [rad]), in N mm at one crossing: they are in {_CHEN}"
            )

    def _sum_moments(self, names: tuple[str, str], pressure: Floats, length: Floats) -> Floats:
        """Force that the given ones of some moments take [N]."""
        angle = np.arccos(length / self.braid.strand_length)
        moments = [self._call(name, pressure, angle) for name in names if name in self.keywords]
        scale = self.muscle.strands**2 * self.braid.turns / self.braid.strand_length
        total = np.sum(moments, axis=0) if moments else np.zeros(pressure.shape)
        return np.asarray((4.0 if self.as_printed else 1.0) * scale * total / np.sin(angle))

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        ideal = pull_ideal(self.braid, pressure, length)
        return np.asarray(ideal - self._sum_moments(_ELASTIC, pressure, length))

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        return self._sum_moments(_FRICTION, pressure, length)


class BraidTension(CatalogueModel):
    """The pull of the strands alone, which forgets the pressure on the ends of the muscle.

    ``F = P l**2 / (2 pi N**2)`` is the axial part of the strands' tension at whatever radius the
    braid has; Gaylord's pull is that less ``P pi r**2``. So it never ends: without load there is no
    equilibrium above zero length, and no locking. It is the estimate from which the cited work set
    its finite-element analysis, and is kept for that.
    """

    card = Card(
        name="braid-tension",
        title="Tension of the strands alone, a first estimate",
        authors="unnamed in the survey",
        reference="Reference [122] of the thesis, on muscles for parachutes",
        equation="(2.33)",
        status="self-contained",
        errata=(
            "It leaves out the pressure on the ends, P pi r**2: the pull is too large by it, and "
            "has no locking angle.",
        ),
        latex=r"F = \frac{2 \pi r_0^2 P}{\tan^2\theta_0} (1 - \epsilon)^2 "
        r"\quad \Leftrightarrow \quad "
        r"\epsilon = 1 - \sqrt{\frac{F \tan^2\theta_0}{2 \pi r_0^2 P}}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return np.asarray(pressure * length**2 / (2.0 * math.pi * self.braid.turns**2))


FAMILY: tuple[type[CatalogueModel], ...] = (Chen, BraidTension)
"""The models of this module, for the registry."""
