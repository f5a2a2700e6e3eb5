"""Numba kernels of `EnergyMuscle`: wall energy, pull, and the stretch under a load.

``design`` is the tuple of `EnergyMuscle.pack`:
``(c0, s0, rb0, Ri2, Ro2, log(Ro/Ri), C10, C01, friction, low, high)`` with the braid's cosine, sine
and radius at rest, the squared radii of the tube, the constants of the wall, the pull of friction
per contact pressure and stretch [mm^2], and the legal stretches. A state is the axial stretch
``stretch`` and ``swell``, by which the map of the wall ``r**2 = (R**2 + swell) / stretch`` differs
from the identity [mm^2].
"""

from __future__ import annotations

import math

from ...numeric.compiling import kernel
from .interface import PULLS, SLACK, unpack_design, view_numbers, view_out

STRETCH_TOLERANCE = 1e-12
"""Newton's last step, relative to the stretch: the next one would be its square."""

MAX_ITERATIONS = 200

CONVERGED, TOO_HEAVY, TOO_LIGHT, STOPPED = 0, 1, 2, 3


@kernel(error_model="numpy")
def swell_terms(design, swell):
    """``f``, ``f'`` and ``f''`` of the wall's hoop and radial energy in the swell.

    ``f = integral of R ((R**2 + swell)/R**2 + R**2/(R**2 + swell))`` over the wall, closed form.
    """
    inner, outer = design[3], design[4]
    wall = outer - inner
    b = outer + swell
    half = 0.5 * math.log1p(swell * wall / (inner * b))
    inverse = 1.0 / ((inner + swell) * b)
    slope = half + 0.5 * swell * wall * inverse
    curve = wall * inverse * inverse * (inner * outer + 0.5 * swell * (inner + outer))
    return wall + swell * half, slope, curve


@kernel
def wall_energy(design, stretch, swell):
    """Strain energy of the wall per rest length, over 2 pi [N]."""
    first, second = design[6], design[7]
    wall = design[4] - design[3]
    f, _, _ = swell_terms(design, swell)
    square = stretch * stretch
    return first * (0.5 * wall * square + f / stretch - 1.5 * wall) + second * (
        0.5 * wall / square + stretch * f - 1.5 * wall
    )


@kernel
def braid_swell(design, stretch):
    """The swell at which the tube fills the braid, and its first two derivatives."""
    # sin**2 / sin0**2 = 1 - (stretch**2 - 1) cot0**2, which keeps its digits near rest.
    area = design[2] * design[2]
    cotangent = (design[0] / design[1]) ** 2
    square = stretch * stretch
    share = 1.0 - (stretch - 1.0) * (stretch + 1.0) * cotangent
    return (
        stretch * area * share - design[4],
        area * (share - 2.0 * square * cotangent),
        -6.0 * area * stretch * cotangent,
    )


@kernel(error_model="numpy")
def free_swell(design, target):
    """The swell of a free tube, where ``f' = target >= 0``; Newton from the left, f' is concave.

    Not finite where no wall of rubber holds that pressure.
    """
    swell = 0.0
    for _ in range(MAX_ITERATIONS):
        _, slope, curve = swell_terms(design, swell)
        step = (target - slope) / curve
        swell += step
        if not step > 1e-15 * (design[3] + swell):
            break
    return swell


@kernel(error_model="numpy")
def find_force(design, pressure, stretch, sign):
    """Pull [N], its slope in the stretch, contact pressure [MPa] and swell, at a stretch.

    ``sign`` is -1 while inflating, +1 while deflating, 0 without friction.
    """
    first, second = design[6], design[7]
    wall = design[4] - design[3]
    swell, braid_slope, braid_curve = braid_swell(design, stretch)
    f, slope, curve = swell_terms(design, swell)
    inverse = 1.0 / stretch
    square = inverse * inverse
    shear = first * inverse + second * stretch
    contact = pressure - 2.0 * shear * slope
    shear_slope = second - first * square
    if contact > 0.0:
        # dW/dz and the second derivatives of W along the braid's constraint.
        w_z = wall * (first * stretch - second * square * inverse) + shear_slope * f
        w_zz = first * (wall + 2.0 * f * square * inverse) + 3.0 * second * wall * square * square
        pull = 2.0 * math.pi * w_z - math.pi * contact * braid_slope
        along = w_zz + braid_slope * (2.0 * shear_slope * slope + shear * curve * braid_slope)
        stiffness = 2.0 * math.pi * along - math.pi * contact * braid_curve
        if sign != 0.0:
            arm = sign * design[8]
            change = -2.0 * (shear_slope * slope + shear * curve * braid_slope)
            pull += arm * contact * stretch
            stiffness += arm * (contact + stretch * change)
        return pull, stiffness, contact, swell
    swell = free_swell(design, 0.5 * pressure / shear)
    f, slope, curve = swell_terms(design, swell)
    w_z = wall * (first * stretch - second * square * inverse) + shear_slope * f
    w_zz = first * (wall + 2.0 * f * square * inverse) + 3.0 * second * wall * square * square
    along = w_zz - (shear_slope * slope) ** 2 / (shear * curve)
    return 2.0 * math.pi * w_z, 2.0 * math.pi * along, 0.0, swell


@kernel
def guess_stretch(design, pressure, load):
    """A first stretch: of the braid alone under the pressure that it may hold."""
    area = math.pi * (design[2] / design[1]) ** 2
    grip = pressure - 2.0 * (design[6] + design[7]) * design[5]
    wall = 4.0 * math.pi * (design[6] + design[7]) * (design[4] - design[3])
    if grip <= 0.0:
        return 1.0
    cosine = design[0]
    lock = 1.0 / (math.sqrt(3.0) * cosine)
    soft = math.sqrt((1.0 + max(load, -0.9 * area * grip) / (area * grip)) / 3.0) / cosine
    # Between braid and wall as two springs in parallel.
    spring = 6.0 * area * grip * cosine * cosine * lock
    return (spring * soft + wall) / (spring + wall)


@kernel
def find_stretch(design, pressure, load, sign):
    """The stretch at which the pull is ``load``; a code and the iterations.

    Newton inside a bracket that begins as the legal stretches, whose ends are only evaluated if a
    step wants to leave it.
    """
    if pressure == 0.0 and load == 0.0:
        return 1.0, CONVERGED, 0
    low, high = design[9], design[10]
    low_known = False
    high_known = False
    stretch = guess_stretch(design, pressure, load)
    if not low < stretch < high:
        stretch = 0.5 * (low + high)
    for iteration in range(1, MAX_ITERATIONS):
        pull, stiffness, _, _ = find_force(design, pressure, stretch, sign)
        miss = pull - load
        if miss == 0.0:
            return stretch, CONVERGED, iteration
        if miss > 0.0:
            high = stretch
            high_known = True
        else:
            low = stretch
            low_known = True
        if stiffness > 0.0:
            following = stretch - miss / stiffness
        else:
            following = high + 1.0 if miss < 0.0 else low - 1.0
        if abs(following - stretch) <= STRETCH_TOLERANCE * stretch and (low <= following <= high):
            return following, CONVERGED, iteration
        if following >= high:
            if not high_known:
                pull, _, _, _ = find_force(design, pressure, high, sign)
                if pull < load:
                    return high, TOO_HEAVY, iteration
                high_known = True
            following = 0.5 * (low + high)
        elif following <= low:
            if not low_known:
                pull, _, _, _ = find_force(design, pressure, low, sign)
                if pull > load:
                    return low, TOO_LIGHT, iteration
                low_known = True
            following = 0.5 * (low + high)
        if high - low <= 4e-16 * high:
            return following, CONVERGED, iteration
        stretch = following
    return stretch, STOPPED, MAX_ITERATIONS


@kernel
def find_stretches(design, pressures, loads, signs, stretches, iterations):
    """Fill the stretches of a batch; the code and index of the first without an equilibrium.

    One that ran out of iterations does not end the batch: it took ``MAX_ITERATIONS``.
    """
    for n in range(stretches.size):
        stretch, code, taken = find_stretch(design, pressures[n], loads[n], signs[n])
        if code == TOO_HEAVY or code == TOO_LIGHT:
            return code, n
        stretches[n] = stretch
        iterations[n] = taken
    return CONVERGED, -1


@kernel
def find_forces(design, pressures, stretches, signs, out):
    """Fill ``out`` (4, n) with the pull, its slope, the contact pressure and the swell."""
    for n in range(stretches.size):
        terms = find_force(design, pressures[n], stretches[n], signs[n])
        for i in range(4):
            out[i, n] = terms[i]


@kernel
def fill_energies(design, stretches, swells, out):
    """Fill ``out`` (n,) from `wall_energy`."""
    for n in range(stretches.size):
        out[n] = wall_energy(design, stretches[n], swells[n])


@kernel
def find_contact(design):
    """The stretch, 1 or more, at which an unloaded tube meets the braid: dW/dz = 0 along it."""
    low, high = 1.0, design[10]
    for _ in range(MAX_ITERATIONS):
        stretch = 0.5 * (low + high)
        if not low < stretch < high:
            break
        swell, _, _ = braid_swell(design, stretch)
        f, _, _ = swell_terms(design, swell)
        wall = design[4] - design[3]
        inverse = 1.0 / stretch
        slope = wall * (design[6] * stretch - design[7] * inverse**3) + f * (
            design[7] - design[6] * inverse * inverse
        )
        # Where the tube is as wide as at rest it is longer, so they have met before.
        if slope > 0.0 or swell <= 0.0:
            high = stretch
        else:
            low = stretch
    return 0.5 * (low + high)


@kernel
def find_closed_bore(design, inside, outside):
    """The stretch towards ``outside`` at which the braid closes 98 % of the bore's area.

    ``inside`` is a stretch where it does not; ``outside`` itself is returned if the bore is open.
    """
    target = -0.98 * design[3]
    if braid_swell(design, outside)[0] >= target:
        return outside
    for _ in range(MAX_ITERATIONS):
        stretch = 0.5 * (inside + outside)
        if stretch in (inside, outside):
            break
        if braid_swell(design, stretch)[0] > target:
            inside = stretch
        else:
            outside = stretch
    return inside


@kernel
def pack_design(inner, outer, angle, gap, modulus, mooney_ratio, friction_length, past_locking):
    """A muscle's radii [mm], angle [rad], modulus [MPa] and so on as the tuple ``design``.

    The last two numbers, the legal stretches, end where the bore is squeezed shut or the braid
    locks; with friction at ``past_locking``, a cosine.
    """
    cosine, sine = math.cos(angle), math.sin(angle)
    shear = modulus / 6.0
    radius = outer + gap
    crossing = 8.0 * math.pi / 3.0 * radius * cosine / sine
    locked = 1.0 / (math.sqrt(3.0) * cosine)
    design = (
        cosine,
        sine,
        radius,
        inner * inner,
        outer * outer,
        math.log(outer / inner),
        shear * (1.0 - mooney_ratio),
        shear * mooney_ratio,
        crossing * friction_length,
        locked,
        1.0 / cosine,
    )
    low = locked
    if friction_length > 0.0:
        low = find_closed_bore(design, locked, past_locking / cosine)
    high = find_closed_bore(design, 1.0, 1.0 / cosine)
    return (
        design[0], design[1], design[2], design[3], design[4], design[5], design[6], design[7],
        design[8], low, high,
    )  # fmt: skip


@kernel
def find_energy_pressure(design, stretch, pull):
    """The pressure at which a braided tube in contact pulls so at a stretch; and that of contact.

    At a given stretch the pull is linear in the pressure between tube and braid. A contact pressure
    that is not positive is no answer. There is no friction.
    """
    first, second = design[6], design[7]
    wall = design[4] - design[3]
    swell, braid_slope, _ = braid_swell(design, stretch)
    f, slope, _ = swell_terms(design, swell)
    inverse = 1.0 / stretch
    square = inverse * inverse
    w_z = wall * (first * stretch - second * square * inverse) + (second - first * square) * f
    if not braid_slope < 0.0:  # the braid is locked: no pressure makes it contract further
        return math.inf, math.inf
    contact = (2.0 * math.pi * w_z - pull) / (math.pi * braid_slope)
    return contact + 2.0 * (first * inverse + second * stretch) * slope, contact


# What `bozzini.muscle.kernels.interface` asks for. The numbers are ``design`` and the length that
# contracts.


def start(numbers_at, pressure, most, out_at):
    """Where to look for an equilibrium; without a state."""
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    design, active = unpack_design(numbers), numbers[11]
    pull, slope, _, _ = find_force(design, pressure, 1.0, 0.0)
    out[0] = out[1] = out[2] = 0.0
    if pull <= 0.0:
        return PULLS if pull == 0.0 else SLACK
    high = min(most, active * (1.0 - design[9]))
    out[1] = high
    out[2] = min(0.5 * high, pull * active / slope) if slope > 0.0 else 0.5 * high
    return PULLS


def pull(numbers_at, state, pressure, contraction, out_at):
    """The pull and its slope."""
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    active = numbers[11]
    force, slope, _, _ = find_force(
        unpack_design(numbers), pressure, 1.0 - contraction / active, 0.0
    )
    out[0] = force
    out[1] = slope / -active
    return 0


def pressure(numbers_at, contraction, force, limit, out_at):
    """The pressure at which it pulls so, in closed form."""
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    found, _ = find_energy_pressure(unpack_design(numbers), 1.0 - contraction / numbers[11], force)
    out[0] = min(found, limit)
    return 0
