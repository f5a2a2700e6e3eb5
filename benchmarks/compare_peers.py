"""One wire with one tendon in Bozzini and in two peers: time for a static shape of one accuracy.

    pip install bozzini pyelastica soromox
    python -m benchmarks.compare_peers

The robot is a Nitinol wire: 100 mm long, EI 1000 N mm^2, GJ 770 N mm^2, with a tendon 4 mm from
it. The cases are those that the peers take too: a force on the tip, or a tension of the tendon,
which is parallel to the wire or winds round it once. Every tool gets the coarsest model of its kind
whose tip is within 0.1 % of the length of that of a fine rod, or else the finest. Its time is the
processor's, the best of several runs after it has compiled, all on one core. The peers are no part
of Bozzini's dependencies: one that is missing gets a line that says so, and the exit code is 1
where a bound is not kept.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bozzini.continuum import ContinuumRobot, EnergyModel, Helix, RodModel, Section, Tendon

LENGTH, BENDING, TORSION, OFFSET = 100.0, 1000.0, 770.0, 4.0
YOUNG, DENSITY = 60e9, 6450.0
"""Of the wire [Pa], [kg/m^3]; its radius follows from EI."""

ALLOWED = 1e-3 * LENGTH
"""How far a tip may be from that of the fine rod [mm]."""

BOUNDS = {"SoRoMoX": 1.0, "PyElastica": 20.0}
"""How many times as long a peer has to take."""

FINE_STEPS = 2000
PIECES = (6, 12, 24, 48)
STEPS = (12, 24, 48)
ELEMENTS = (12, 24, 48)


@dataclass(frozen=True)
class Case:
    """Turns of the tendon, its tension [N], and the force on the tip along x [N]."""

    name: str
    turns: float = 0.0
    tension: float = 0.0
    force: float = 0.0


CASES = (
    Case("tip force 0.05 N", force=0.05),
    Case("tip force 0.2 N", force=0.2),
    Case("parallel tendon 3 N and tip force 0.1 N", tension=3.0, force=0.1),
    Case("tendon once round 6 N", turns=1.0, tension=6.0),
)


@dataclass(frozen=True)
class Row:
    """What one tool made of one case: tip [mm] and time [s] with `size` pieces."""

    tool: str
    case: Case
    size: int
    tip: np.ndarray
    seconds: float

    def miss(self, reference: np.ndarray) -> float:
        return float(np.linalg.norm(self.tip - reference))


def make_robot(case: Case, pieces: int) -> ContinuumRobot:
    angle = Helix(turns=case.turns) if case.turns else 0.0
    tendon = Tendon(name="t", offset=OFFSET, angle=angle, end=LENGTH)
    section = Section(
        length=LENGTH,
        radius=6.0,
        discs=pieces,
        tendons=(tendon,),
        bending_stiffness=BENDING,
        torsional_stiffness=TORSION,
    )
    return ContinuumRobot((section,))


def measure(call: Callable[[], Any], times: int = 200) -> tuple[Any, float]:
    """Answer and best time [s], compiled."""
    answer, best = call(), math.inf
    for _ in range(times):
        begin = time.process_time()
        answer = call()
        best = min(best, time.process_time() - begin)
    return answer, best


def run_bozzini(tool: str, case: Case, size: int) -> Row:
    """`energy` with segments in channels, or the rod with as many steps."""
    force = (case.force, 0.0, 0.0)
    if tool == "Bozzini rod":
        model: Any = RodModel(make_robot(case, 1), steps=size, tip_force=force)
    else:
        model = EnergyModel(make_robot(case, size), segment="channel", tip_force=force)
    shape, seconds = measure(lambda: model.shape_under_tensions([case.tension]))
    shape.require()
    return Row(tool, case, size, shape.tip, seconds)


def run_soromox(tool: str, case: Case, size: int) -> Row:
    """Piecewise constant strain, its own forces; Newton's method in one compiled call is ours."""
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

    rate = 2.0 * math.pi * case.turns / LENGTH
    span = LENGTH / size
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
            end_segment_index=(size - 1,),
        ),
        offset_fn=offset,
        derivative_fn=slope,
    )
    robot = PCS.from_links(
        [link] * size,
        structure=PCSStructure(
            num_gauss_points=3,
            strain_selector=jnp.array([True, True, True, False, False, False] * size),
        ),
        gravity=jnp.zeros(3),
        actuators=ThreadlikeActuator.tendons(routing),
    )
    pull, end = jnp.array([case.tension]), jnp.array(LENGTH)
    start = np.asarray(robot.g0)
    sideways = jnp.asarray(start[:3, :3] @ [0.0, case.force, 0.0])

    def work(q: Any) -> Any:
        return robot.forward_kinematics(q, end, backend="jax")[:3, 3] @ sideways

    def residual(q: Any) -> Any:
        out = robot.elastic_force(q)
        if case.tension:
            out -= robot.actuation_force(q, pull, backend="jax")
        if case.force:
            out -= jax.grad(work)(q)
        return out

    def step(state: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        q, _, count = state
        move = jnp.linalg.solve(jax.jacfwd(residual)(q), residual(q))
        return q - move, jnp.abs(move).max(), count + 1

    @jax.jit
    def solve() -> Any:
        first = (jnp.zeros(3 * size), jnp.inf, 0)
        return jax.lax.while_loop(lambda s: (s[1] > 1e-9) & (s[2] < 50), step, first)[0]

    q, seconds = measure(lambda: solve().block_until_ready())
    place = (np.linalg.inv(start) @ np.asarray(robot.forward_kinematics(q, end)))[:3, 3]
    return Row(tool, case, size, place[[1, 2, 0]], seconds)


def run_elastica(tool: str, case: Case, size: int) -> Row:
    """Dynamics with damping until the tip rests; the tendon is written for it here.

    Its end elements do not bend: half an element more at either end makes its error of second
    order in their length, so the base and the tip are middles of elements.
    """
    import elastica as ea
    from numba import njit

    meter = 1e-3
    second = BENDING * 1e-6 / YOUNG
    radius = (4.0 * second / math.pi) ** 0.25
    span = LENGTH * meter / (size - 1)
    shear = TORSION * 1e-6 / (2.0 * second)
    rod = ea.CosseratRod.straight_rod(
        size,
        np.array([0.0, 0.0, -0.5 * span]),
        np.array([0.0, 0.0, 1.0]),
        np.array([1.0, 0.0, 0.0]),
        span * size,
        radius,
        DENSITY,
        youngs_modulus=YOUNG,
        shear_modulus=shear,
    )
    angles = 2.0 * math.pi * case.turns * np.linspace(0.0, 1.0, size)
    holes = OFFSET * meter * np.stack([np.cos(angles), np.sin(angles), np.zeros(size)])

    @njit
    def load(position, director, holes, tension, across, forces, torques):
        """Tendon through a hole in the middle of each element, and a force on the last one."""
        count = director.shape[2]
        points = np.zeros((3, count))
        for j in range(count):
            for i in range(3):
                points[i, j] = 0.5 * (position[i, j] + position[i, j + 1])
                for k in range(3):
                    points[i, j] += director[k, i, j] * holes[k, j]
        force, arm = np.zeros(3), np.zeros(3)
        for j in range(count):
            force[:] = 0.0
            if j > 0:
                back = points[:, j - 1] - points[:, j]
                force += tension * back / np.sqrt(np.sum(back**2))
            if j < count - 1:
                ahead = points[:, j + 1] - points[:, j]
                force += tension * ahead / np.sqrt(np.sum(ahead**2))
            for k in range(3):
                arm[k] = 0.0
                for i in range(3):
                    arm[k] += director[k, i, j] * force[i]
            hole = holes[:, j]
            torques[0, j] += hole[1] * arm[2] - hole[2] * arm[1]
            torques[1, j] += hole[2] * arm[0] - hole[0] * arm[2]
            torques[2, j] += hole[0] * arm[1] - hole[1] * arm[0]
            if j == count - 1:
                force[0] += across
            forces[:, j] += 0.5 * force
            forces[:, j + 1] += 0.5 * force

    class Load(ea.NoForces):
        def apply_forces(self, system: Any, time: Any = 0.0) -> None:
            load(
                system.position_collection,
                system.director_collection,
                holes,
                case.tension,
                case.force,
                system.external_forces,
                system.external_torques,
            )

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    area = math.pi * radius**2
    lowest = 3.516 / (LENGTH * meter) ** 2 * math.sqrt(BENDING * 1e-6 / (DENSITY * area))
    # Waves along an element, and the turning of an element against shear: the largest that holds.
    step = min(0.5 * span * math.sqrt(DENSITY / YOUNG), 0.5 * radius * math.sqrt(DENSITY / shear))
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(Load)
    simulator.dampen(rod).using(
        ea.AnalyticalLinearDamper, uniform_damping_constant=1.5 * lowest, time_step=step
    )
    simulator.finalize()
    stepper = ea.PositionVerlet()
    chunk = math.ceil(0.5 / (lowest * step))

    def find_tip() -> np.ndarray:
        return rod.position_collection[:, -2:].mean(axis=1) / meter

    now, steps, begin, before = 0.0, 0, 0.0, find_tip()
    for _ in range(200):
        for _ in range(chunk):
            now = stepper.step(simulator, now, step)
        steps += chunk
        if not begin:
            begin, counted = time.process_time(), steps  # the first part compiled
        moved, before = np.abs(find_tip() - before).max(), find_tip()
        if moved < 0.05 * ALLOWED:
            break
    seconds = (time.process_time() - begin) * steps / (steps - counted)
    return Row(tool, case, size, find_tip(), seconds)


Run = Callable[[str, Case, int], Row]
TOOLS: dict[str, tuple[Run, tuple[int, ...], str]] = {
    "Bozzini rod": (run_bozzini, STEPS, "steps"),
    "Bozzini energy": (run_bozzini, PIECES, "segments in channels"),
    "SoRoMoX": (run_soromox, PIECES, "segments of constant strain"),
    "PyElastica": (run_elastica, ELEMENTS, "elements, relaxed until they rest"),
}


def find_reference(case: Case) -> np.ndarray:
    """Tip of a fine rod [mm]."""
    model = RodModel(make_robot(case, 1), steps=FINE_STEPS, tip_force=(case.force, 0.0, 0.0))
    return model.shape_under_tensions([case.tension]).require().tip


def run_tool(tool: str, case: Case, reference: np.ndarray) -> Row:
    """Row of the coarsest model that is near enough, else of the finest."""
    run, sizes, _ = TOOLS[tool]
    for size in sizes:
        row = run(tool, case, size)
        if row.miss(reference) <= ALLOWED:
            break
    return row


def measure_peers(tell: Callable[[str], Any] = lambda line: None) -> dict[str, Any]:
    """Measure all, on one core, and return day, versions, and a record of every tool and case.

    A record has `miss_mm` and `seconds`, or `missing`, the package that is not installed.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    versions = {}
    for package in ("soromox", "pyelastica", "jax", "numba"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "not installed"
    records: list[dict[str, Any]] = []
    for case in CASES:
        reference = find_reference(case)
        for tool in TOOLS:
            record: dict[str, Any] = {"case": case.name, "tool": tool}
            try:
                row = run_tool(tool, case, reference)
            except ImportError as error:
                record["missing"] = error.name or str(error)
            else:
                record["pieces"] = row.size
                record["miss_mm"] = round(row.miss(reference), 4)
                record["seconds"] = float(f"{row.seconds:.3g}")
            records.append(record)
            tell(json.dumps(record))
    return {"day": time.strftime("%Y-%m-%d"), "versions": versions, "records": records}


def list_ratios(measured: dict[str, Any], tool: str, over: str) -> dict[str, float]:
    """Return for each case that both ran how many times the time of one tool another takes."""
    seconds = {
        (record["case"], record["tool"]): record["seconds"]
        for record in measured["records"]
        if "seconds" in record
    }
    return {
        case: found / seconds[case, over]
        for (case, name), found in seconds.items()
        if name == tool and (case, over) in seconds
    }


def format_ratio(ratio: float) -> str:
    """Return a ratio with two digits."""
    return f"{float(f'{ratio:.2g}'):,.{0 if ratio >= 10.0 else 1 if ratio >= 1.0 else 2}f}"


def _span(ratios: dict[str, float]) -> str:
    low, high = min(ratios.values()), max(ratios.values())
    return f"{format_ratio(low)} to {format_ratio(high)} times"


def format_peers(measured: dict[str, Any]) -> list[str]:
    """Return the table of what was measured and what it comes to, as lines of a page."""
    over = {tool: list_ratios(measured, tool, "Bozzini rod") for tool in TOOLS}
    versions = ", ".join(f"{name} {number}" for name, number in measured["versions"].items())
    lines = [
        f"Of {measured['day']}, with {versions}.",
        "",
        "| case | tool | pieces | tip off | time | over `rod` |",
        "|---|---|---|---|---|---|",
    ]
    for record in measured["records"]:
        start = f"| {record['case']} | {record['tool']} |"
        if "missing" in record:
            lines.append(f"{start} – | – | not run: no package `{record['missing']}` | – |")
            continue
        far = "" if record["miss_mm"] <= ALLOWED else f", not within {ALLOWED:g}"
        second = record["seconds"]
        took = f"{second:.3g} s" if second >= 1.0 else f"{1e3 * second:.3g} ms"
        ratio = format_ratio(over[record["tool"]].get(record["case"], math.nan))
        lines.append(
            f"{start} {record['pieces']} | {record['miss_mm']:.3f} mm{far} | {took} | {ratio} |"
        )
    lines.append("")
    for tool in TOOLS:
        if tool != "Bozzini rod" and over[tool]:
            lines.append(f"- {tool} takes {_span(over[tool])} as long as `rod`.")
    beside = list_ratios(measured, "Bozzini energy", "SoRoMoX")
    if beside:
        lines.append(f"- `energy` takes {_span(beside)} as long as SoRoMoX.")
    return lines


def find_worst(measured: dict[str, Any]) -> str:
    """Return how far a tip of a peer is from that of the fine rod at most [mm]."""
    records = measured["peers"]["records"]
    found = [each["miss_mm"] for each in records if each["tool"] in BOUNDS and "miss_mm" in each]
    return f"{max(found):.2f}"


def is_kept(measured: dict[str, Any]) -> bool:
    """Return whether every peer that ran takes as many times as long as `rod` as it has to."""
    return all(
        ratio >= bound
        for tool, bound in BOUNDS.items()
        for ratio in list_ratios(measured, tool, "Bozzini rod").values()
    )


def main() -> int:
    def tell(line: str) -> None:
        sys.stderr.write(f"{line}\n")

    measured = measure_peers(tell)
    kept = is_kept(measured)
    bounds = ", ".join(f"{tool} {bound:g}" for tool, bound in BOUNDS.items())
    sys.stdout.write("\n".join(format_peers(measured)))
    sys.stdout.write(f"\n\nbounds (times `rod`): {bounds}: {'kept' if kept else 'broken'}\n")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
