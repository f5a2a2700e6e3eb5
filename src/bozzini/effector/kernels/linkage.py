"""Numba kernels of the planar linkage: where backbone and muscle are at a contraction.

``linkage`` is ``(offset, length, segments)``. Per segment, backbone ``l = length / segments``,
muscle ``m = (length - contraction) / segments``, link ``a = offset``. Equation (4.4) puts the end
of the muscle's piece at its target, parallel to the backbone's last piece, so that each segment is
one quadrilateral. With ``d`` from a joint of the backbone to the next end of the muscle::

    d = (a cos(lag), m - a sin(lag))        seen from the piece before
      = (a cos(lag'), l - a sin(lag'))      seen from the piece that is sought

Equal lengths give the next lag, the angle by which the link falls behind the backbone's normal, and
the angle between the two views is the turn of the backbone::

    sin(lag') = (m / l) sin(lag) + (l**2 - m**2) / (2 a l),   cos(lag') >= 0 (uncrossed)

so ``sin(lag_k) = (l + m) / (2 a) (1 - (m / l)**k)``, and segment k closes if that is below 1.
Headings are kept as sine and cosine; no angle is taken in the loop.
"""

from __future__ import annotations

import math

from ...numeric.compiling import kernel

MAX_ITERATIONS = 200


@kernel
def measure_lag(linkage, contraction, segment):
    """Sine of the lag after a segment, in closed form; 1 or more where it cannot close."""
    offset, length, segments = linkage
    share = contraction / length
    # 1 - (1 - share)**k keeps its digits at a small share.
    grown = -math.expm1(segment * math.log1p(-share)) if share < 1.0 else 1.0
    return 0.5 * length / segments * (2.0 - share) / offset * grown


@kernel
def split_length(linkage, contraction):
    """Backbone and muscle of a segment [mm], and the ratio and gain of the next lag's sine."""
    offset, length, segments = linkage
    rest = length / segments
    short = (length - contraction) / segments
    return (
        rest,
        short,
        short / rest,
        contraction / segments * (rest + short) / (2.0 * offset * rest),
    )


@kernel
def turn_heading(sin, cos, turn_sin, turn_cos):
    """Sine and cosine of a heading after a turn, made a unit vector to first order."""
    turned = sin * turn_cos + cos * turn_sin
    cos = cos * turn_cos - sin * turn_sin
    scale = 1.5 - 0.5 * (turned * turned + cos * cos)
    return turned * scale, cos * scale


@kernel
def measure_lateral(linkage, contraction):
    """Lateral place of the backbone's end [mm], its slope, the segment that cannot close or 0."""
    offset, length, segments = linkage
    rest, short, ratio, gain = split_length(linkage, contraction)
    ratio_slope = -1.0 / length
    gain_slope = short / (offset * rest * segments)
    lag_sin, lag_cos, lag_slope = 0.0, 1.0, 0.0
    sin, cos, angle_slope = 0.0, 1.0, 0.0
    lateral, slope = 0.0, 0.0
    for i in range(segments):
        x = offset * lag_cos
        y = short - offset * lag_sin
        swing = lag_slope / lag_cos
        x_slope = -offset * lag_sin * swing
        y_slope = -1.0 / segments - offset * lag_slope
        lag_slope = ratio_slope * lag_sin + ratio * lag_slope + gain_slope
        lag_sin = ratio * lag_sin + gain
        if not lag_sin < 1.0:
            return lateral, slope, i + 1
        lag_cos = math.sqrt((1.0 - lag_sin) * (1.0 + lag_sin))
        x_next = offset * lag_cos
        y_next = rest - offset * lag_sin
        inverse = 1.0 / (x * x + y * y)
        turn_sin = (x * y_next - y * x_next) * inverse
        turn_cos = (x * x_next + y * y_next) * inverse
        swing = lag_slope / lag_cos
        # An angle atan2(x, y) changes by (x' y - x y') / D**2; so does the one of the next piece.
        change = x_slope * y - x * y_slope
        change -= offset * (offset * lag_slope * lag_cos - lag_sin * swing * y_next)
        angle_slope += change * inverse
        sin, cos = turn_heading(sin, cos, turn_sin, turn_cos)
        lateral += rest * sin
        slope += rest * cos * angle_slope
    return lateral, slope, 0


@kernel
def fill_backbone(linkage, contraction, across, along):
    """Fill the backbone's joints (n + 1,), lateral and axial; the segment that fails, or 0.

    Returns sine and cosine of the last piece's angle from the axis after it.
    """
    offset, length, segments = linkage
    rest, short, ratio, gain = split_length(linkage, contraction)
    lag_sin, lag_cos = 0.0, 1.0
    sin, cos = 0.0, 1.0
    across[0] = 0.0
    along[0] = 0.0
    for i in range(segments):
        x = offset * lag_cos
        y = short - offset * lag_sin
        lag_sin = ratio * lag_sin + gain
        if not lag_sin < 1.0:
            return i + 1, sin, cos
        lag_cos = math.sqrt((1.0 - lag_sin) * (1.0 + lag_sin))
        x_next = offset * lag_cos
        y_next = rest - offset * lag_sin
        inverse = 1.0 / (x * x + y * y)
        turn_sin = (x * y_next - y * x_next) * inverse
        turn_cos = (x * x_next + y * y_next) * inverse
        sin, cos = turn_heading(sin, cos, turn_sin, turn_cos)
        across[i + 1] = across[i] + rest * sin
        along[i + 1] = along[i] + rest * cos
    return 0, sin, cos


@kernel
def fill_linkage(linkage, contraction, backbone, muscle, angles, links):
    """Fill joints (n + 1, 2), angles of backbone and links (n + 1,); the failing segment or 0."""
    offset, length, segments = linkage
    failed, _, _ = fill_backbone(linkage, contraction, backbone[:, 0], backbone[:, 1])
    if failed > 0:
        return failed
    angle = 0.0
    sin, cos = 0.0, 1.0
    rest = length / segments
    for k in range(segments + 1):
        if k > 0:
            next_sin = (backbone[k, 0] - backbone[k - 1, 0]) / rest
            next_cos = (backbone[k, 1] - backbone[k - 1, 1]) / rest
            angle += math.atan2(next_sin * cos - next_cos * sin, next_cos * cos + next_sin * sin)
            sin, cos = next_sin, next_cos
        link = angle + math.asin(min(1.0, measure_lag(linkage, contraction, k)))
        angles[k] = angle
        links[k] = link
        muscle[k, 0] = backbone[k, 0] + offset * math.cos(link)
        muscle[k, 1] = backbone[k, 1] - offset * math.sin(link)
    return 0


@kernel
def fill_linkages(linkage, contractions, backbones, muscles, angles, links):
    """Fill a batch by `fill_linkage`; index and segment of the first that fails, or -1 and 0."""
    for i in range(contractions.size):
        failed = fill_linkage(
            linkage, contractions[i], backbones[i], muscles[i], angles[i], links[i]
        )
        if failed > 0:
            return i, failed
    return -1, 0


@kernel
def fill_laterals(linkage, contractions, laterals, slopes):
    """Fill a batch by `measure_lateral`; index and segment of the first that fails, or -1 and 0."""
    for i in range(contractions.size):
        laterals[i], slopes[i], failed = measure_lateral(linkage, contractions[i])
        if failed > 0:
            return i, failed
    return -1, 0


@kernel
def find_allowance(segments):
    """By how much the largest sine of a lag must stay below 1.

    Round-off grows with the segments. Nearer to 1 a contraction may close and one that is smaller
    by its last bit not.
    """
    return 4e-16 * (segments + 8)


@kernel
def find_end(linkage):
    """The contraction from which on a segment cannot close, just before it; else the length.

    Every contraction from 0 up to it closes. The last lag's sine is the largest, and has one
    maximum in the contraction: it grows, then falls.
    """
    _, length, segments = linkage
    most = 1.0 - find_allowance(segments)
    low, high = 0.0, 1.0
    for _ in range(MAX_ITERATIONS):
        share = 0.5 * (low + high)
        if not low < share < high:
            break
        left = 1.0 - share
        power = left ** (segments - 1)
        if 1.0 - (segments + 1) * power * left - segments * power < 0.0:
            low = share
        else:
            high = share
    if measure_lag(linkage, low * length, segments) <= most:
        return length
    high = low
    low = 0.0
    for _ in range(MAX_ITERATIONS):
        share = 0.5 * (low + high)
        if not low < share < high:
            break
        if measure_lag(linkage, share * length, segments) > most:
            high = share
        else:
            low = share
    return low * length


@kernel
def find_top(linkage, end):
    """End of the rising branch before ``end``: contraction, lateral; whether it is a maximum."""
    offset, length, _ = linkage
    step = min(length / 128.0, offset / 8.0)
    low = 0.0
    high = -1.0
    while low < end:
        following = min(low + step, end, length * (1.0 - 1e-12))
        _, slope, failed = measure_lateral(linkage, following)
        for _ in range(MAX_ITERATIONS):
            if failed == 0:
                break
            end = following = 0.5 * (low + following)
            _, slope, failed = measure_lateral(linkage, following)
        if slope <= 0.0:
            high = following
            break
        if following <= low or following >= end:
            # A muscle of no length, or the last contraction at which the linkage closes.
            lateral, _, _ = measure_lateral(linkage, following)
            return following, lateral, False
        low = following
    for _ in range(MAX_ITERATIONS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        _, slope, _ = measure_lateral(linkage, middle)
        if slope > 0.0:
            low = middle
        else:
            high = middle
    lateral, _, _ = measure_lateral(linkage, low)
    return low, lateral, True


@kernel
def find_contraction(linkage, lateral, top, start):
    """The contraction in [0, top] on the rising branch that gives a lateral, and the iterations."""
    if lateral <= 0.0:
        return 0.0, 0
    low, high = 0.0, top
    guess = start if 0.0 < start <= top else 0.5 * top
    scale = 2.3e-16 * linkage[1]
    for iteration in range(1, MAX_ITERATIONS):
        value, slope, failed = measure_lateral(linkage, guess)
        miss = value - lateral if failed == 0 else math.inf
        if abs(miss) <= scale:
            return guess, iteration
        if miss > 0.0:
            high = guess
        else:
            low = guess
        following = guess - miss / slope if slope > 0.0 else -1.0
        if abs(following - guess) <= 1e-15 * guess:
            return guess, iteration
        if not low < following < high:
            following = 0.5 * (low + high)
            if not low < following < high:
                return high if miss < 0.0 and guess == low else guess, iteration
        guess = following
    return guess, MAX_ITERATIONS


@kernel
def find_contractions(linkage, laterals, top, contractions):
    """Fill a batch by `find_contraction`."""
    for i in range(laterals.size):
        contractions[i], _ = find_contraction(linkage, laterals[i], top, -1.0)
