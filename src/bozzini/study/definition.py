"""A study as it is computed: its file resolved, its key, and the tables of its rows."""

from __future__ import annotations

import difflib
import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..anatomy.read import hash_input
from ..checks import Quantity, check_path
from ..errors import BozziniError, FileFormatError, InputError
from ..io.inputs import note_input
from ..io.records import load_record, read_record, write_record
from ..results import Shown
from ..units import add_unit, parse_quantity
from .factors import Axis, Sampling, StudySpec, Value, count_rows, draw_rows, take_value
from .jobs import ERROR, Columns, Job, Rows, find_function, find_source
from .tasks import choose_job, make_job

if TYPE_CHECKING:
    import pyarrow


@dataclass(frozen=True, eq=False)
class Study(Shown):
    """A study file, checked and resolved.

    Parameters
    ----------
    spec : StudySpec
    base : Path
        Where the paths of its files begin.

    Raises
    ------
    InputError
        If an input is unknown to the job or not legal, or a file cannot be read.
    """

    spec: StudySpec
    base: Path = Path()

    def __post_init__(self) -> None:
        for name in (*self.spec.constraints, *self._list_aims()):
            if name not in self.job.outputs:
                raise InputError(
                    f"there is no output '{name}': the job has {', '.join(self.job.outputs)}"
                )
        for name in self.spec.outputs:
            if name not in self.job.outputs:
                raise InputError(f"outputs has '{name}': the job has {', '.join(self.job.outputs)}")
        for name in self.job.outputs:
            if name in self.spec.factors:
                raise InputError(f"'{name}' is a factor and an output: names must differ")
        if not self.job.outputs:
            raise InputError("outputs is empty: the job gives no numbers unless they are named")
        for known in (self.axes, self.limits, self.rows):
            del known  # checked as they are made

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Study:
        """Read a study file, YAML or JSON; paths in it begin at its directory.

        Raises
        ------
        FileFormatError
            One line that names the file and what is wrong.
        """
        source = check_path("study", path)
        try:
            return cls(load_record(source, StudySpec, name="the study"), source.resolve().parent)
        except FileFormatError:
            raise
        except InputError as error:
            raise FileFormatError(f"{source}: {error}") from None

    @classmethod
    def from_text(cls, text: str) -> Study:
        """Return the study of `to_text`."""
        plain = json.loads(text)
        return cls(read_record(plain["study"], StudySpec), Path(plain["base"]))

    def to_text(self) -> str:
        """Return the study as JSON, for workers and the file of results."""
        return json.dumps({"study": write_record(self.spec), "base": str(self.base)})

    def _list_aims(self) -> list[str]:
        search = self.spec.search
        return [] if search is None else [name.removeprefix("-") for name in search.minimise]

    @cached_property
    def inputs(self) -> Mapping[str, Quantity]:
        """What is known of the inputs that the study has, fixed or varied."""
        names = (*self.spec.fixed, *self.spec.factors)
        known = choose_job(self.spec.job).list_inputs(names)
        for name in names:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1)
                hint = f"did you mean '{near[0]}'" if near else f"it has {', '.join(known)}"
                raise InputError(f"the job {self.spec.job} has no input '{name}': {hint}")
        for group in choose_job(self.spec.job).needed:
            given = [name for name in group if name in names]
            if len(given) != 1:
                has = " and ".join(given) or f"no {group[0]}"
                raise InputError(
                    f"the job {self.spec.job} has {has}: fix or vary {' or '.join(group)}"
                )
        return {name: known[name] for name in names}

    @cached_property
    def axes(self) -> list[Axis]:
        """The factors, in order."""
        return [Axis(name, factor, self.inputs[name]) for name, factor in self.spec.factors.items()]

    @cached_property
    def fixed(self) -> dict[str, Value]:
        """The fixed inputs in Bozzini's units; files as paths."""
        found: dict[str, Value] = {}
        for name, value in self.spec.fixed.items():
            known = self.inputs[name]
            try:
                found[name] = take_value(value, known)
            except InputError as error:
                raise InputError(f"fixed.{name}: {error}") from None
            if known.kind == "file":
                found[name] = self._find_file(str(value))
        return found

    @cached_property
    def files(self) -> dict[str, str]:
        """The files of factors: as given, and as paths."""
        listed = [axis for axis in self.axes if axis.kind == "files" or axis.known.kind == "file"]
        return {str(value): self._find_file(str(value)) for axis in listed for value in axis.values}

    def _find_file(self, given: str) -> str:
        path = self.base / given
        if not os.path.isfile(path):
            raise InputError(f"there is no file {path}")
        note_input(path)
        return str(path)

    @cached_property
    def job(self) -> Job:
        """The job with its fixed inputs."""
        named = (*self.spec.outputs, *self.spec.constraints, *self._list_aims())
        outputs = tuple(dict.fromkeys(named))
        return make_job(self.spec.job, self.fixed, inputs=self.inputs, outputs=outputs)

    @cached_property
    def outputs(self) -> dict[str, str]:
        """The outputs that are kept, and their units."""
        known = self.job.outputs
        kept = {*self.spec.outputs, *self.spec.constraints, *self._list_aims()}
        return {name: unit for name, unit in known.items() if name in kept or not self.spec.outputs}

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Least and largest values of outputs."""
        found: dict[str, tuple[float, float]] = {}
        for name, limit in self.spec.constraints.items():
            unit = self.job.outputs[name]
            ends = (limit.at_least, limit.at_most)
            low, high = (
                open_end if end is None else _take_end(name, end, unit)
                for end, open_end in zip(ends, (-math.inf, math.inf), strict=True)
            )
            if low > high:
                raise InputError(
                    f"constraints.{name} is at least {low:g} and at most {high:g}: no value is both"
                )
            found[name] = (low, high)
        return found

    @cached_property
    def rows(self) -> int:
        """How many rows there are; of a search 0, as it is not known before."""
        if self.spec.sampling is None:
            return 0
        return count_rows(self.axes, self.spec.sampling)

    @property
    def chunk(self) -> int:
        """Rows of a part."""
        return self.spec.chunk or self.job.chunk

    @cached_property
    def key(self) -> str:
        """SHA-256 of all that the rows depend on: not of chunks, workers and spellings."""
        spec = self.spec
        axes = [
            (
                *(axis.name, axis.kind, axis.values, axis.factor.scale),
                getattr(axis, "clip", None),
                axis.levels if spec.sampling and spec.sampling.method == "grid" else None,
            )
            for axis in self.axes
        ]
        names = {name for name, known in self.inputs.items() if known.kind == "file"}
        given = {**self.files, **{name: str(self.fixed[name]) for name in names & {*self.fixed}}}
        made = find_function(spec.job) if ":" in spec.job else self.job.made_by
        if made.__module__.partition(".")[0] != "bozzini":
            source = find_source(made)
            given |= {"function": source} if source else {}
        parts = (
            *(__version__, spec.job, axes, sorted(self.outputs)),
            {name: value for name, value in self.fixed.items() if name not in names},
            None if spec.sampling is None else write_record(spec.sampling),
            None if spec.search is None else write_record(spec.search),
            sorted(self.limits.items()),
            {name: hash_input(path) for name, path in given.items()},
        )
        text = json.dumps(parts, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def columns(self) -> dict[str, str]:
        """The columns of factors and outputs by name, with their units in it."""
        units = {axis.name: "" if axis.is_words else axis.known.unit for axis in self.axes}
        return {name: add_unit(name, unit) for name, unit in (units | self.outputs).items()}

    def draw(self, first: int, count: int) -> dict[str, NDArray[np.generic]]:
        """Return the factors of some rows, each (count,)."""
        return draw_rows(self.axes, self.spec.sampling or Sampling(), first=first, count=count)

    def compute(self, columns: Columns) -> Rows:
        """Return what comes of rows; an exception is the reason of its own row alone."""
        given = {
            name: np.array([self.files[value] for value in values], dtype=object)
            if values.dtype == object and self.files and values[0] in self.files
            else values
            for name, values in columns.items()
        }
        try:
            return self.job.run(given)
        except Exception as error:  # a job of others may raise anything
            count = len(next(iter(given.values())))
            if count == 1:
                text = str(error)
                if not isinstance(error, BozziniError):
                    text = f"{type(error).__name__}: {error}"
                return Rows(
                    outputs={name: np.full(1, math.nan) for name in self.job.outputs},
                    code=np.array([ERROR], dtype=np.int8),
                    text={0: " ".join(text.split())},
                )
            alone = [
                self.compute({name: values[i : i + 1] for name, values in columns.items()})
                for i in range(count)
            ]
            return Rows(
                outputs={
                    name: np.concatenate([rows.outputs[name] for rows in alone])
                    for name in self.job.outputs
                },
                code=np.concatenate([rows.code for rows in alone]),
                text={i: rows.text[0] for i, rows in enumerate(alone) if rows.text},
            )

    def judge(self, rows: Rows) -> NDArray[np.bool_]:
        """Whether rows are feasible: computed, and within the constraints."""
        feasible = rows.code == 0
        for name, (low, high) in self.limits.items():
            values = rows.outputs[name]
            feasible &= (values >= low) & (values <= high)
        return np.asarray(feasible)

    def make_table(self, columns: Columns, rows: Rows, *, first: int) -> pyarrow.Table:
        """Return rows as a table: row, factors, outputs, code, feasible, reason."""
        import pyarrow as pa

        names = self.columns
        table: dict[str, object] = {"row": np.arange(first, first + rows.code.size)}
        for axis in self.axes:
            values = columns[axis.name]
            if axis.is_words:
                table[names[axis.name]] = pa.array([str(value) for value in values])
            elif axis.known.whole or axis.kind == "integers":
                table[names[axis.name]] = np.asarray(values, dtype=np.int64)
            else:
                table[names[axis.name]] = np.asarray(values, dtype=np.float64)
        for name in self.outputs:
            table[names[name]] = np.asarray(rows.outputs[name], dtype=np.float64)
        table["code"] = rows.code
        table["feasible"] = self.judge(rows)
        texts = ["", *sorted({*self.job.reasons.values(), *rows.text.values()} - {""})]
        places = {text: k for k, text in enumerate(texts)}
        index = np.zeros(rows.code.size, dtype=np.int32)
        for code in np.unique(rows.code):
            index[rows.code == code] = places.get(self.job.reasons.get(int(code), ""), 0)
        for i, text in rows.text.items():
            index[i] = places[text]
        table["reason"] = pa.DictionaryArray.from_arrays(pa.array(index), pa.array(texts))
        return pa.table(table)


def _take_end(name: str, end: Value, unit: str) -> float:
    from ..units import INTERNAL_UNITS

    kind = next(kind for kind, known in INTERNAL_UNITS.items() if known == unit)
    try:
        return parse_quantity(end, kind)
    except InputError as error:
        raise InputError(f"constraints.{name}: {error}") from None


@lru_cache(maxsize=4)
def take_study(text: str) -> Study:
    """Return the study of `Study.to_text`; each process makes it once."""
    return Study.from_text(text)
