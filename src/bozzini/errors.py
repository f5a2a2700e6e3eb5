"""One exception family: everything Bozzini raises on purpose is a `BozziniError`.

The command line turns any of them into one line on stderr and exit code 2.
"""

from __future__ import annotations

__all__ = [
    "BozziniError",
    "ConvergenceError",
    "DeformationError",
    "FileFormatError",
    "GeometryError",
    "InputError",
    "MissingExtraError",
    "MissingLawError",
    "OutputError",
    "PluginError",
    "UnitError",
]


class BozziniError(Exception):
    """Base of every error that Bozzini raises on purpose."""


class InputError(BozziniError, ValueError):
    """A value is outside its legal range; the message names the value and the range."""


class UnitError(InputError):
    """A quantity has an unknown unit, or a unit of the wrong dimension."""


class ConvergenceError(BozziniError, ArithmeticError):
    """An iteration ran out of steps before it met its tolerance, or there is no answer."""


class MissingLawError(InputError):
    """A model needs a law that only the cited paper holds, and was not given it."""


class FileFormatError(InputError):
    """A file cannot be read as what it claims to be."""


class GeometryError(InputError):
    """A tract, duct or robot geometry cannot be used; the message has the place and why."""


class DeformationError(GeometryError):
    """A tissue moves otherwise than its frame states, or not one to one; the message has where."""


class OutputError(BozziniError, OSError):
    """A result cannot be written where it was asked to be."""


class PluginError(BozziniError):
    """What another installed package adds to Bozzini cannot be imported or used."""


class MissingExtraError(BozziniError, ImportError):
    """An optional dependency is not installed.

    Parameters
    ----------
    package : str
        The distribution that is missing.
    extra : str
        The extra of Bozzini that brings it.
    """

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(
            f"this needs the package '{package}', which is not installed: "
            f"pip install 'bozzini[{extra}]'"
        )
        self.package = package
        self.extra = extra

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        # By default an exception is pickled by its message alone.
        return type(self), (self.package, self.extra)
