"""One tendon robot in Bozzini and in two peers: tip and time. Run by hand; prints a table.

    pip install bozzini pyelastica soromox
    python -m benchmarks.compare_peers

The peers are no part of Bozzini's dependencies: one that is missing gets a line that says so.
Neither takes tendon displacements, so both get the tension that Bozzini finds for a displacement.
The robot: 100 mm, EI 1000 N mm^2, GJ 770 N mm^2, one tendon at 4 mm, parallel or a full helix.
"""

from __future__ import annotations

import importlib.metadata
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bozzini.continuum import ContinuumRobot, EnergyModel, Helix, RodModel, Section, Tendon

LENGTH, BENDING, TORSION, OFFSET = 100.0, 1000.0, 770.0, 4.0
SEGMENTS = 40
CASES = {"parallel": (0.0, 4.0), "full helix": (1.0, 8.0)}
"""Turns of the tendon, and its displacement [mm]."""


@dataclass
class Row:
    """What one tool made of one case."""

    tool: str
    case: str
    tip: np.ndarray
    pulled: float
    seconds: float
    note: str = ""


def make_robot(turns: float) -> ContinuumRobot:
    tendon = (
        Tendon(name="t", offset=OFFSET, angle=Helix(turns=turns), end=LENGTH)
        if turns
        else Tendon(name="t", offset=OFFSET)
    )
    return ContinuumRobot(
        (
            Section(
                length=LENGTH,
                radius=6.0,
                discs=SEGMENTS,
                tendons=(tendon,),
                bending_stiffness=BENDING,
                torsional_stiffness=TORSION,
            ),
        )
    )


def measure(call: Callable[[], Any], times: int = 5) -> tuple[Any, float]:
    """Answer and best time [s], compiled."""
    answer, best = call(), math.inf
    for _ in range(times):
        begin = time.perf_counter()
        answer = call()
        best = min(best, time.perf_counter() - begin)
    return answer, best


def run_bozzini(case: str) -> tuple[list[Row], float]:
    """Rows of the models, the rod first, and the tension it found [N]."""
    turns, pulled = CASES[case]
    robot = make_robot(turns)
    rows = []
    models = [
        ("Bozzini rod", RodModel(robot)),
        *(
            (f"Bozzini energy ({kind})", EnergyModel(robot, segment=kind))
            for kind in ("chord", "arc", "channel")
        ),
    ]
    tension = 0.0
    for name, model in models:
        shape, seconds = measure(lambda model=model: model.shape([pulled]))
        shape.require()
        tension = tension or float(shape.tensions[0])
        note = f"tension {float(shape.tensions[0]):.4g} N found"
        rows.append(Row(name, case, shape.tip, pulled, seconds, note))
    return rows, tension


def run_soromox(case: str, tension: float) -> Row:
    """Piecewise constant strain, its own forces; the equilibrium by Newton's method around it."""
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

    turns, pulled = CASES[case]
    rate = 2.0 * math.pi * turns / LENGTH
    span = LENGTH / SEGMENTS
    link = LinkSpec.circular(
        length=span,
        radius=1.0,
        density=1.0,
        reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        stiffness=span * jnp.diag(jnp.array([TORSION, BENDING, BENDING, 1.0, 1.0, 1.0])),
    )

    # Its tangent is the local x axis: our x and y are its y and z.
    def offset(_: Any, s: Any) -> Any:
        return OFFSET * jnp.array([0.0, jnp.cos(rate * s), jnp.sin(rate * s)])

    def slope(_: Any, s: Any) -> Any:
        return OFFSET * rate * jnp.array([0.0, -jnp.sin(rate * s), jnp.cos(rate * s)])

    routing = ThreadlikeRouting(
        params=LinearThreadlikeRoutingParams(
            intercept=jnp.array([[0.0, OFFSET, 0.0]]),
            slope=jnp.zeros((1, 3)),
            start_segment_index=(0,),
            end_segment_index=(SEGMENTS - 1,),
        ),
        offset_fn=offset,
        derivative_fn=slope,
    )
    robot = PCS.from_links(
        [link] * SEGMENTS,
        structure=PCSStructure(
            num_gauss_points=3,
            strain_selector=jnp.array([True, True, True, False, False, False] * SEGMENTS),
        ),
        gravity=jnp.zeros(3),
        actuators=ThreadlikeActuator.tendons(routing),
    )
    pull = jnp.array([tension])

    def residual(q: Any) -> Any:
        return robot.elastic_force(q) - robot.actuation_force(q, pull, backend="jax")

    @jax.jit
    def step(q: Any) -> tuple[Any, Any]:
        move = jnp.linalg.solve(jax.jacfwd(residual)(q), residual(q))
        return q - move, jnp.abs(move).max()

    def solve() -> Any:
        q, size = jnp.zeros(3 * SEGMENTS), math.inf
        for _ in range(50):
            q, size = step(q)
            if size < 1e-12:
                break
        return q

    begin = time.perf_counter()
    solve()
    first = time.perf_counter() - begin
    q, seconds = measure(solve)
    end = np.linalg.inv(robot.g0) @ np.asarray(robot.forward_kinematics(q, jnp.array(LENGTH)))
    place = end[:3, 3]
    lengths = robot.actuators[0].transmission.path_lengths
    shorter = float((lengths(robot, jnp.zeros_like(q)) - lengths(robot, q))[0])
    note = f"no statics of its own: Newton around its forces; first call {first:.0f} s"
    return Row("SoRoMoX", case, place[[1, 2, 0]], shorter, seconds, note)


def run_elastica(case: str, tension: float) -> Row:
    """Dynamics with damping until it rests; the tendon is written for it here."""
    import elastica as ea
    from numba import njit

    turns, _ = CASES[case]
    meter = 1e-3
    radius = 1.0 * meter
    density = 5e3
    area, inertia = math.pi * radius**2, math.pi * radius**4 / 4.0
    young, shear = BENDING * 1e-6 / inertia, TORSION * 1e-6 / (2.0 * inertia)
    rod = ea.CosseratRod.straight_rod(
        SEGMENTS,
        np.zeros(3),
        np.array([0.0, 0.0, 1.0]),
        np.array([1.0, 0.0, 0.0]),
        LENGTH * meter,
        radius,
        density,
        youngs_modulus=young,
        shear_modulus=shear,
    )
    middles = (np.arange(SEGMENTS) + 0.5) / SEGMENTS
    angles = 2.0 * math.pi * turns * np.concatenate([[0.0], middles, [1.0]])
    holes = OFFSET * meter * np.stack([np.cos(angles), np.sin(angles), np.zeros(SEGMENTS + 2)])

    @njit
    def pull(position, director, holes, tension, forces, torques):
        count = director.shape[2]
        points = np.zeros((3, count + 2))
        points[:, 0] = position[:, 0] + holes[:, 0]
        for j in range(count + 1):
            element = min(j, count - 1)
            for i in range(3):
                middle = 0.5 * (position[i, element] + position[i, element + 1])
                points[i, j + 1] = middle if j < count else position[i, count]
                for k in range(3):
                    points[i, j + 1] += director[k, i, element] * holes[k, j + 1]
        length = 0.0
        force, arm = np.zeros(3), np.zeros(3)
        for j in range(count + 1):
            before = points[:, j + 1] - points[:, j]
            size = np.sqrt(np.sum(before**2))
            length += size
            force[:] = -tension * before / size
            if j < count:
                after = points[:, j + 2] - points[:, j + 1]
                force += tension * after / np.sqrt(np.sum(after**2))
            element = min(j, count - 1)
            if j < count:
                forces[:, j] += 0.5 * force
                forces[:, j + 1] += 0.5 * force
            else:
                forces[:, count] += force
            arm[:] = 0.0
            for k in range(3):
                for i in range(3):
                    arm[k] += director[k, i, element] * force[i]
            hole = holes[:, j + 1]
            torques[0, element] += hole[1] * arm[2] - hole[2] * arm[1]
            torques[1, element] += hole[2] * arm[0] - hole[0] * arm[2]
            torques[2, element] += hole[0] * arm[1] - hole[1] * arm[0]
        return length

    class TendonForce(ea.NoForces):
        def __init__(self) -> None:
            self.length = 0.0

        def apply_forces(self, system: Any, time: Any = 0.0) -> None:
            self.length = pull(
                system.position_collection,
                system.director_collection,
                holes,
                tension,
                system.external_forces,
                system.external_torques,
            )

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    lowest = 3.516 / (LENGTH * meter) ** 2 * math.sqrt(BENDING * 1e-6 / (density * area))
    step = 0.25 * LENGTH * meter / SEGMENTS * math.sqrt(density / young)
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(TendonForce)
    simulator.dampen(rod).using(
        ea.AnalyticalLinearDamper,
        uniform_damping_constant=1.5 * lowest,
        time_step=step,
    )
    simulator.finalize()
    stepper = ea.PositionVerlet()
    chunk = math.ceil(0.5 / (lowest * step))
    now, steps, before, begin = 0.0, 0, rod.position_collection[:, -1].copy(), 0.0
    for _ in range(200):
        for _ in range(chunk):
            now = stepper.step(simulator, now, step)
        steps += chunk
        if not begin:
            begin, counted = time.perf_counter(), steps  # the first chunk compiled
        moved = np.abs(rod.position_collection[:, -1] - before).max()
        before = rod.position_collection[:, -1].copy()
        if moved < 1e-8:
            break
    seconds = (time.perf_counter() - begin) * steps / (steps - counted)
    forces, torques = np.zeros((3, SEGMENTS + 1)), np.zeros((3, SEGMENTS))
    length = pull(rod.position_collection, rod.director_collection, holes, tension, forces, torques)
    straight = (
        np.stack(
            [
                np.zeros(SEGMENTS + 2),
                np.zeros(SEGMENTS + 2),
                np.concatenate([[0], middles, [1]]) * LENGTH * meter,
            ]
        )
        + holes
    )
    rest = np.sqrt(np.sum(np.diff(straight, axis=1) ** 2, axis=0)).sum()
    note = f"relaxation, {steps} steps; the tendon is its user's; end half-elements stiff"
    tip = rod.position_collection[:, -1] / meter
    return Row("PyElastica", case, tip, (rest - length) / meter, seconds, note)


def main() -> int:
    rows: list[Row] = []
    lines: list[str] = []
    versions = []
    for package in ("bozzini", "pyelastica", "soromox"):
        try:
            versions.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{package} (not installed)")
    for case in CASES:
        ours, tension = run_bozzini(case)
        rows += ours
        for name, run in (("SoRoMoX", run_soromox), ("PyElastica", run_elastica)):
            try:
                rows.append(run(case, tension))
            except ImportError as error:
                lines.append(f"{name}, {case}: not run, {error}")
    out = sys.stdout.write
    out(", ".join(versions) + "\n\n")
    out("| tool | tendon | tip off the rod mm | displacement mm | time | remark |\n")
    out("|---|---|---|---|---|---|\n")
    reference = {row.case: row.tip for row in rows if row.tool == "Bozzini rod"}
    for row in rows:
        off = np.linalg.norm(row.tip - reference[row.case])
        took = f"{row.seconds:.1f} s" if row.seconds >= 1.0 else f"{1e3 * row.seconds:.3g} ms"
        out(f"| {row.tool} | {row.case} | {off:.3f} | {row.pulled:.4f} | {took} | {row.note} |\n")
    for line in lines:
        out(line + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
