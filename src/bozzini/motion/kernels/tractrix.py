"""Numba kernel of the free chain: one link after the other, by the closed form or one minimum."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True)
def pull_chain(chain, lengths, heads, slip, substep, out):
    """Pull a chain by its head along straight steps to `heads` (steps, dim); fill `out`.

    `substep` 0: each tail moves once per step, least (thesis eq. 5.13 and 6.6). Otherwise each
    step is cut into parts of at most `substep`, and each link moves by the closed form for a
    straight move of its head. `chain` (joints, dim) is updated to the last step. Returns (-1, -1),
    or the step and the link that was left without a direction.
    """
    joints, dim = chain.shape
    for t in range(heads.shape[0]):
        square = 0.0
        for k in range(dim):
            square += (heads[t, k] - chain[0, k]) ** 2
        parts = 1
        if substep > 0.0:
            parts = max(1, math.ceil(math.sqrt(square) / substep - 1e-9))
        for part in range(parts):
            share = 1.0 / (parts - part)
            for k in range(dim):
                out[t, 0, k] = (
                    heads[t, k]
                    if share == 1.0
                    else (chain[0, k] + share * (heads[t, k] - chain[0, k]))
                )
            for j in range(1, joints):
                if not _move_tail(chain, out, t, j, lengths[j - 1], slip, substep > 0.0):
                    return t, j
            for j in range(joints):
                for k in range(dim):
                    chain[j, k] = out[t, j, k]
    return -1, -1


@njit(cache=True)
def _move_tail(chain, out, t, j, length, slip, exact):
    """Place joint j after joint j - 1 has moved; False if the link has no direction left."""
    dim = chain.shape[1]
    step = 0.0
    along = 0.0
    for k in range(dim):
        move = out[t, j - 1, k] - chain[j - 1, k]
        step += move * move
        along += move * (chain[j, k] - chain[j - 1, k])
    step = math.sqrt(step)
    pull = 0.0
    carry = 1.0
    if exact and step > 0.0:
        # w unit from head to tail, e unit along the head's move, c = w.e, sigma the head's move
        # over the effective length, q = exp(-sigma):
        # w+ ~ (w - c e) + (c cosh sigma - sinh sigma) e ~ 2q w + (c (1 - q)^2 - (1 - q^2)) e
        cosine = min(max(along / (step * length), -1.0), 1.0)
        sigma = (1.0 - slip) * step / length
        q = math.exp(-sigma)
        carry = 2.0 * q
        pull = cosine * (1.0 - q) ** 2 - (1.0 - q * q)
        pull /= step
    elif not exact:
        pull = -(1.0 - slip) / length
    size = 0.0
    for k in range(dim):
        move = out[t, j - 1, k] - chain[j - 1, k]
        value = carry * (chain[j, k] - chain[j - 1, k]) / length + pull * move
        out[t, j, k] = value
        size += value * value
    size = math.sqrt(size)
    if size < 1e-9:
        return False
    for k in range(dim):
        out[t, j, k] = out[t, j - 1, k] + length * out[t, j, k] / size
    return True
