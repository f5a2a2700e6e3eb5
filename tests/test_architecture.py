"""The package graph: which package may import which, and what a library never does."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TypeGuard

import pytest

import bozzini

SOURCE = Path(bozzini.__file__).resolve().parent

BASE = (
    "errors",
    "units",
    "checks",
    "progress",
    "numeric",
    "registry",
    "views",
    "results",
    "tracking",
    "io",
    "task",
)
"""Modules and packages that all may import; each may import those to its left."""

MAY_IMPORT = {
    "anatomy": set(),
    "duct": {"anatomy"},
    "continuum": set(),
    "motion": {"anatomy", "duct", "continuum"},
    "muscle": set(),
    "hysteresis": {"muscle"},
    "effector": {"muscle"},
    "rig": {"continuum", "duct", "effector", "motion", "muscle", "vision"},
    "vision": {"effector", "muscle"},
    "fabricate": {"continuum", "effector"},
    "head": {"duct", "effector", "motion", "muscle", "vision"},
}
MAY_IMPORT["plot"] = set(MAY_IMPORT)
MAY_IMPORT["scene"] = set(MAY_IMPORT)
MAY_IMPORT["report"] = set(MAY_IMPORT)
MAY_IMPORT["study"] = set(MAY_IMPORT)
MAY_IMPORT["physics"] = {"anatomy", "continuum", "duct", "motion", "plot", "scene", "study"}
MAY_IMPORT["cockpit"] = set(MAY_IMPORT)
MAY_IMPORT["cli"] = set(MAY_IMPORT)

BY_NAME = {
    "__init__.py": "packages and public names, when they are first asked for",
    "muscle/__init__.py": "its own modules, when they are first asked for",
    "cli/main.py": "the module of the command that is run",
    "cli/doctor.py": "whatever is to be tried, so that a fault in one does not hide the next",
    "study/jobs.py": "the function of a user",
    "numeric/signatures.py": "kernels of any package, compiled ahead from the list in a file",
}
"""Who imports modules by names that stand in no text of the source, and which."""

MODULES = sorted(path.relative_to(SOURCE) for path in SOURCE.rglob("*.py"))


def _is_call(node: ast.AST, *names: str) -> TypeGuard[ast.Call]:
    """Return whether it calls a function or method of one of these names."""
    if not isinstance(node, ast.Call):
        return False
    return getattr(node.func, "attr", getattr(node.func, "id", "")) in names


def _is_print(node: ast.AST) -> bool:
    return _is_call(node, "print") and isinstance(node.func, ast.Name)


def _is_import(node: ast.AST) -> TypeGuard[ast.Call]:
    return _is_call(node, "import_module", "__import__")


@cache
def _nodes(path: Path) -> tuple[ast.AST, ...]:
    """Return the imports, assertions, and calls of ``print`` or of an import of a file.

    Nothing else is kept: whole trees would be gone through at each collection of garbage.
    """
    looked_at = (ast.Import, ast.ImportFrom, ast.Assert)
    nodes = ast.walk(ast.parse((SOURCE / path).read_text(encoding="utf-8")))
    return tuple(
        node for node in nodes if isinstance(node, looked_at) or _is_print(node) or _is_import(node)
    )


def _resolve(path: Path, name: str, level: int = 0) -> tuple[str, ...]:
    """Return a module's parts, its name taken as in a file, with so many dots before it."""
    here = ("bozzini", *path.parent.parts)
    base = here[: len(here) - level + 1] if level else ()
    return (*base, *filter(None, name.split(".")))


def _name_module(path: Path, call: ast.Call) -> tuple[str, ...] | None:
    """Return the module that a call imports by name: none if its name is not in the source."""
    first = call.args[0] if call.args else None
    if not (isinstance(first, ast.Constant) and isinstance(first.value, str)):
        return None
    return _resolve(path, first.value, len(first.value) - len(first.value.lstrip(".")))


def _imported(path: Path) -> Iterator[tuple[str, ...]]:
    """Give every module of Bozzini that a file imports, as its parts after ``bozzini``.

    Those imported inside functions, for types alone and by name are among them.
    """
    names: list[tuple[str, ...]] = []
    for node in _nodes(path):
        if isinstance(node, ast.Import):
            names += [_resolve(path, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = _resolve(path, node.module or "", node.level)
            names += [(*base, alias.name) for alias in node.names]
    names += filter(None, (_name_module(path, node) for node in _nodes(path) if _is_import(node)))
    yield from (name[1:] for name in names if name[0] == "bozzini" and len(name) > 1)


def _package(path: Path) -> str:
    return path.parts[0].removesuffix(".py")


def test_the_package_graph_has_no_cycle() -> None:
    seen: set[str] = set()
    waiting = dict(MAY_IMPORT)
    while waiting:
        ready = {package for package, others in waiting.items() if others <= seen}
        assert ready, f"these import each other in a cycle: {sorted(waiting)}"
        seen |= ready
        waiting = {package: others for package, others in waiting.items() if package not in ready}


def test_every_package_is_in_the_graph() -> None:
    packages = {path.parts[0] for path in MODULES if len(path.parts) > 1}
    assert packages <= {*MAY_IMPORT, *BASE}
    loose = {path.stem for path in MODULES if len(path.parts) == 1}
    assert loose | packages - set(MAY_IMPORT) == {*BASE, "__init__", "__main__"}


@pytest.mark.parametrize(
    "path",
    [path for path in MODULES if path.stem not in ("__init__", "__main__") or path.parent.parts],
    ids=str,
)
def test_imports_point_to_the_left(path: Path) -> None:
    package = _package(path)
    if package in BASE:
        legal = {package, *BASE[: BASE.index(package)]}
    else:
        legal = {package, *BASE, *MAY_IMPORT[package], "__version__"}
    for name in _imported(path):
        assert name[0] in legal, f"{path} imports bozzini.{'.'.join(name)}"


def test_few_import_by_a_name_that_is_not_in_the_source() -> None:
    found = {
        path.as_posix()
        for path in MODULES
        for node in _nodes(path)
        if _is_import(node) and _name_module(path, node) is None
    }
    assert found == set(BY_NAME)


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_nobody_takes_packages_from_bozzini_itself(path: Path) -> None:
    """Its attributes load packages, which no import would show."""
    for node in _nodes(path):
        if isinstance(node, ast.Import) and path.parts != ("__main__.py",):
            assert "bozzini" not in [alias.name for alias in node.names], path


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_private_modules_stay_in_their_package(path: Path) -> None:
    for name in _imported(path):
        if name[0] != _package(path) and name[0] != "__version__":
            modules = [part for part in name if part.startswith("_")]
            # A compiled kernel can only call compiled kernels, those of another package included.
            private = [part for part in modules if not part.endswith("_kernels")]
            assert not (modules if "_kernels" not in path.stem else private), (
                f"{path} imports bozzini.{'.'.join(name)}"
            )


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_library_neither_asserts_nor_prints(path: Path) -> None:
    for node in _nodes(path):
        assert not isinstance(node, ast.Assert), f"{path}:{node.lineno} asserts"
        assert not _is_print(node), f"{path} prints"
