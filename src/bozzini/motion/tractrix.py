"""The free chain: what a chain of links does when only its head is moved (thesis 5.3.1, App. C).

A link's tail moves along the link only: the tractrix. With slip it also takes a share of its
head's move. Nothing holds the chain but its head: no wall, no contact, no weight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points
from ..errors import InputError

__all__ = ["SCHEMES", "move_free_chain"]

SCHEMES = ("exact", "least")
"""Closed form of the tractrix, or the thesis's least move of each tail per head step."""

SUBSTEP = 0.1
"""The closed form is applied to moves of at most this share of the shortest link."""


def move_free_chain(
    joints: ArrayLike,
    head_path: ArrayLike,
    *,
    slip: float = 0.0,
    scheme: str = "exact",
    substep: float | None = None,
) -> NDArray[np.float64]:
    """Move a free chain by moving its head along a polyline.

    Parameters
    ----------
    joints : (joints, dim) float
        Where the chain is before the motion, head first [mm]; dim is 2 or 3. Its links keep the
        lengths that they have here.
    head_path : (steps, dim) float
        Where the head goes in turn, along straight lines [mm].
    slip : float
        nu, 0 to 1: the share of its head's move that a tail takes on as it is. 0 is the tractrix,
        1 a chain that is shifted without turning. Thesis Appendix C reads 0.95 off a bicycle chain
        on photo paper and 0.86 on gravel.
    scheme : {"exact", "least"}
        ``"exact"``: the closed form of a link whose head moves along a straight line. It is exact
        for the first link and second order in `substep` for those behind, whose heads move along
        curves. ``"least"``: each tail moves once per step, least (thesis eq. 5.13, with slip
        6.6); first order in the length of the steps.
    substep : float, optional
        Longest straight move at a time for ``"exact"`` [mm], at most the shortest link; by
        default a tenth of that.

    Returns
    -------
    (steps, joints, dim) float
        The chain when its head is at each point of `head_path` [mm].

    Raises
    ------
    InputError
        If a shape or number is out of range, or a link has no length.

    Notes
    -----
    With w the unit vector from head to tail, e that of the head's move of length s, c = w.e and
    sigma = (1 - nu) s / L, the new w is ``(w - c e) + (c cosh sigma - sinh sigma) e``, normalised:
    slip is a tractrix with the link L / (1 - nu). The tangent of half the angle between link and
    move shrinks by exp(-sigma). A tail never moves farther than its head.

    Appendix C prints the slip vector as nu X_h, with X_h the head's **position**, which depends on
    where the origin is; here it is nu times the head's **displacement**, nu (x_h - X_h).
    """
    from .kernels.tractrix import pull_chain

    chain = np.array(joints, dtype=np.float64)
    if chain.ndim != 2 or chain.shape[0] < 2 or chain.shape[1] not in (2, 3):
        raise InputError(f"joints have shape {chain.shape}: it must be (joints >= 2, 2 or 3)")
    check_points("joints", chain, dim=chain.shape[1])
    heads = check_points("head path", head_path, dim=chain.shape[1])
    if heads.ndim != 2 or len(heads) < 1:
        raise InputError(f"head path has shape {heads.shape}: it must be (steps >= 1, dim)")
    lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    shortest = float(lengths.min())
    if shortest <= 0.0:
        raise InputError(f"link {int(np.argmin(lengths)) + 1} has length 0: it must be above 0 mm")
    check_number("slip", slip, low=0.0, high=1.0)
    if scheme not in SCHEMES:
        raise InputError(f"scheme is {scheme!r}: it must be one of {', '.join(SCHEMES)}")
    pitch = 0.0
    if scheme == "exact":
        pitch = SUBSTEP * shortest if substep is None else substep
        check_number("substep", pitch, low=0.0, high=shortest, low_open=True, unit="mm")
    elif substep is not None:
        raise InputError("scheme 'least' knows no substep: give a finer head path")
    result = np.empty((len(heads), *chain.shape))
    step, link = pull_chain(
        chain, lengths, np.ascontiguousarray(heads), float(slip), float(pitch), result
    )
    if step >= 0:
        raise InputError(
            f"head step {step}: link {link}'s head lands on the old place of its tail, which "
            "leaves the link no direction; use shorter steps"
        )
    return result
