"""What all tests share: the real anatomy where there is one, Hypothesis, a headless matplotlib."""

from __future__ import annotations

import gc
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

settings.register_profile(
    "default", deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=30
)
settings.register_profile("ci", settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")

gc.disable()  # until all tests are collected, of which nothing is garbage


def pytest_collection_finish() -> None:
    """Leave modules and tests, which stay, out of the collection of garbage."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give slow tests more time than the others have, and begin with those that take longest."""

    def take_seconds(item: pytest.Item) -> float:
        mark = item.get_closest_marker("slow")
        return float(mark.args[0]) if mark is not None and mark.args else 0.0

    items.sort(key=take_seconds, reverse=True)
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.timeout(1800))


@pytest.fixture(scope="session", autouse=True)
def kernels_are_recorded() -> Iterator[None]:
    """Record which kernels are called with what types where `make kernels` asks for that.

    `make test` compiles all that are listed beforehand: what is compiled then is not listed.
    """
    place, compiled = (os.environ.get(f"BOZZINI_{name}") for name in ("SIGNATURES", "COMPILED"))
    if not (place or compiled):
        yield
        return
    from tests.compiled import recording

    with recording(only_compiled=not place) as found:
        yield
    if place:
        rows = {name: sorted(signatures) for name, signatures in found.items()}
        Path(place, f"{os.getpid()}.json").write_text(json.dumps(rows), encoding="utf-8")
    else:
        assert not found, f"signatures.json lacks some of these, see `make kernels`: {dict(found)}"


@pytest.fixture(scope="module", autouse=True)
def coarse_pictures(request: pytest.FixtureRequest) -> Iterator[None]:
    """Write pictures with few pixels where tests look at what is said about them alone.

    Of a plan on the command line, most of the time is its pictures.
    """
    if request.path.parent.name not in ("cli", "study", "report"):
        yield
        return
    from matplotlib.figure import Figure

    write = Figure.savefig

    def write_coarse(figure: Figure, *place: Any, **options: Any) -> None:
        write(figure, *place, **{**options, "dpi": 20.0})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", write_coarse)
        yield


def _find_data(name: str) -> Path:
    """Return the directory of a data set that is not part of the project, or skip.

    ``BOZZINI_DATA`` names its parent; otherwise it is looked for beside the checkout.
    """
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    directory = Path(os.environ.get("BOZZINI_DATA", beside)) / name
    if not directory.is_dir():
        pytest.skip(f"no data at {directory} (set BOZZINI_DATA to its parent)")
    return directory


@pytest.fixture(scope="session")
def airway_dir() -> Path:
    """Label volume and reference tree of a human airway."""
    return _find_data("airway")


@pytest.fixture(scope="session")
def upper_gi_dir() -> Path:
    """Give the directory of the CT-derived upper tract (GCA-Models, CC BY 4.0)."""
    return _find_data("upper_gi")


@pytest.fixture(scope="session")
def festo10_dir() -> Path:
    """Give the directory of curves of McKibben muscles that fill and leak (Bolen et al.)."""
    return _find_data("festo10")


@pytest.fixture(scope="session")
def data_dir() -> Callable[[str], Path]:
    """Give what gives the directory of measured data, by its name."""
    return _find_data


@pytest.fixture(scope="session")
def colon_dir() -> Path:
    """Give the directory of the colon of the Visible Human female (GCA-Models, CC BY 4.0)."""
    return _find_data("colon")
