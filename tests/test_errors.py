"""The error family: everything is a `BozziniError`, and also the built-in kind it stands for."""

from __future__ import annotations

import inspect
import pickle

import pytest

from bozzini import errors
from bozzini.errors import BozziniError, MissingExtraError


def _family() -> list[type[BozziniError]]:
    return [getattr(errors, name) for name in errors.__all__]


def test_all_lists_every_exception_of_the_module() -> None:
    classes = {name for name, _ in inspect.getmembers(errors, inspect.isclass)}
    assert classes == set(errors.__all__)


@pytest.mark.parametrize("error", _family())
def test_every_error_is_a_bozzini_error(error: type[BozziniError]) -> None:
    assert issubclass(error, BozziniError)


@pytest.mark.parametrize(
    ("error", "builtin"),
    [
        (errors.InputError, ValueError),
        (errors.UnitError, ValueError),
        (errors.FileFormatError, ValueError),
        (errors.GeometryError, ValueError),
        (errors.OutputError, OSError),
        (errors.MissingExtraError, ImportError),
    ],
)
def test_errors_are_caught_as_the_builtin_kind(
    error: type[BozziniError], builtin: type[Exception]
) -> None:
    assert issubclass(error, builtin)


@pytest.mark.parametrize("error", [item for item in _family() if item is not MissingExtraError])
def test_message_is_kept_and_error_survives_a_process_boundary(error: type[BozziniError]) -> None:
    first = error("diameter is -1 mm: it must lie in (0, inf) mm")
    again = pickle.loads(pickle.dumps(first))
    assert type(again) is error
    assert str(again) == str(first) == "diameter is -1 mm: it must lie in (0, inf) mm"


def test_missing_extra_says_what_to_install() -> None:
    error = MissingExtraError("dask", "sweeps")
    assert "pip install 'bozzini[sweeps]'" in str(error)
    again = pickle.loads(pickle.dumps(error))
    assert (again.package, again.extra, str(again)) == ("dask", "sweeps", str(error))
