"""Running a study: parts in a directory, written by processes or a cluster, and resumed."""

from __future__ import annotations

import json
import logging
import os
import platform
import shutil
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import islice
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import TYPE_CHECKING

from ..checks import check_integer, check_path
from ..errors import (
    BozziniError,
    FileFormatError,
    InputError,
    MissingExtraError,
    OutputError,
)
from ..io.files import check_parquet, reserve_directory, write_atomically, write_text
from ..io.inputs import note_input
from ..io.records import parse_json
from ..progress import Progress, no_progress
from ..results import Json, Result, measured, take_axes
from .definition import Study, take_study
from .parts import load_part, part_name, read_part, write_part

if TYPE_CHECKING:
    from multiprocessing.popen_spawn_posix import Popen
    from multiprocessing.process import BaseProcess

    import pandas
    import pyarrow
    from matplotlib.axes import Axes

WINDOW = 4
"""Parts in flight for each worker: more would only fill the memory."""

FORMAT = "bozzini-study-result-1"
PATIENCE_S = 10.0
"""How long a cluster may be silent."""
_QUIET_DASK = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.interval": "5s",
}
"""Settings of a cluster of our own: nobody looks at its profiles, which cost processor time."""
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True, kw_only=True)
class StudyResult(Result):
    """What a directory of results holds.

    Attributes
    ----------
    folder : str
    key : str
        Of the study, see `Study.key`.
    rows : int
        How many there are to be; of a search those that it made.
    done : int
        Those in finished parts.
    feasible : int
        Those that are feasible.
    reasons : dict of str to int
        Why the others are not, and how many.
    seconds : float
        Of the last run; 0 if none was.
    """

    folder: str
    key: str
    rows: int
    done: int
    feasible: int
    reasons: dict[str, int] = field(default_factory=dict)
    seconds: float = measured("s")

    @property
    def converged(self) -> bool:
        """Whether every row is there."""
        return self.done == self.rows > 0

    @property
    def reason(self) -> str:
        """Why not."""
        return "" if self.converged else f"{self.rows - self.done} of {self.rows} rows are missing"

    @property
    def residual(self) -> float:
        """Share of the rows that is missing."""
        return (self.rows - self.done) / self.rows if self.rows else 0.0

    def read(self) -> pandas.DataFrame:
        """Return all rows as a table, in order."""
        return read_rows(self.folder)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw how many rows are feasible, and why the others are not; return the axes."""
        axes = take_axes(ax, x="rows", y="")
        counts = {"feasible": self.feasible, **self.reasons}
        axes.barh(list(counts), list(counts.values()))
        return axes


def run_chunk(text: str, folder: str, index: int, chunk: int) -> Json:
    """Compute and write one part; what every worker of every engine does.

    Parameters
    ----------
    text : str
        Of `Study.to_text`.
    folder : str
        Where the parts go, a place that all workers share.
    index : int
        Which part.
    chunk : int
        Rows of a part.
    """
    study = take_study(text)
    first = index * chunk
    columns = study.draw(first, min(chunk, study.rows - first))
    table = study.make_table(columns, study.compute(columns), first=first)
    return write_part(study, table, Path(folder, part_name(index)))


@dataclass(frozen=True, kw_only=True)
class Engine:
    """What computes the parts.

    Parameters
    ----------
    workers : int, optional
        Processes; by default one for each processor. 1 works in this process.
    cluster : str, optional
        A Dask cluster in place of processes: ``"local"``, the address of a scheduler
        (``tcp://...``), or its file (``.json``). Needs the extra ``sweeps``.

    Raises
    ------
    InputError
        If a value is not legal.
    """

    workers: int | None = None
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.workers is not None:
            check_integer("workers", self.workers, low=1, high=4096)
        given = self.cluster
        if given is not None and not (
            given == "local" or given.startswith(("tcp://", "tls://")) or given.endswith(".json")
        ):
            raise InputError(
                f"cluster is '{given}': it must be local, an address such as tcp://host:8786, or a "
                "scheduler's file that ends in .json"
            )

    @property
    def count(self) -> int:
        """Workers asked for."""
        return self.workers or os.cpu_count() or 1

    @contextmanager
    def open(self) -> Iterator[tuple[Executor | None, int, Callable[[], bool]]]:
        """Give an executor (None: this process), its workers, and whether it still answers."""
        before = {name: os.environ.get(name) for name in _THREADS}
        os.environ |= dict.fromkeys(_THREADS, "1")  # for the workers: one thread each
        try:
            if self.cluster is not None:
                yield from self._open_cluster(self.cluster)
            elif self.count == 1:
                yield None, 1, lambda: True
            else:
                yield from self._open_pool()
        finally:
            for name, value in before.items():
                os.environ.pop(name)
                os.environ |= {} if value is None else {name: value}

    def _open_pool(self) -> Iterator[tuple[Executor, int, Callable[[], bool]]]:
        pool = ProcessPoolExecutor(self.count, mp_context=_Context(), initializer=_end_with_parent)
        try:
            yield pool, self.count, lambda: True
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _open_cluster(self, cluster: str) -> Iterator[tuple[Executor, int, Callable[[], bool]]]:
        try:
            import dask
            from distributed import Client, LocalCluster
        except ImportError:
            raise MissingExtraError("distributed", "sweeps") from None
        local = None
        try:
            if cluster == "local":
                with dask.config.set(_QUIET_DASK), _hide_script():
                    local = LocalCluster(
                        n_workers=self.count,
                        threads_per_worker=1,
                        dashboard_address=None,
                        silence_logs=logging.CRITICAL,
                    )
                client = Client(local)
            elif cluster.endswith(".json"):
                if not os.path.isfile(cluster):
                    raise InputError(f"there is no scheduler's file {cluster}")
                client = Client(scheduler_file=cluster, timeout=PATIENCE_S)
            else:
                client = Client(cluster, timeout=PATIENCE_S)
        except InputError:
            raise
        except Exception as error:  # of any library below it
            raise InputError(
                f"cluster {cluster} does not answer: {type(error).__name__}: {error}"
            ) from None
        try:
            if local is None and not client.scheduler_info(n_workers=-1)["workers"]:
                raise InputError(f"cluster {cluster} has no workers: start one")
            workers = len(client.scheduler_info(n_workers=-1)["workers"]) or self.count
            yield client.get_executor(pure=False), workers, lambda: client.status == "running"
        finally:
            with suppress(Exception):
                client.close(timeout=2)
            if local is not None:
                local.close()


@contextmanager
def _hide_script() -> Iterator[None]:
    """Let processes start that do not run the caller's script.

    A spawned process runs the script of its parent up to ``if __name__ == "__main__"``; one with
    no such line would start the study again in every worker. No row needs the script.
    """
    main = sys.modules["__main__"]
    hidden = {name: vars(main).pop(name) for name in ("__file__",) if name in vars(main)}
    spec, main.__spec__ = main.__spec__, None
    try:
        yield
    finally:
        main.__spec__ = spec
        vars(main).update(hidden)


class _Process(SpawnProcess):
    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Popen:  # noqa: N802
        with _hide_script():
            return SpawnProcess._Popen(process_obj)


class _Context(SpawnContext):
    Process = _Process


def _end_with_parent() -> None:
    """Let a worker end when the process that started it is no more."""
    from multiprocessing import parent_process
    from multiprocessing.connection import wait as wait_for

    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait_for([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_study(
    study: Study,
    folder: str | os.PathLike[str],
    *,
    engine: Engine | None = None,
    progress: Progress = no_progress,
) -> StudyResult:
    """Compute the rows of a study that a directory does not hold yet.

    Parts that are whole and of this study stay; all else is computed. Rows do not depend on the
    engine. A search is one sequence: it begins anew unless it is finished.

    Parameters
    ----------
    study : Study
    folder : path-like
        Made if it is not there. It gets ``study.json``, and ``rows`` with a Parquet file a part.
    engine : Engine, optional
        By default a process for each processor.
    progress : Progress
        Its stage has the rate and the time that remains.

    Raises
    ------
    OutputError
        If the directory cannot be written, holds another study, or another run writes it.
    InputError
        If the engine stops; what is written stays, and `run_study` goes on from it.
    MissingExtraError
        If ``pyarrow``, ``pandas``, or for a cluster ``distributed``, is not installed.
    """
    check_parquet("sweeps")
    target = check_path("folder", folder)
    chunk = _check_folder(study, target) or study.chunk
    there = os.path.exists(target)
    try:
        os.makedirs(os.path.realpath(target / "rows"), exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror}") from None
    try:
        return _fill(study, target, chunk, engine or Engine(), progress)
    except BozziniError:
        if not there and not any((target / "rows").iterdir()):
            shutil.rmtree(target, ignore_errors=True)
        raise


def _fill(
    study: Study, target: Path, chunk: int, engine: Engine, progress: Progress
) -> StudyResult:
    """Compute what a directory lacks, if no other run does."""
    with reserve_directory(target / "running"):
        for left in (target / "rows").glob(".part-*"):
            left.unlink(missing_ok=True)
        count = -(-study.rows // chunk)
        own = {part_name(index) for index in range(count)}
        for path in sorted((target / "rows").iterdir()):
            hidden = path.name[0] in "._"  # readers of Parquet leave these out
            if study.spec.search is None and path.name not in own and not hidden:
                raise OutputError(
                    f"{path} is none of the {count} parts of the study: move it elsewhere, as what "
                    "reads the directory would take it for one"
                )
        missing = [
            index for index in range(count) if _read_index(study, target, index, chunk) is None
        ]
        if not missing and (target / "study.json").exists():
            found = read_status(target)
            if found.converged:
                return found
        begun = time.time()
        manifest = _describe(study, chunk)
        _write_manifest(target, manifest)
        if study.spec.search is not None:
            from .search import run_search

            run_search(study, study.spec.search, folder=target / "rows", progress=progress)
        else:
            _compute(study, target, (missing, chunk), engine, progress)
        manifest |= {"ended": _tell_time(), "seconds": time.time() - begun}
        _write_manifest(target, manifest)
        found = read_status(target)
        _write_manifest(target, manifest | {"failures": found.reasons})
    return found


def _write_manifest(folder: Path, manifest: Json) -> None:
    write_text(folder / "study.json", json.dumps(manifest, indent=2) + "\n")


def _read_index(study: Study, folder: Path, index: int, chunk: int) -> Json | None:
    rows = min(chunk, study.rows - index * chunk)
    path = folder / "rows" / part_name(index)
    return read_part(path, study.key, rows=rows, first=index * chunk, deep=True)


def _compute(
    study: Study,
    folder: Path,
    work: tuple[list[int], int],
    engine: Engine,
    progress: Progress,
) -> None:
    """Compute missing parts, at most `WINDOW` for each worker in flight."""
    missing, chunk = work
    if not missing:
        return
    if study.chunk >= 1000:  # compiled here once, rather than in every worker at the same time
        study.compute(study.draw(0, 1))
    text, place = study.to_text(), str((folder / "rows").resolve())
    show = _Rate(sum(min(chunk, study.rows - index * chunk) for index in missing), study, progress)
    with engine.open() as (executor, workers, answers):
        if executor is None:
            for index in missing:
                show(run_chunk(text, place, index, chunk))
            return
        waiting: set[Future[Json]] = set()
        todo = iter(missing)
        silent = 0.0
        try:
            while True:
                for index in islice(todo, WINDOW * workers - len(waiting)):
                    waiting.add(executor.submit(run_chunk, text, place, index, chunk))
                if not waiting:
                    return
                done, waiting = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
                silent = 0.0 if answers() else silent + 1.0
                if silent > PATIENCE_S:
                    raise ConnectionError(f"no answer for {PATIENCE_S:g} s")
                for future in done:
                    show(future.result())
        except (OutputError, InputError, MissingExtraError):
            raise
        except BrokenProcessPool:
            raise InputError(
                f"a worker was killed, perhaps for its memory: 'bozzini study resume {folder}' "
                "goes on from what is written, with fewer --workers or a smaller chunk"
            ) from None
        except Exception as error:  # of the cluster: lost workers, a scheduler that is gone
            raise InputError(
                f"the cluster stopped ({type(error).__name__}): 'bozzini study resume {folder}' "
                "goes on from what is written"
            ) from None


class _Rate:
    """Progress with the rate and the time that remains."""

    def __init__(self, todo: int, study: Study, progress: Progress) -> None:
        self.todo, self.progress = todo, progress
        self.before = study.rows - todo
        self.total = study.rows
        self.done = 0
        self.begun = time.monotonic()

    def __call__(self, known: Json) -> None:
        self.done += known["rows"]
        rate = self.done / max(time.monotonic() - self.begun, 1e-9)
        left = (self.todo - self.done) / rate
        words = f"{left:.0f} s" if left < 120.0 else f"{left / 60.0:.0f} min"
        self.progress(
            f"rows, {rate:.3g} a second, {words} left", (self.before + self.done) / self.total
        )


def _check_folder(study: Study, folder: Path) -> int | None:
    """Return the chunk of results that are there; None if there are none."""
    if not os.path.exists(folder):
        return None
    if not folder.is_dir():
        raise OutputError(f"{folder} is a file: choose a directory")
    if not (folder / "study.json").exists():
        if any(path.name != "rows" and path.name[0] != "." for path in folder.iterdir()):
            raise OutputError(f"{folder} holds other files and no study: choose another directory")
        return None
    manifest = read_manifest(folder)
    if manifest["key"] != study.key:
        raise OutputError(
            f"{folder} holds another study (key {manifest['key'][:12]}, this one has "
            f"{study.key[:12]}): choose another directory"
        )
    return int(manifest["chunk"])


def _tell_time() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _describe(study: Study, chunk: int) -> Json:
    from importlib.metadata import version

    names = ("numpy", "scipy", "numba", "pyarrow")
    drawn = study.spec.sampling or study.spec.search
    return {
        "format": FORMAT,
        "key": study.key,
        **json.loads(study.to_text()),
        "rows": study.rows,
        "chunk": chunk,
        "seed": drawn.seed if drawn else 0,
        "columns": study.columns,
        "reasons": {str(code): text for code, text in study.job.reasons.items()},
        "files": {name: str(path) for name, path in study.files.items()},
        "versions": {
            "bozzini": version("bozzini"),
            "python": platform.python_version(),
            **{name: version(name) for name in names},
        },
        "host": {"system": platform.platform(), "processors": os.cpu_count()},
        "byte_order": sys.byteorder,
        "begun": _tell_time(),
    }


def read_manifest(folder: str | os.PathLike[str]) -> Json:
    """Return what ``study.json`` of a directory holds.

    Raises
    ------
    FileFormatError
        If there is none, or it is none of a study.
    """
    path = check_path("folder", folder) / "study.json"
    try:
        found = parse_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileFormatError(
            f"{path.parent} is no directory of a study: cannot read study.json, {error.strerror}"
        ) from None
    except ValueError as error:
        raise FileFormatError(f"{path} is no JSON: {error}") from None
    wanted = {"format": str, "key": str, "chunk": int, "rows": int, "study": dict, "base": str}
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise FileFormatError(f"{path} is not of the format {FORMAT}")
    for name, kind in wanted.items():
        if type(found.get(name)) is not kind:
            raise FileFormatError(f"{path}: '{name}' is missing or no {kind.__name__}")
    if found["chunk"] < 1 or found["rows"] < 0:
        raise FileFormatError(f"{path}: chunk must be 1 or more, rows 0 or more")
    return found


def open_study(folder: str | os.PathLike[str]) -> Study:
    """Return the study whose results a directory holds, to go on with it.

    Raises
    ------
    FileFormatError
        If it is no directory of a study.
    OutputError
        If the study has another key now: a file that it names, or Bozzini, has changed.
    """
    manifest = read_manifest(folder)
    try:
        study = Study.from_text(json.dumps(manifest))
    except InputError as error:
        raise FileFormatError(f"{folder}: {error}") from None
    if study.key != manifest["key"]:
        raise OutputError(
            f"{folder} cannot be resumed: a file of the study or the version of Bozzini is another "
            "one than when it began"
        )
    return study


def _list_parts(folder: Path, manifest: Json) -> dict[Path, Json]:
    """Return the finished parts of a directory, in order, and what they state."""
    found: dict[Path, Json] = {}
    for path in sorted((folder / "rows").glob("part-*.parquet")):
        index = path.stem.removeprefix("part-")
        if not index.isdigit():
            continue
        rows, first = -1, int(index) * manifest["chunk"]
        if manifest["study"].get("search") is None:
            rows = min(manifest["chunk"], manifest["rows"] - first)
        known = read_part(path, manifest["key"], rows=rows, first=first)
        if known is not None and rows != 0:
            found[path] = known
    return found


def read_status(folder: str | os.PathLike[str]) -> StudyResult:
    """Return how far the results of a directory are.

    Raises
    ------
    FileFormatError
        If it is no directory of a study.
    """
    check_parquet("sweeps")
    target, manifest = Path(folder), read_manifest(folder)
    parts = _list_parts(target, manifest).values()
    reasons: Counter[str] = Counter()
    for known in parts:
        reasons.update(known["reasons"])
    done = sum(known["rows"] for known in parts)
    search = manifest["study"].get("search") is not None
    rows = done + (0 if "ended" in manifest else 1) if search else manifest["rows"]
    return StudyResult(
        folder=str(folder),
        key=manifest["key"],
        rows=rows,
        done=done,
        feasible=sum(known["feasible"] for known in parts),
        reasons=dict(reasons.most_common()),
        seconds=float(manifest.get("seconds", 0.0)),
    )


def read_rows(folder: str | os.PathLike[str], columns: list[str] | None = None) -> pandas.DataFrame:
    """Return the rows of all finished parts, in order.

    Parameters
    ----------
    folder : path-like
    columns : list of str, optional
        Which columns; by default all.

    Raises
    ------
    FileFormatError
        If it is no directory of a study, or no part is finished.
    """
    return _open_table(folder, columns).to_pandas()


def _open_table(folder: str | os.PathLike[str], columns: list[str] | None = None) -> pyarrow.Table:
    check_parquet("sweeps")
    import pyarrow as pa

    parts = _list_parts(Path(folder), read_manifest(folder))
    if not parts:
        raise FileFormatError(f"{folder} has no finished part yet")
    tables = []
    for path in parts:
        try:
            tables.append(load_part(path, columns).replace_schema_metadata(None))
        except (OSError, pa.ArrowException):
            raise FileFormatError(
                f"{path} is damaged: 'bozzini study resume {folder}' computes it again"
            ) from None
        note_input(path)
    try:
        return pa.concat_tables(tables).unify_dictionaries()
    except pa.ArrowException:
        raise FileFormatError(f"{folder}: the parts have different columns") from None


def export_rows(folder: str | os.PathLike[str], path: str | os.PathLike[str]) -> int:
    """Write all rows into one file, .csv or .parquet, and return how many there are.

    Raises
    ------
    FileFormatError
        As `read_rows`.
    OutputError
        If the file cannot be written; nothing is left behind.
    """
    table = _open_table(folder)
    if Path(path).suffix.lower() == ".parquet":
        import pyarrow.parquet as pq

        write_atomically(path, lambda place: pq.write_table(table, place, compression="zstd"))
    else:
        import pyarrow as pa
        from pyarrow import csv

        index = table.schema.get_field_index("reason")
        table = table.set_column(index, "reason", table["reason"].cast(pa.string()))
        write_atomically(path, lambda place: csv.write_csv(table, place))
    return int(table.num_rows)
