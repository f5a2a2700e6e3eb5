"""A wire in time in Bozzini and in two peers: time for a motion of one accuracy.

    pip install bozzini pyelastica soromox
    python -m benchmarks.compare_motion

The wire is that of `compare_peers`: 100 mm of Nitinol. Cases, each over some periods: a tendon
4 mm beside it is pulled at once by 1 N, with Kelvin-Voigt damping, beside SoRoMoX (piecewise
constant strain, implicit steps of diffrax); and it swings from a velocity, without
damping, beside PyElastica. Every tool gets its fastest setting whose tip is within 0.5 % of the
length, root mean square over time, of that of Bozzini's finest motion; the peers' finest settings
say whether they agree with that. Times are the processor's, the best of some runs after it has
compiled, all on one core. The exit code is 1 where a bound is not kept.
"""

from __future__ import annotations

import dataclasses
import math
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from bozzini.continuum import (
    ContinuumRobot,
    DynamicsOptions,
    Section,
    Tendon,
    Wire,
    linearise,
    simulate,
)

from .compare_peers import BENDING, DENSITY, LENGTH, OFFSET, TORSION, YOUNG

SECOND = BENDING * 1e-6 / YOUNG
RADIUS = (4.0 * SECOND / math.pi) ** 0.25
"""Second moment of area [m^4], and radius [m]."""
TENSION, DAMPING_S, SWING_M_S = 1.0, 5e-4, 4.0
"""Of the tendon [N]; of the damped wire; velocity of the free wire's tip at the start."""
TIMES = np.linspace(0.0, 0.2, 201)
SWINGING = TIMES[:61]
ALLOWED = 5e-3 * LENGTH
"""Root mean square distance of the tip [mm]."""
BOUNDS = {"SoRoMoX": 3.0, "PyElastica": 100.0}
"""How many times as long a peer has to take."""


class Motion(NamedTuple):
    """What a tool made with a setting: tip (k, 3) [mm], and time [s]."""

    setting: str
    tip: np.ndarray
    seconds: float


def measure(call: Callable[[], np.ndarray], times: int = 3) -> tuple[np.ndarray, float]:
    """Answer and best time [s], compiled."""
    answer, best = call(), math.inf
    for _ in range(times):
        begin = time.process_time()
        answer = call()
        best = min(best, time.process_time() - begin)
    return answer, best


def make_wire(pieces: int) -> ContinuumRobot:
    wire = Wire(
        diameter=2e3 * RADIUS,
        modulus=1e-6 * YOUNG,
        poisson_ratio=BENDING / TORSION - 1.0,
        density=DENSITY,
    )
    tendon = Tendon(name="t", offset=OFFSET, angle=0.0)
    return ContinuumRobot(
        (Section(length=LENGTH, radius=6.0, discs=pieces, tendons=(tendon,), wire=wire),)
    )


def pull_bozzini(pieces: int, step: float) -> Motion:
    robot = make_wire(pieces)
    options = DynamicsOptions(
        segment="channel", damping_time=DAMPING_S, gravity=(0.0, 0.0, 0.0), max_step=step
    )
    times = np.insert(TIMES, 1, 1e-6)  # at once
    pulls = np.where(times > 0.0, TENSION, 0.0)[:, None]

    def run() -> np.ndarray:
        return np.delete(simulate(robot, times, tensions=pulls, options=options).tip, 1, axis=0)

    return Motion(f"{pieces} elements, {1e3 * step:g} ms", *measure(run))


def pull_soromox(pieces: int, size: float) -> Motion:
    """Its own forward dynamics, in a rollout of diffrax that is compiled whole.

    Its default, the explicit Tsit5, took longer than the implicit Kvaerno5 with 4 and 5 segments.
    """
    import diffrax
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from soromox.actuation.threadlike import (
        LinearThreadlikeRoutingParams,
        ThreadlikeActuator,
        ThreadlikeRouting,
    )
    from soromox.systems.components.links import LinkSpec
    from soromox.systems.pcs.pcs import PCS
    from soromox.systems.pcs.structures import PCSStructure
    from soromox.systems.system_state import SystemState

    span, milli = 1e-3 * LENGTH / pieces, 1e-3
    form = span * jnp.diag(jnp.array([1e-6 * TORSION, 1e-6 * BENDING, 1e-6 * BENDING, 1, 1, 1]))
    link = LinkSpec.circular(
        length=span,
        radius=RADIUS,
        density=DENSITY,
        reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        stiffness=form,
        damping=DAMPING_S * form,
    )
    routing = ThreadlikeRouting(
        params=LinearThreadlikeRoutingParams(
            intercept=jnp.array([[0.0, milli * OFFSET, 0.0]]),
            slope=jnp.zeros((1, 3)),
            start_segment_index=(0,),
            end_segment_index=(pieces - 1,),
        )
    )
    robot = PCS.from_links(
        [link] * pieces,
        structure=PCSStructure(
            num_gauss_points=3,
            strain_selector=jnp.array([True, True, True, False, False, False] * pieces),
        ),
        gravity=jnp.zeros(3),
        actuators=ThreadlikeActuator.tendons(routing),
    )
    start = SystemState(t=jnp.array(0.0), y=jnp.zeros(6 * pieces), u=jnp.array([TENSION]))
    control = diffrax.PIDController(rtol=size, atol=size)

    @jax.jit
    def run() -> Any:
        found = robot.rollout_to(
            start,
            t1=float(TIMES[-1]),
            solver_dt=1e-5,
            save_ts=jnp.asarray(TIMES),
            solver=diffrax.Kvaerno5(),
            stepsize_controller=control,
            max_steps=1_000_000,
        )
        ahead = jnp.array(milli * LENGTH)
        return jax.vmap(lambda y: robot.forward_kinematics(y[: 3 * pieces], ahead)[:3, 3])(found.y)

    places, seconds = measure(lambda: np.asarray(run().block_until_ready()))
    base = np.asarray(robot.g0)
    tip = 1e3 * (places - base[:3, 3]) @ base[:3, :3]
    return Motion(f"{pieces} segments, Kvaerno5 to {size:g}", tip[:, [1, 2, 0]], seconds)


def swing_bozzini(pieces: int, step: float) -> Motion:
    robot = make_wire(pieces)
    options = DynamicsOptions(
        segment="arc", gravity=(0.0, 0.0, 0.0), max_step=step, spectral_radius=1.0
    )
    rest = simulate(robot, [0.0, 1e-9], options=options)
    rod = rest.rod
    mass = linearise(robot, options=options).mass
    arc = rod.grid.arc_length
    # Stations move across by the square of their place, and turn by its slope.
    rates = np.zeros((len(arc) - 1, 3))
    rates[:, 1] = np.diff(2e3 * SWING_M_S * arc / LENGTH**2)
    momenta = (mass @ rates.ravel()).reshape(rates.shape)
    state = rest.state._replace(
        rotation_vectors=0.0 * rates, momenta=momenta, rates=rates, momentum_rates=0.0 * rates
    )
    begin = dataclasses.replace(rest, state=state)

    def run() -> np.ndarray:
        return simulate(robot, SWINGING, initial=begin, options=options).tip

    return Motion(f"{pieces} elements, {1e3 * step:g} ms", *measure(run))


def swing_elastica(pieces: int, part: float) -> Motion:
    """Its own rod, without damping.

    Its first element does not bend: half of it is behind the base, so that the error is of second
    order in the length of elements.
    """
    import elastica as ea

    span = 1e-3 * LENGTH / (pieces - 0.5)
    shear = TORSION * 1e-6 / (2.0 * SECOND)
    step = part * min(span * math.sqrt(DENSITY / YOUNG), RADIUS * math.sqrt(DENSITY / shear))
    count = math.ceil(TIMES[1] / step)
    step = TIMES[1] / count

    class Simulator(ea.BaseSystemCollection, ea.Constraints):
        pass

    def run(rows: int = len(SWINGING)) -> np.ndarray:
        rod = ea.CosseratRod.straight_rod(
            pieces,
            np.array([0.0, 0.0, -0.5 * span]),
            np.array([0.0, 0.0, 1.0]),
            np.array([1.0, 0.0, 0.0]),
            span * pieces,
            RADIUS,
            DENSITY,
            youngs_modulus=YOUNG,
            shear_modulus=shear,
        )
        height = np.maximum(rod.position_collection[2], 0.0)
        rod.velocity_collection[0] = SWING_M_S * (height / (1e-3 * LENGTH)) ** 2
        middle = 0.5 * (height[1:] + height[:-1])
        turn = 2.0 * SWING_M_S * middle / (1e-3 * LENGTH) ** 2
        rod.omega_collection[:] = turn * rod.director_collection[:, 1]  # about y, in its own axes
        simulator = Simulator()
        simulator.append(rod)
        simulator.constrain(rod).using(
            ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        simulator.finalize()
        stepper, now = ea.PositionVerlet(), 0.0
        tips = [rod.position_collection[:, -1].copy()]
        for _ in range(1, rows):
            for _ in range(count):
                now = stepper.step(simulator, now, step)
            tips.append(rod.position_collection[:, -1].copy())
        return 1e3 * np.array(tips)

    run(2)  # compiled
    begin = time.process_time()
    tip = run()
    return Motion(
        f"{pieces} elements, steps {part:g} of the wave's", tip, time.process_time() - begin
    )


def miss(tip: np.ndarray, reference: np.ndarray) -> float:
    """Root mean square distance over time [mm]."""
    return float(np.sqrt(np.mean(np.sum((tip - reference) ** 2, axis=1))))


CASES: dict[str, tuple[Callable[[], Motion], dict[str, list[partial[Motion]]]]] = {
    "tendon pulled at once, damped": (
        partial(pull_bozzini, 96, 5e-5),
        {
            "Bozzini": [partial(pull_bozzini, n, h) for n in (6, 8, 12) for h in (1e-3, 5e-4)],
            "SoRoMoX": [partial(pull_soromox, n, 1e-3) for n in (5, 6)],
        },
    ),
    "swings without damping": (
        partial(swing_bozzini, 96, 2.5e-5),
        {
            "Bozzini": [partial(swing_bozzini, n, h) for n in (6, 8, 12) for h in (1e-3, 5e-4)],
            "PyElastica": [partial(swing_elastica, n, 0.8) for n in (6, 8, 12)],
        },
    ),
}


def measure_motions(tell: Callable[[str], Any] = print) -> dict[str, float]:
    """Return by peer how many times as long it takes as Bozzini; NaN where it misses."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    ratios = {}
    for case, (finest, tools) in CASES.items():
        reference = finest().tip
        fastest = {}
        for tool, settings in tools.items():
            for setting in settings:
                try:
                    found = setting()
                except ImportError as error:
                    tell(f"{case}: {tool}: no package '{error.name}'")
                    break
                off = miss(found.tip, reference)
                tell(f"{case}: {tool}, {found.setting}: {off:.3g} mm, {found.seconds:.3g} s")
                if off <= ALLOWED:
                    fastest[tool] = min(fastest.get(tool, math.inf), found.seconds)
        for tool in set(tools) - {"Bozzini"}:
            ratios[tool] = fastest.get(tool, math.nan) / fastest["Bozzini"]
    return ratios


def main() -> int:
    ratios = measure_motions()
    for tool, ratio in ratios.items():
        print(f"{tool} takes {ratio:.3g} times as long (required: {BOUNDS[tool]:g})")
    return int(any(not ratios[tool] >= least for tool, least in BOUNDS.items()))


if __name__ == "__main__":
    sys.exit(main())
