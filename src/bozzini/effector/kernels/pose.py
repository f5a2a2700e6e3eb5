"""Numba kernels: several muscles at once, by superposed forces or by the thesis's eight steps.

Superposed: with the lateral deflection ``delta_j`` [mm] that muscle j, at the angle ``phi_j``, has
from its own equilibrium, the section bends by ``|d|`` in the plane of ``d = sum_j delta_j (cos
phi_j, sin phi_j)``, as one muscle there would bend it: its contraction ``x`` is the root of
``delta(x) = |d|``, or that of the peak if ``|d|`` is beyond. Forces ``delta / c`` add up likewise.
"""

from __future__ import annotations

import math

from ...numeric.compiling import kernel
from .linkage import fill_backbone, find_contraction

ROUND_OFF = 1e-12

IN_PLANE = 1e-9
"""Sine of the angle to a plane below which a displacement lies in it."""


@kernel
def superpose(
    linkage, top, peak, cosines, sines, contractions, laterals, plane, vectors, backbones, ends
):
    """Fill poses (k, ...) whose lateral deflection is the sum of those of each muscle alone.

    Returns the case and the segment that cannot close; -1 and 0 where there is none.

    ``plane`` (2, n + 1) is a work array; ``vectors`` (k, 4): lateral x and y, the deflection
    asked for, and the contraction of one muscle that would give it; ``backbones`` (k, n + 1, 3);
    ``ends`` (k, 3): unit vector of the last piece.
    """
    for i in range(laterals.shape[0]):
        x, y = 0.0, 0.0
        largest, start = 0.0, 0.0
        for j in range(laterals.shape[1]):
            x += laterals[i, j] * cosines[j]
            y += laterals[i, j] * sines[j]
            if laterals[i, j] > largest:
                largest = laterals[i, j]
                start = contractions[i, j]
        demanded = math.hypot(x, y)
        if demanded > 0.0:
            x /= demanded
            y /= demanded
        else:
            x, y = 1.0, 0.0
        if demanded >= peak:
            shortened = top
        else:
            shortened, _ = find_contraction(linkage, demanded, top, start)
        failed, sin, cos = fill_backbone(linkage, shortened, plane[0], plane[1])
        vectors[i, 3] = shortened
        if failed > 0:
            return i, failed
        given = demanded if demanded <= peak else peak
        vectors[i, 0] = given * x
        vectors[i, 1] = given * y
        vectors[i, 2] = demanded
        backbones[i, 0, :] = 0.0
        for k in range(1, plane.shape[1]):
            backbones[i, k, 0] = plane[0, k] * x
            backbones[i, k, 1] = plane[0, k] * y
            backbones[i, k, 2] = plane[1, k]
        ends[i, 0] = sin * x
        ends[i, 1] = sin * y
        ends[i, 2] = cos
    return -1, 0


@kernel
def combine_steps(linkage, cosines, sines, contractions, forces, first, second, planes, backbones):
    """Fill backbones (k, n + 1, 3) by the thesis's eight steps.

    Returns the case of a failure, or -1; the node without an answer, or 0; the segment of a muscle
    alone that cannot close, or 0.
    ``first`` and ``second`` (k,) are the places of the muscles in the order in which they are
    pressed, -1 for none; ``planes`` (4, n + 1) is a work array.
    """
    piece = linkage[1] / linkage[2]
    for i in range(first.size):
        one, two = first[i], second[i]
        planes[:] = 0.0
        for k in range(linkage[2] + 1):
            planes[1, k] = planes[3, k] = piece * k
        cos1, sin1, cos2, sin2 = 1.0, 0.0, 1.0, 0.0
        across, along = 0.0, 0.0
        if one >= 0:
            failed, _, _ = fill_backbone(linkage, contractions[i, one], planes[0], planes[1])
            if failed > 0:
                return i, 0, failed
            cos1, sin1 = cosines[one], sines[one]
            across, along = forces[i, one] * cos1, forces[i, one] * sin1
        if two >= 0:
            failed, _, _ = fill_backbone(linkage, contractions[i, two], planes[2], planes[3])
            if failed > 0:
                return i, 0, failed
            cos2, sin2 = cosines[two], sines[two]
            across += forces[i, two] * cos2
            along += forces[i, two] * sin2
        size = math.hypot(across, along)
        total = forces[i, one] + forces[i, two] if two >= 0 else size
        if size > ROUND_OFF * total:
            across /= size
            along /= size
        else:  # opposite and equal: no plane, so that the displacements are added
            across, along = 0.0, 0.0
        backbones[i, 0, :] = 0.0
        for k in range(1, linkage[2] + 1):
            base = piece * k
            # Displacements from the straight section, each in its muscle's plane.
            x1, y1 = planes[0, k] * cos1, planes[0, k] * sin1
            z1 = planes[1, k] - base
            x2, y2 = planes[2, k] * cos2, planes[2, k] * sin2
            z2 = planes[3, k] - base
            # Turn the second by the first one's last piece: about q = k x t, of angle beta.
            beta = math.atan2(planes[0, k] - planes[0, k - 1], planes[1, k] - planes[1, k - 1])
            sin, cos = math.sin(beta), math.cos(beta)
            ahead = x2 * cos1 + y2 * sin1
            aside = -x2 * sin1 + y2 * cos1
            turned = ahead * cos + z2 * sin
            z2 = z2 * cos - ahead * sin
            x2 = turned * cos1 - aside * sin1
            y2 = turned * sin1 + aside * cos1
            scale = 1.0
            move = math.sqrt(x2 * x2 + y2 * y2 + z2 * z2)
            if move > ROUND_OFF * linkage[1]:
                off1 = along * x1 - across * y1
                off2 = along * x2 - across * y2
                if abs(off2) > IN_PLANE * move:
                    scale = -off1 / off2
                elif abs(off1) > IN_PLANE * math.hypot(x1, y1):
                    return i, k, 0
            backbones[i, k, 0] = x1 + scale * x2
            backbones[i, k, 1] = y1 + scale * y2
            backbones[i, k, 2] = base + z1 + scale * z2
    return -1, 0, 0
