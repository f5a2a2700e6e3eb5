"""What a study computes: jobs by name, those of other packages, and functions of one's own."""

from __future__ import annotations

import importlib
import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, ClassVar, SupportsFloat, cast

import numpy as np
from numpy.typing import NDArray

from ..checks import Quantity, list_quantities, show_value
from ..effector import Effector, effector_preset
from ..effector.batch import REASONS, can_batch, measure_designs
from ..effector.design import DEFAULT_PRESET, EFFECTOR_PRESETS, PRESET_MODELS, EffectorDesign
from ..effector.study import try_design
from ..errors import BozziniError, InputError
from ..motion.planners import PlannerOptions
from ..motion.scope import Scope
from ..muscle import MODELS, Muscle, MuscleModel
from ..muscle import preset as muscle_preset
from ..muscle.design import PRESETS, PRESSURE_LIMIT
from ..numeric.arrays import Floats
from ..registry import Registry
from ..results import Shown
from .factors import FREE, Value
from .options import INFLATION_MAX, ORGANS, InsertionOptions

if TYPE_CHECKING:
    from .case import Case, CasePlan

Columns = Mapping[str, NDArray[np.generic]]
ERROR = -1
"""Code of a row whose computation raised an error; its text is the reason."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows(Shown):
    """What came of n rows.

    Attributes
    ----------
    outputs : dict of str to (n,) float
        By the names of `Job.outputs`; NaN where a row has none.
    code : (n,) int8
        0: feasible; 1 to 127: why not, see `Job.reasons`; `ERROR`: an error.
    text : dict of int to str
        More about single rows, by their index, in place of the code's reason.
    """

    outputs: dict[str, Floats]
    code: NDArray[np.int8]
    text: dict[int, str] = field(default_factory=dict)


class Job(ABC):
    """What is computed of the rows of a study; made once in every worker.

    Another package adds one by an entry point of the group ``bozzini.studies``; it is made with
    one argument, `fixed`.

    Parameters
    ----------
    fixed : mapping of str to number or str
        Inputs that do not vary, in Bozzini's units.

    Attributes
    ----------
    name : str
        By which it is chosen.
    reasons : mapping of int to str
        What its codes mean.
    chunk : int
        Rows of a part, so that it takes about a second.
    needed : tuple of tuple of str
        Inputs that a study must have: of each of these exactly one.
    """

    name: ClassVar[str]
    reasons: ClassVar[Mapping[int, str]] = {}
    chunk: ClassVar[int] = 100
    needed: ClassVar[tuple[tuple[str, ...], ...]] = ()

    def __init__(self, fixed: Mapping[str, Value]) -> None:
        self.fixed = dict(fixed)

    @property
    def made_by(self) -> type:
        """The class whose source says what comes of a row."""
        return type(self)

    @classmethod
    @abstractmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return the legal inputs, fixed or varied; `names` are those that the study has."""

    @property
    @abstractmethod
    def outputs(self) -> Mapping[str, str]:
        """The outputs and their units."""

    @abstractmethod
    def run(self, columns: Columns) -> Rows:
        """Return what comes of n rows of factors, each (n,)."""


class RowJob(Job):
    """A job that takes one row at a time; a `BozziniError` is the reason of its row."""

    reasons: ClassVar[Mapping[int, str]] = {1: "the inputs are not legal together"}

    @abstractmethod
    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return the outputs of a row, fixed inputs included."""

    def run(self, columns: Columns) -> Rows:
        """Return what comes of n rows."""
        count = len(next(iter(columns.values())))
        outputs = {name: np.full(count, math.nan) for name in self.outputs}
        code, text = np.zeros(count, dtype=np.int8), {}
        for i in range(count):
            row = {**self.fixed, **{name: values[i] for name, values in columns.items()}}
            try:
                found = self.measure(row)
            except BozziniError as error:
                code[i], text[i] = 1, str(error)
                continue
            for name in outputs:
                outputs[name][i] = found[name]
        return Rows(outputs=outputs, code=code, text=text)


def _list_words(help: str, words: Mapping[str, object] | tuple[str, ...] = ()) -> Quantity:
    return Quantity(kind="text", help=help, words=tuple(words))


class EffectorJob(Job):
    """Designs of an end-effector: amplitudes, inner radius, area, and the pressure needed."""

    name = "effector-design"
    reasons = REASONS
    chunk = 20_000

    def __init__(self, fixed: Mapping[str, Value]) -> None:
        super().__init__(fixed)
        given = dict(fixed)
        preset = str(given.pop("preset", DEFAULT_PRESET))
        self.deflection = float(given.pop("deflection", 0.0))
        design = effector_preset(preset)
        model, choices = PRESET_MODELS.get(preset, ("energy", {}))
        kind = MODELS[model]
        self.effector = Effector(design, partial(kind, **choices) if choices else kind)
        self.changes = given

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return fields of `EffectorDesign`, ``length``, ``muscle.`` and a field, and two more."""
        fields = dict(list_quantities(EffectorDesign))
        return {
            "preset": _list_words("Where the design begins.", EFFECTOR_PRESETS),
            "deflection": Quantity(kind="length", low=0.0, high=1e6, label="deflection"),
            "length": replace(fields["backbone_length"], label="length"),
            **fields,
            **{f"muscle.{name}": known for name, known in list_quantities(Muscle).items()},
        }

    @property
    def outputs(self) -> Mapping[str, str]:
        """The numbers of a `SweepRow`."""
        return {
            "least_amplitude": "mm",
            "largest_amplitude": "mm",
            "inner_radius": "mm",
            "area": "mm^2",
            "needed_pressure": "MPa",
        }

    def run(self, columns: Columns) -> Rows:
        """Return what comes of n designs."""
        count = len(next(iter(columns.values())))
        varied: dict[str, NDArray[np.generic]] = {
            **{name: np.full(count, value) for name, value in self.changes.items()},
            **columns,
        }
        if can_batch(self.effector, tuple(varied)):
            found = measure_designs(self.effector, varied, deflection=self.deflection)
            outputs = {name: np.asarray(getattr(found, name)) for name in self.outputs}
            return Rows(outputs=outputs, code=found.code)
        outputs = {name: np.full(count, math.nan) for name in self.outputs}
        code, text = np.zeros(count, dtype=np.int8), {}
        whole = {name for name, known in self.list_inputs(()).items() if known.whole}
        for i in range(count):
            changes: dict[str, object] = {
                name: int(float(values[i])) if name in whole else float(values[i])
                for name, values in varied.items()
            }
            row = try_design(self.effector, changes, self.deflection)
            if row.built:
                for name in outputs:
                    outputs[name][i] = getattr(row, name) or math.nan
            if not row.feasible:
                code[i], text[i] = (2 if row.built else 1), row.reason
        return Rows(outputs=outputs, code=code, text=text)


class MuscleJob(RowJob):
    """A muscle under pressure and load, its dimensions and materials varied: its tolerances."""

    name = "muscle-tolerance"
    chunk = 4_000

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return preset, model, pressure, load and the fields of `Muscle`."""
        return {
            "preset": _list_words("The muscle.", PRESETS),
            "model": _list_words("Its model.", tuple(MODELS)),
            "pressure": Quantity(kind="pressure", low=0.0, high=PRESSURE_LIMIT, label="pressure"),
            "load": Quantity(kind="force", low=0.0, high=1e6, label="load"),
            **list_quantities(Muscle),
        }

    @property
    def outputs(self) -> Mapping[str, str]:
        """What `MuscleModel.solve` gives."""
        return {
            "contraction": "mm",
            "loaded_length": "mm",
            "loaded_angle": "rad",
            "contact_pressure": "MPa",
        }

    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return the state of a muscle."""
        given = dict(row)
        muscle = muscle_preset(str(given.pop("preset", "fitted-45")))
        kind = MODELS[str(given.pop("model", "energy"))]
        pressure, load = (float(given.pop(name, 0.0)) for name in ("pressure", "load"))
        changed = {name: float(value) for name, value in given.items()}
        if "strands" in changed:
            changed["strands"] = int(changed["strands"])
        make: Callable[[Muscle], MuscleModel] = kind  # every model is made of its muscle
        state = make(muscle.replace(**changed)).solve(pressure, load)
        if not state.converged:
            raise InputError(str(state.reason))
        return {
            "contraction": float(state.contraction),
            "loaded_length": float(state.length),
            "loaded_angle": float(state.braid_angle),
            "contact_pressure": float(state.contact_pressure),
        }


TRACT_NEEDED = (("diameter",), ("link_length",), ("tract", "phantom"))
"""Of `list_tract_inputs`, those that a study must have."""


def list_tract_inputs() -> dict[str, Quantity]:
    """Return the inputs of a job that plans a scope's motion through a tract."""
    scope = list_quantities(Scope)
    return {
        "tract": Quantity(kind="file", help="The tract, a file."),
        "phantom": Quantity(low=0, high=2**31, whole=True, label="phantom"),
        "labels": _list_words("Labels that are lumen, with commas."),
        "organ": _list_words("Which organ it is.", ORGANS),
        "voxel": Quantity(kind="length", low=0.01, high=100.0, label="voxel"),
        "inflate": Quantity(kind="length", low=0.0, high=INFLATION_MAX, label="inflate"),
        "diameter": scope["diameter"],
        "link_length": scope["link_length"],
        "head_step": list_quantities(PlannerOptions)["head_step"],
        "method": list_quantities(InsertionOptions)["method"],
    }


def open_row(row: Mapping[str, Value]) -> tuple[Case, Scope]:
    """Return the case of a row of `list_tract_inputs`, and its scope."""
    case = open_tract(
        str(row.get("tract", "")),
        float(row.get("phantom", -1.0)),
        str(row.get("labels", "")),
        str(row.get("organ", "")),
        float(row.get("voxel", 0.0)),
        float(row.get("inflate", 0.0)),
    )
    scope = Scope(diameter=float(row["diameter"]), link_length=float(row["link_length"]))
    given = {name: row[name] for name in ("method", "head_step") if name in row}
    return case.change(**given) if given else case, scope


@lru_cache(maxsize=4)
def open_tract(
    source: str, phantom: float, labels: str, organ: str, voxel: float, inflate: float
) -> Case:
    """Return the case of a tract; the last few are kept."""
    from .case import Case, open_phantom
    from .options import ReadOptions

    options = InsertionOptions(voxel=voxel or None, inflate=inflate)
    if not source:
        size = {"voxel": max(voxel, 1.0)} if voxel else {}
        if organ == "airway":  # the thin branches are not seen in wider voxels
            size = {"voxel": voxel or 1.0}
        tract = open_phantom(seed=int(phantom), organ=organ or "upper-tract", **size)
        return Case.open(tract, options)
    parts = tuple(part.strip() for part in labels.split(",") if part.strip())
    listed = tuple(int(part) if part.isdigit() else part for part in parts)
    reading = ReadOptions(labels=listed or None, organ=organ or None)
    return Case.open(source, options, reading=reading)


def plan_row(row: Mapping[str, Value]) -> CasePlan:
    """Return the certified motion through the tract of a row; the last few are kept.

    Raises
    ------
    InputError
        If none of the whole way was found.
    """
    given = tuple(sorted((name, row[name]) for name in list_tract_inputs() if name in row))
    return _plan(given)


@lru_cache(maxsize=4)
def _plan(given: tuple[tuple[str, Value], ...]) -> CasePlan:
    case, scope = open_row(dict(given))
    found = case.plan(scope, advise=False)
    if found.plan.status != "complete" or not found.plan.certified:
        raise InputError("no certified motion of the whole way was found")
    return found


class InsertionJob(RowJob):
    """Whether scopes fit through tracts, certified; of those that do not, no reason is sought."""

    name = "insertion-feasibility"
    TOO_WIDE, NOT_FOUND = 2, 3
    reasons = {
        1: "the inputs are not legal together",
        TOO_WIDE: "no way through is so wide (proved)",
        NOT_FOUND: "no certified motion of the whole way was found",
    }
    chunk = 7
    needed = TRACT_NEEDED

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return what a scope, its tract and the planner take."""
        return list_tract_inputs()

    @property
    def outputs(self) -> Mapping[str, str]:
        """Certified clearance, widest that can pass, way's length, share of lumen not reached."""
        return {"clearance": "mm", "passage": "mm", "way": "mm", "unreached": ""}

    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return what is known of a scope in a tract."""
        case, scope = open_row(row)
        found = case.judge(scope)
        plan = found.plan
        proved = plan.proved if plan.status == "complete" else None
        return {
            "passage": 2.0 * found.passage.bound,
            "way": found.line.length,
            "clearance": math.nan if proved is None else proved,
            "unreached": found.unreached_share,
        }

    def run(self, columns: Columns) -> Rows:
        """Return what comes of n scopes; codes 2 and 3 are those that do not fit."""
        rows = super().run(columns)
        lacks = (rows.code == 0) & np.isnan(rows.outputs["clearance"])
        diameter = np.asarray(columns.get("diameter", self.fixed.get("diameter")), dtype=float)
        proved = diameter > rows.outputs["passage"]
        rows.code[lacks] = self.NOT_FOUND
        rows.code[lacks & proved] = self.TOO_WIDE
        return rows


class RoutingJob(RowJob):
    """Tendons routed so that a robot holds the path of a scope's motion into a tract."""

    name = "routing"
    chunk = 4
    needed = TRACT_NEEDED

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return those of the tract and the scope, of the routing, and of the backbone."""
        from ..continuum.routing import RoutingLimits

        return {
            **list_tract_inputs(),
            "tendons": Quantity(low=1, high=4, whole=True, label="tendons"),
            "bending_stiffness": Quantity(
                kind="rigidity", low=1e-9, high=1e15, label="bending stiffness"
            ),
            **list_quantities(RoutingLimits),
        }

    @property
    def outputs(self) -> Mapping[str, str]:
        """Distance from the path, tensions, the routing's slope, and what is certified."""
        return {
            "error_rms": "mm",
            "error_max": "mm",
            "tension_sum": "N",
            "slope": "",
            "length": "mm",
            "clearance": "mm",
        }

    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return how well a routing holds the path, as thick as the scope."""
        from ..continuum import RobotDesign, Section
        from ..continuum.routing import RoutingLimits
        from ..motion.routing import design_routing

        made = plan_row(row)
        plan = made.plan
        limits = {name: float(row[name]) for name in list_quantities(RoutingLimits) if name in row}
        section = Section(
            length=1.0,
            radius=plan.get_scope().radius,
            bending_stiffness=float(row.get("bending_stiffness", 200.0)),
        )
        found = design_routing(
            plan,
            tendons=int(float(row.get("tendons", 2))),
            limits=RoutingLimits(**limits),
            robot=RobotDesign((section,)),
            duct=made.duct,
        )
        if not found.converged:
            raise InputError(found.reason)
        clearance = found.clearance
        return {
            "error_rms": found.error_rms,
            "error_max": found.error_max,
            "tension_sum": float(found.tensions.sum()),
            "slope": found.slope,
            "length": found.robot.length,
            "clearance": math.nan if clearance is None else clearance,
        }


class RobotJob(RowJob):
    """A tendon robot from a file, its sections and tendons changed: where its tip goes.

    Inputs are paths in the robot's file, sections and tendons counted from 1 as in
    ``sections.1.length`` or ``sections.2.tendons.1.offset``, and ``displacement.NAME`` or
    ``tension.NAME`` of tendons.
    """

    name = "robot-sections"
    chunk = 500
    needed = (("robot",),)
    kinds: ClassVar[Mapping[str, str]] = {
        "displacement": "length",
        "tension": "force",
    }

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return robot, model, and of the names given those that may be part of a robot."""
        from ..continuum import CONTINUUM_MODELS, Section, Tendon

        parts = {**list_quantities(Section), **list_quantities(Tendon)}
        known: dict[str, Quantity] = {
            "robot": Quantity(kind="file", help="The robot's file."),
            "model": _list_words("The model.", tuple(CONTINUUM_MODELS)),
        }
        for name in names:
            head, _, rest = name.partition(".")
            last = name.rpartition(".")[2]
            if head in cls.kinds and rest:
                known[name] = Quantity(kind=cls.kinds[head])
            elif head == "sections" and last in parts:
                known[name] = replace(parts[last], low=-math.inf, high=math.inf)
        return known

    @property
    def outputs(self) -> Mapping[str, str]:
        """Place of the tip, and the angle between its tangent and the base's."""
        return {"tip_x": "mm", "tip_y": "mm", "tip_z": "mm", "bend": "rad", "length": "mm"}

    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return where the tip of a robot is."""
        from ..continuum import ContinuumRobot

        plain = _read_robot(str(row["robot"])).to_dict()
        pulls: dict[str, dict[str, float]] = {kind: {} for kind in self.kinds}
        for name, value in row.items():
            head, _, rest = name.partition(".")
            if head in self.kinds:
                pulls[head][rest] = float(value)
            elif head == "sections":
                _put(plain, name, value)
        robot = ContinuumRobot.from_dict(plain)
        if pulls["tension"] and pulls["displacement"]:
            raise InputError("displacements and tensions are both given: give one of them")
        model = str(row["model"]) if "model" in row else None
        if pulls["tension"]:
            shape = robot.forward(tensions=pulls["tension"], model=model)
        else:
            shape = robot.forward(pulls["displacement"], model=model)
        tip, along = shape.require().tip, shape.tip_frame[:3, 2]
        start = robot.base_frame[:3, 2]
        bend = math.atan2(float(np.linalg.norm(np.cross(start, along))), float(start @ along))
        x, y, z = (float(value) for value in tip)
        return {"tip_x": x, "tip_y": y, "tip_z": z, "bend": bend, "length": robot.length}


@lru_cache(maxsize=16)
def _read_robot(path: str):  # type: ignore[no-untyped-def]  # heavy to import for its name alone
    from ..continuum import ContinuumRobot

    return ContinuumRobot.from_yaml(path)


def _put(plain: object, path: str, value: object) -> None:
    """Set a number in nested plain data by its path; items of lists count from 1."""
    *parts, last = path.split(".")
    for part in parts:
        if isinstance(plain, list):
            if not part.isdigit() or not 1 <= int(part) <= len(plain):
                raise InputError(f"'{path}': '{part}' must be in 1 to {len(plain)}")
            plain = plain[int(part) - 1]
        elif isinstance(plain, dict) and part in plain:
            plain = plain[part]
        else:
            raise InputError(f"'{path}': the robot has no '{part}' there")
    if not isinstance(plain, dict):
        raise InputError(f"'{path}' is no number of a robot: such as sections.1.length")
    plain[last] = float(value)  # type: ignore[arg-type]


JOBS: Registry[Job] = Registry(
    "bozzini.studies",
    lambda: Job,
    lambda: {
        kind.name: kind for kind in (EffectorJob, MuscleJob, InsertionJob, RoutingJob, RobotJob)
    },
    noun="study job",
)
"""Jobs by name: this package's, and those that other packages add as ``bozzini.studies``."""


class FunctionJob(RowJob):
    """A function of one's own: it takes the inputs as keywords and returns its outputs.

    It returns a mapping from names to numbers, or one number if one output is asked for. An
    `InputError` is the reason of its row; what else it raises is an error of the row.
    """

    name = "function"
    reasons: ClassVar[Mapping[int, str]] = {**RowJob.reasons, 2: "an output is not finite"}
    chunk = 100

    def __init__(
        self, fixed: Mapping[str, Value], function: Callable[..., object], outputs: tuple[str, ...]
    ) -> None:
        super().__init__(fixed)
        self.function, self.names = function, outputs

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return all names that are given: nothing is known of them."""
        return {name: Quantity(help=FREE) for name in names}

    @property
    def outputs(self) -> Mapping[str, str]:
        """Those that the study names."""
        return dict.fromkeys(self.names, "")

    def run(self, columns: Columns) -> Rows:
        """Return what comes of n rows; those that are not finite have no answer."""
        rows = super().run(columns)
        finite = np.isfinite(list(rows.outputs.values())).all(axis=0)
        rows.code[(rows.code == 0) & ~finite] = 2
        return rows

    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return what the function gives of a row."""
        given = self.function(**row)
        found: Mapping[str, SupportsFloat]
        found = given if isinstance(given, Mapping) else {self.names[0]: cast(float, given)}
        missing = next((name for name in self.names if name not in found), None)
        if missing is not None:
            raise TypeError(f"the function gave no '{missing}'")
        return {name: float(found[name]) for name in self.names}


def find_function(place: str) -> Callable[..., object]:
    """Return a function by ``module:function``. Its module runs: a study is trusted like code.

    Raises
    ------
    InputError
        If it cannot be imported, is no function, or has no source in Python: what comes of it is
        known by its source.
    """
    module, _, name = place.partition(":")
    try:
        found = getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:  # another's module may raise anything
        raise InputError(
            f"job '{place}' cannot be imported: {type(error).__name__}: {error}"
        ) from None
    if not callable(found):
        raise InputError(f"job '{place}' is {show_value(found)}: it must be a function")
    function: Callable[..., object] = found
    if find_source(function) is None:
        raise InputError(
            f"job '{place}' has no source in Python: name a function that has, and that takes the "
            "inputs as keywords"
        )
    return function


def find_source(function: Callable[..., object]) -> str | None:
    """Return the file that a function or class is written in; None if it is built in."""
    made: object = inspect.unwrap(function)
    while isinstance(made, partial):
        made = inspect.unwrap(made.func)
    if not (inspect.isroutine(made) or inspect.isclass(made)):
        made = type(made).__call__
    try:
        return inspect.getsourcefile(made)
    except TypeError:
        return None


def check_keywords(place: str, function: Callable[..., object], names: Iterable[str]) -> None:
    """Raise `InputError` if a function cannot be called with these names."""
    try:
        inspect.signature(function).bind(**dict.fromkeys(names))
    except (TypeError, ValueError) as error:  # a ValueError if it tells no signature
        raise InputError(
            f"job '{place}' does not take the inputs {', '.join(names)} as keywords: {error}"
        ) from None
