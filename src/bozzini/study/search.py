"""Searches for the best row: each a function of shares in [0, 1) of the factors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingExtraError
from ..numeric.arrays import Floats
from ..progress import Progress
from .definition import Study
from .factors import Search
from .parts import part_name, write_part

Measure = Callable[[Floats], tuple[Floats, NDArray[np.bool_]]]
"""Takes shares (n, d); gives what is to be small (n, k), and whether rows are feasible (n,)."""

_INFEASIBLE = 1e30
"""What a row that is not feasible counts as: more than any that is."""


def _evolve(measure: Measure, dim: int, search: Search) -> None:
    """SciPy's differential evolution, a generation at once."""
    from scipy.optimize import differential_evolution

    def value(shares: Floats) -> Floats:
        aims, feasible = measure(np.atleast_2d(shares.T))
        return np.where(feasible, aims[:, 0], _INFEASIBLE)

    members = max(5, min(15, search.evaluations // (10 * dim)))
    differential_evolution(
        value,
        [(0.0, 1.0)] * dim,
        popsize=members,
        maxiter=max(1, search.evaluations // (members * dim) - 1),
        tol=1e-10,
        polish=False,
        updating="deferred",
        vectorized=True,
        seed=np.random.default_rng(search.seed),
    )


def _evolve_front(measure: Measure, dim: int, search: Search) -> None:
    """Pymoo's NSGA-II, for several aims."""
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize
    except ImportError:
        raise MissingExtraError("pymoo", "sweeps") from None

    class Aims(Problem):  # type: ignore[misc]  # pymoo has no types
        def _evaluate(self, shares: Floats, out: dict[str, Floats], *_: object) -> None:
            aims, feasible = measure(np.asarray(shares, dtype=np.float64))
            out["F"] = np.where(feasible[:, np.newaxis], aims, _INFEASIBLE)
            out["G"] = np.where(feasible, -1.0, 1.0)[:, np.newaxis]

    members = min(100, max(10, search.evaluations // 10))
    minimize(
        Aims(n_var=dim, n_obj=len(search.minimise), n_ieq_constr=1, xl=0.0, xu=1.0),
        NSGA2(pop_size=members),
        ("n_gen", max(1, search.evaluations // members)),
        seed=search.seed,
    )


def _guess(measure: Measure, dim: int, search: Search) -> None:
    """Optuna's TPE, a row at a time."""
    try:
        import optuna
    except ImportError:
        raise MissingExtraError("optuna", "sweeps") from None
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=search.seed))
    for _ in range(search.evaluations):
        trial = study.ask()
        shares = np.array([[trial.suggest_float(f"factor{k}", 0.0, 1.0) for k in range(dim)]])
        aims, feasible = measure(shares)
        if feasible[0]:
            study.tell(trial, float(aims[0, 0]))
        else:
            study.tell(trial, state=optuna.trial.TrialState.FAIL)


SEARCHES: dict[str, Callable[[Measure, int, Search], None]] = {
    "differential-evolution": _evolve,
    "nsga2": _evolve_front,
    "tpe": _guess,
}


def run_search(study: Study, search: Search, *, folder: Path, progress: Progress) -> None:
    """Search for the best row and write every row that was tried, in parts of its generations.

    Raises
    ------
    MissingExtraError
        If the search's package is not installed.
    """
    import pyarrow as pa

    for old in folder.glob("part-*.parquet"):
        old.unlink()
    names = [name.removeprefix("-") for name in search.minimise]
    signs = np.array([-1.0 if name[0] == "-" else 1.0 for name in search.minimise])
    tables: list[pa.Table] = []
    state = {"rows": 0, "parts": 0}

    def flush() -> None:
        if tables:
            table = pa.concat_tables(tables).unify_dictionaries().combine_chunks()
            write_part(study, table, folder / part_name(state["parts"]))
            state["parts"] += 1
            tables.clear()

    def measure(shares: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        inside = np.clip(shares, 0.0, 1.0 - 1e-15)
        columns = {axis.name: axis.place(inside[:, k]) for k, axis in enumerate(study.axes)}
        rows = study.compute(columns)
        tables.append(study.make_table(columns, rows, first=state["rows"]))
        state["rows"] += len(inside)
        if sum(table.num_rows for table in tables) >= study.chunk:
            flush()
        progress("search", min(state["rows"] / search.evaluations, 1.0))
        aims = np.stack([rows.outputs[name] for name in names], axis=-1) * signs
        return aims, study.judge(rows) & np.isfinite(aims).all(axis=-1)

    SEARCHES[search.method](measure, len(study.axes), search)
    flush()
