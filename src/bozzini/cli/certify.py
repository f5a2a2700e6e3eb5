"""``bozzini certify``: check what a plan file states, and prove its clearance again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..checks import floor_mm
from ._tract_options import report_findings
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    Answer,
    CheckedCommand,
    answer_options,
    run_exit,
)

if TYPE_CHECKING:
    from ..motion.verify import Verification

__all__ = ["command"]


@click.command(name="certify", cls=CheckedCommand)
@click.argument("plan", metavar="PLAN", type=INPUT)
@click.argument("source", metavar="[INPUT]", required=False, type=INPUT)
@click.option(
    "--independent",
    is_flag=True,
    help="Also measure exact distances to the wall, by a second checker.",
)
@answer_options()
def command(plan: Path, source: Path | None, independent: bool, answer: Answer) -> None:
    """Check a saved PLAN, and prove its clearance anew in INPUT.

    INPUT is the file that the plan was made from; it is read as the plan states. Without it the
    plan is checked against itself only, and the wall is not checked. Exit code 0:
    certified, or without INPUT consistent; 1: not certified, or a claim of the plan does not hold;
    2: bad file.
    """
    if independent and source is None:
        raise click.UsageError("--independent needs INPUT, the file that the plan was made from")
    from ..motion.plan import Plan
    from ..motion.verify import verify_file, verify_plan

    read = Plan.load(plan)
    with answer.show_progress() as progress:
        if source is None:
            result = verify_plan(read)
        else:
            result = verify_file(read, source, independent=independent, progress=progress)
    summary = {
        "plan": str(plan),
        "input": None if source is None else str(source),
        **result.describe(),
    }
    if source is not None:
        summary["certified"] = result.certified
    if result.reading is not None:
        report_findings(result.reading.findings)
    answer.give(summary, _describe(result, source))
    if not (result.consistent if source is None else result.certified):
        run_exit(EXIT_NEGATIVE)


def _describe(result: Verification, source: Path | None) -> str:
    """Return the checks, a line each, and the verdict."""
    lines = [
        f"{'ok' if item.ok else 'FAILED':<7}{item.name}: {item.message}" for item in result.checks
    ]
    plan, proof = result.plan, result.certificate
    if source is None and plan.input is not None:
        named = ("file", "labels", "part", "unit", "frame", "organ")
        known = {name: getattr(plan.input, name) for name in named}
        stated = [f"{name} {_show(value)}" for name, value in known.items() if value is not None]
        lines.append(f"{'':<7}the plan states its input as {', '.join(stated) or 'nothing'}")
    diameter = 0.0 if plan.scope is None else plan.scope.diameter
    body = f"{diameter:g} mm scope"
    way = f"{plan.inserted:.1f} mm of a path of {plan.path_arc_length[-1]:.1f} mm ({plan.status})"
    failed = sum(not item.ok for item in result.checks)
    if proof is None and source is not None:
        lines.append(f"Not certified. {source} is not the file that the plan was made from.")
    elif proof is None:
        verdict = "Consistent" if result.consistent else "Not consistent"
        lines.append(
            f"{verdict}. Nothing about the wall was checked: give the file that the plan was made "
            "from."
        )
    elif result.certified:
        lines.append(
            f"Certified. The {body} stays at least {floor_mm(proof.clearance, 3)} mm from the "
            f"{_describe_wall(result)} over {way}."
        )
    elif proof.certified:
        lines.append(
            f"Not certified. The motion is proved to stay clear of the {_describe_wall(result)}, "
            f"but {failed} of {len(result.checks)} checks failed."
        )
    else:
        lines.append(
            f"Not certified. It is not proved that the {body} stays clear of the "
            f"{_describe_wall(result)} over {way}."
        )
    return "\n".join(lines)


def _show(value: object) -> str:
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _describe_wall(result: Verification) -> str:
    total, used = result.plan.inflation, result.plan.displaced
    wall = "wall" if result.certificate is None else f"wall ({result.certificate.wall})"
    if total > used:
        wall += f", inflated by {total - used:g} mm,"
    if used > 0.0:
        wall += f" displaced by {used:g} mm"
    return wall
