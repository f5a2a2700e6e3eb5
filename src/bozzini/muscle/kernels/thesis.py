"""Numba kernels of `ThesisMuscle`: the contraction phase at one braid angle, and its root.

``design`` is the tuple of `ThesisMuscle`: Lamé's constants, the tube's radii and length when it
meets the braid, sine, cosine and tangent of the braid's angle then, the share of the cylinder that
strands touch times (sin cos)^2, the length of an end, and the share of the pull that the strands
bear.
"""

from __future__ import annotations

import math

from ...numeric.compiling import kernel
from .interface import (
    NO_ANSWER,
    PULLS,
    RIGID,
    SLACK,
    unpack_design,
    view_numbers,
    view_out,
)

MAX_ITERATIONS = 200


@kernel
def measure_closure(design, excess, angle):
    """Pull of the bore's pressure less what the braid's pressure balances [N], and the tube.

    ``excess`` is the pressure above that of contact. At a given angle (3.13) fixes two
    displacements of the tube, from which (3.3) gives the pressure of the braid and the axial
    stress, linearly. Returns the residual of (3.23), the braid's pressure and the deformed bore.
    """
    first, second, inner, outer, length, sine, cosine, tangent, contact, end, share = design
    sin, cos = math.sin(angle), math.cos(angle)
    hoop = sin / sine - 1.0
    axial = cos / cosine - 1.0
    bore = inner * inner / (outer * outer - inner * inner)
    bulk = second * (3.0 * first + 2.0 * second)
    # c1 = across / (2 (L1 + L2)) - axial L1 / (2 (L1 + L2)), after the axial stress is eliminated,
    # with across = p bore - P_o (bore + 1); c2 / r_o^2 = (p - P_o) bore / (2 L2).
    sum_ = first + second
    both = (first + 2.0 * second - first * first / sum_) / (2.0 * bulk)
    poisson = first / (2.0 * sum_)
    shear = 0.5 * bore / second
    load = excess * (bore * both + shear) - poisson * axial - hoop
    braid = load / ((bore + 1.0) * both + shear)
    c1 = both * (excess * bore - braid * (bore + 1.0)) - poisson * axial
    opened = inner * (1.0 + c1 + 0.5 * (excess - braid) * (bore + 1.0) / second)
    radius = outer * sin / sine
    area = (1.0 + axial) * (
        contact / (sin * cos) ** 2 * 2.0 * math.pi * radius * (length - 2.0 * end)
        + 2.0 * math.pi * (outer + radius) * end
    )
    pull = share * math.pi * opened * opened * excess
    return pull - braid * area * outer * cos / (length * sin * tangent), braid, opened


@kernel
def narrow_bracket(left, miss_left, right, miss_right, middle, miss):
    """The bracket after a step of Anderson and Bjoerck's regula falsi."""
    if (miss > 0.0) == (miss_right > 0.0):
        scale = 1.0 - miss / miss_right
        return left, miss_left * (scale if scale > 0.0 else 0.5), middle, miss
    scale = 1.0 - miss / miss_left
    return middle, miss, right, miss_right * (scale if scale > 0.0 else 0.5)


@kernel
def find_angle(design, excess, low, high):
    """The angle in a bracket where the closure holds, by Anderson and Bjoerck's regula falsi.

    Returns the angle, the residual [N] and the iterations; -1 iterations if there is no sign
    change in the bracket.
    """
    left, right = low, high
    miss_left, _, _ = measure_closure(design, excess, left)
    miss_right, _, _ = measure_closure(design, excess, right)
    if not miss_left < 0.0 < miss_right:
        return left, miss_left, -1
    last = high
    for iteration in range(1, MAX_ITERATIONS):
        middle = (left * miss_right - right * miss_left) / (miss_right - miss_left)
        if iteration % 16 == 0 or not left < middle < right:
            middle = 0.5 * (left + right)
        miss, _, _ = measure_closure(design, excess, middle)
        if miss == 0.0 or min(right - left, abs(middle - last)) <= 4e-16 * right:
            return middle, miss, iteration
        last = middle
        left, miss_left, right, miss_right = narrow_bracket(
            left, miss_left, right, miss_right, middle, miss
        )
    miss, _, _ = measure_closure(design, excess, 0.5 * (left + right))
    return 0.5 * (left + right), miss, MAX_ITERATIONS


@kernel
def contracts_further(design, excess, angle):
    """Whether the braid's angle grows with the pressure at an angle where the closure holds.

    Past its peak the linear tube is squeezed by more than it swells, and the equations fail.
    """
    step = 1e-6 * excess
    above, _, _ = measure_closure(design, excess + step, angle)
    below, _, _ = measure_closure(design, excess - step, angle)
    return above < below


@kernel
def find_angles(design, excesses, low, high, out, iterations):
    """Fill ``out`` (3, n) with angle, braid pressure and residual; the index of the first miss."""
    for n in range(excesses.size):
        angle, miss, taken = find_angle(design, excesses[n], low, high)
        if taken < 0:
            return n
        _, braid, opened = measure_closure(design, excesses[n], angle)
        if not (opened > 0.0 and contracts_further(design, excesses[n], angle)):
            return n
        out[0, n] = angle
        out[1, n] = braid
        out[2, n] = miss
        iterations[n] = taken
    return -1


@kernel
def find_thesis_pressure(design, contact, free, length, limit):
    """The pressure in [contact, limit] at which the thesis's muscle contracts so without load.

    The closure falls with the pressure at a given angle: Anderson and Bjoerck's regula falsi. At a
    contraction that the limit does not give, the limit. Returns the iterations too.
    """
    angle = math.acos((length - free) * design[6] / design[4])
    left, right = 0.0, limit - contact
    miss_left, _, _ = measure_closure(design, left, angle)
    miss_right, _, _ = measure_closure(design, right, angle)
    if not miss_right < 0.0:
        return limit, 1
    if not miss_left > 0.0:
        return contact, 1
    last = right
    for iteration in range(1, MAX_ITERATIONS):
        middle = (left * miss_right - right * miss_left) / (miss_right - miss_left)
        if iteration % 16 == 0 or not left < middle < right:
            middle = 0.5 * (left + right)
        miss, _, _ = measure_closure(design, middle, angle)
        if miss == 0.0 or min(right - left, abs(middle - last)) <= 4e-16 * right:
            return contact + middle, iteration
        last = middle
        left, miss_left, right, miss_right = narrow_bracket(
            left, miss_left, right, miss_right, middle, miss
        )
    return contact + 0.5 * (left + right), MAX_ITERATIONS


# What `bozzini.muscle.kernels.interface` asks for. The numbers are ``design``, the pressure of
# contact, the free length, the strain per pressure before contact, the bracket of angles (2) and
# the stiffness of the load path, 0 where there is none.


@kernel
def find_free_contraction(numbers, pressure):
    """Contraction without load [mm], and whether there is one."""
    contact, length = numbers[11], numbers[12]
    if pressure <= contact:
        return -length * numbers[13] * pressure, True
    design = unpack_design(numbers)
    angle, _, iterations = find_angle(design, pressure - contact, numbers[14], numbers[15])
    _, _, opened = measure_closure(design, pressure - contact, angle)
    found = iterations >= 0 and opened > 0.0
    found = found and contracts_further(design, pressure - contact, angle)
    return length - design[4] * math.cos(angle) / design[6], found


def start(numbers_at, pressure, most, out_at):
    """Where to look for an equilibrium; the state is the contraction without load."""
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    free, found = find_free_contraction(numbers, pressure)
    out[0] = free
    out[1] = out[2] = 0.0
    if not found:
        return NO_ANSWER
    if numbers[16] == 0.0:
        return RIGID
    if free <= 0.0:
        return PULLS if free == 0.0 else SLACK
    out[1] = min(most, free)
    out[2] = 0.75 * out[1]
    return PULLS


def pull(numbers_at, state, pressure, contraction, out_at):
    """The pull and its slope: those of the load path."""
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    out[0] = numbers[16] * (state - contraction)
    out[1] = -numbers[16]
    return 0


def pressure(numbers_at, contraction, force, limit, out_at):
    """The pressure at which it pulls so."""
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    free = contraction if numbers[16] == 0.0 else contraction + force / numbers[16]
    out[0], iterations = find_thesis_pressure(
        unpack_design(numbers), numbers[11], free, numbers[12], limit
    )
    return iterations
