"""Tasks by name, the study job of each, and jobs by whatever name a study file has."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING
from importlib.metadata import EntryPoint
from typing import ClassVar

from ..checks import Quantity, choose
from ..errors import InputError, PluginError
from ..registry import Registry
from ..task import Task, has_converged, list_numbers
from ..units import INTERNAL_UNITS
from .factors import Value
from .jobs import JOBS, FunctionJob, Job, RowJob, check_keywords, find_function


def _find_own() -> dict[str, type[Task]]:
    from ..continuum.predicting import RobotPredicting
    from ..continuum.sensing import SensorPlanning
    from ..continuum.tracking import ContinuumTracking
    from ..effector.runs import EffectorSimulation
    from ..effector.tracking import EffectorTracking
    from ..head.anchor import HeadReaching
    from ..head.check import HeadChecking, HeadShow, HeadViewing
    from ..head.operate import HeadComparing
    from ..hysteresis.tasks import LoopFitting, LoopPredicting
    from ..motion.chain_task import ChainTask
    from ..vision.planning import SetupPlanning
    from .estimating import ContinuumEstimating
    from .reaching import TreeListing, TreeReaching

    kinds: tuple[type[Task], ...] = (
        SetupPlanning, EffectorSimulation, EffectorTracking, ChainTask,
        ContinuumTracking, ContinuumEstimating, RobotPredicting, SensorPlanning,
        HeadShow, HeadChecking, HeadViewing, HeadReaching, HeadComparing, TreeListing,
        TreeReaching, LoopFitting, LoopPredicting,
    )  # fmt: skip
    return {kind.key: kind for kind in kinds}


class TaskRegistry(Registry[Task]):
    """Tasks by name; one of another package is refused if no command can be made of it."""

    def _load(self, point: EntryPoint) -> type[Task]:
        kind = super()._load(point)
        if wrong := _find_fault(kind, point.name):
            raise PluginError(f"the task '{point.name}' of {point.value} cannot be used: {wrong}")
        return kind


def _find_fault(kind: type[Task], name: str) -> str:
    """Return why a task cannot be had by a name; empty if it can."""
    try:
        kind.list_fields()
    except TypeError as error:
        return str(error)
    command = getattr(kind, "command", "")
    if command != name:
        return f"its command is '{command}', but its entry point '{name}'"
    return "a job of studies has that name" if name in JOBS else ""


TASKS = TaskRegistry("bozzini.tasks", lambda: Task, _find_own, noun="task")
"""Tasks by name: this package's, and those that other packages add as ``bozzini.tasks``."""


class TaskJob(RowJob):
    """The job of a task: a row is a task, its outputs are the numbers of the result."""

    kind: ClassVar[type[Task]]
    chunk = 100

    @classmethod
    def of(cls, kind: type[Task]) -> type[TaskJob]:
        """Return the job of a task."""
        needed = [name for name, known in kind.list_fields().items() if known.default is MISSING]
        more = {"kind": kind, "name": kind.key, "needed": tuple((name,) for name in needed)}
        return type(f"{kind.__name__}Job", (cls,), {**more, "__doc__": kind.__doc__})

    @property
    def made_by(self) -> type:
        """The task."""
        return self.kind

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return the inputs of the task that are numbers, words or files."""
        taken = {*INTERNAL_UNITS, "text", "file"}
        return {n: known for n, known in cls.kind.list_inputs().items() if known.kind in taken}

    @property
    def outputs(self) -> Mapping[str, str]:
        """The numbers of the result that no input is called like."""
        inputs = self.kind.list_fields()
        return {n: unit for n, unit in list_numbers(self.kind.result).items() if n not in inputs}

    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return the numbers of one result; that it has not converged is the reason of its row."""
        known = self.kind.list_inputs()
        given = {name: int(value) if known[name].whole else value for name, value in row.items()}
        found = self.kind.from_inputs(given).run()
        if not has_converged(found):
            raise InputError(str(found.reason))
        values = {name: getattr(found, name) for name in self.outputs}
        return {name: math.nan if value is None else value for name, value in values.items()}


def choose_job(name: str) -> type[Job]:
    """Return the class of a job: of `JOBS`, of a task, or `FunctionJob` for ``module:function``."""
    if ":" in name:
        return FunctionJob
    choose("job", name, dict.fromkeys([*JOBS, *TASKS, "module:function"]))
    return JOBS[name] if name in JOBS else TaskJob.of(TASKS[name])


def make_job(
    name: str, fixed: Mapping[str, Value], *, inputs: Iterable[str], outputs: tuple[str, ...]
) -> Job:
    """Return a job with its fixed inputs, in Bozzini's units; `inputs` names all."""
    if ":" in name:
        function = find_function(name)
        check_keywords(name, function, inputs)
        return FunctionJob(fixed, function, outputs)
    return choose_job(name)(fixed)
