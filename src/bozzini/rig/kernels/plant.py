"""Numba kernel of the plant: valves, lines, muscles, reservoir and compressor through time.

Explicit steps for the flows through valves; lags and the exchange between a line and its muscle
are exact within a step, so that a short pipette does not make it stiff.
"""

from __future__ import annotations

import math

from ...numeric.compiling import kernel
from .orifice import find_flow

# Columns of the state of a channel.
LINE, MUSCLE, FILL_SPOOL, FILL_PLAY, BLEED_SPOOL, BLEED_PLAY, SENSOR = range(7)
CHANNEL_COLUMNS = 7
# Entries of the state of the supply.
RESERVOIR, COMPRESSOR, RESERVOIR_SENSOR, GAS_IN, GAS_OUT, SUPPLY_SPOOL = range(6)
SUPPLY_COLUMNS = 6
# Columns of the faults of a channel.
STUCK, LEAK, LINE_OPEN = range(3)


@kernel
def follow_play(position, target, half):
    """Position of what is driven through a play of plus and minus `half`."""
    return min(max(position, target - half), target + half)


@kernel
def open_valve(position, dead_zone, leak):
    """Share of the full area that is open."""
    return leak + min(max((position - dead_zone) / (1.0 - dead_zone), 0.0), 1.0)


@kernel
def look_up(table, place):
    """Value and slope per cell of a table of even spacing at a place in cells, held beyond it."""
    last = table.size - 1
    if place <= 0.0:
        return table[0], 0.0
    if place >= last:
        return table[last], 0.0
    cell = min(int(place), last - 1)
    slope = table[cell + 1] - table[cell]
    return table[cell] + (place - cell) * slope, slope


@kernel
def advance(channels, supply, duty, faults, volumes, design, count, dt):
    """Move the state on by `count` steps of `dt` [s]; pressures are absolute [MPa].

    `volumes` (3, n) are those of the muscles over gauge pressure, `design` is what
    `bozzini.rig.plant.PlantDesign.pack` gives.
    """
    (
        atmosphere,
        line_volume,
        pipette,
        exponent,
        fill_choked,
        bleed_choked,
        speed,
        critical,
        valve_lag,
        half_play,
        dead_zone,
        valve_leak,
        reservoir_volume,
        reservoir_leak,
        compressor_flow,
        compressor_limit,
        compressor_on,
        compressor_off,
        sensor_lag,
        cell,
    ) = design
    valve_share = 1.0 - math.exp(-dt / valve_lag) if valve_lag > 0.0 else 1.0
    sensor_share = 1.0 - math.exp(-dt / sensor_lag) if sensor_lag > 0.0 else 1.0
    muscles = channels.shape[0]
    for _ in range(count):
        reservoir = supply[RESERVOIR]
        gauge = reservoir - atmosphere
        if gauge <= compressor_on:
            supply[COMPRESSOR] = 1.0
        elif gauge >= compressor_off:
            supply[COMPRESSOR] = 0.0
        pumped = 0.0
        if supply[COMPRESSOR] > 0.0:
            pumped = compressor_flow * max(1.0 - gauge / compressor_limit, 0.0)
        supply[SUPPLY_SPOOL] += valve_share * (duty[2 * muscles] - supply[SUPPLY_SPOOL])
        drawn = find_flow(reservoir_leak, reservoir, atmosphere, critical)
        lost = drawn
        for k in range(muscles):
            state = channels[k]
            state[FILL_SPOOL] += valve_share * (duty[k] - state[FILL_SPOOL])
            state[BLEED_SPOOL] += valve_share * (duty[muscles + k] - state[BLEED_SPOOL])
            state[FILL_PLAY] = follow_play(state[FILL_PLAY], state[FILL_SPOOL], half_play)
            state[BLEED_PLAY] = follow_play(state[BLEED_PLAY], state[BLEED_SPOOL], half_play)
            opening = open_valve(state[FILL_PLAY], dead_zone, valve_leak)
            if faults[k, STUCK] >= 0.0:
                opening = faults[k, STUCK]
            # The supply valve is wide, with little volume behind it: it only scales the flow.
            opening *= supply[SUPPLY_SPOOL]
            bleeding = open_valve(state[BLEED_PLAY], dead_zone, valve_leak)
            line, inside = state[LINE], state[MUSCLE]
            fill = find_flow(opening * fill_choked, reservoir, line, critical)
            bleed = find_flow(bleeding * bleed_choked, line, atmosphere, critical)
            leak = find_flow(faults[k, LEAK] * speed, inside, atmosphere, critical)
            drawn += fill
            lost += bleed + leak
            volume, slope = look_up(volumes[k], (inside - atmosphere) / cell)
            capacity = volume + exponent * inside * slope / cell
            line += exponent * (fill - bleed) / line_volume * dt
            inside -= exponent * leak / capacity * dt
            # The exchange keeps the gas of both and lets their difference decay.
            conductance = pipette * (line + inside) * faults[k, LINE_OPEN]
            if conductance > 0.0:
                total = line_volume + capacity
                mean = (line * line_volume + inside * capacity) / total
                rate = exponent * conductance * (1.0 / line_volume + 1.0 / capacity)
                left = (line - inside) * math.exp(-rate * dt)
                line = mean + left * capacity / total
                inside = mean - left * line_volume / total
            state[LINE], state[MUSCLE] = line, inside
            state[SENSOR] += sensor_share * (line - atmosphere - state[SENSOR])
        supply[RESERVOIR] += (pumped - drawn) / reservoir_volume * dt
        supply[RESERVOIR_SENSOR] += sensor_share * (
            supply[RESERVOIR] - atmosphere - supply[RESERVOIR_SENSOR]
        )
        supply[GAS_IN] += pumped * dt
        supply[GAS_OUT] += lost * dt
