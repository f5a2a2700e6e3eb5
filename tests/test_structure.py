"""What keeps the code easy to extend: no import circles, short argument lists, few loose types."""

from __future__ import annotations

import ast
import importlib
import inspect
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import bozzini

SOURCE = Path(bozzini.__file__).resolve().parent
MODULES = {
    ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(SOURCE.rglob("*.py"))
}


_HOLD_STATEMENTS = (ast.stmt, ast.excepthandler, ast.match_case)


def _is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def _imports(name: str, tree: ast.Module) -> Iterator[str]:
    """Give the modules of Bozzini that one imports when it runs, inside functions too."""
    is_package = MODULES[name].stem == "__init__"
    package = name.split(".") if is_package else name.split(".")[:-1]
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{stem}.{alias.name}"
                yield full if full in MODULES else stem
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif not _is_for_types(node):
            children = ast.iter_child_nodes(node)
            waiting += (child for child in children if isinstance(child, _HOLD_STATEMENTS))


class Module(NamedTuple):
    """What is looked at of a module; its tree is not kept."""

    imports: set[str]
    parameters: dict[str, int]
    anys: int
    classes: list[str]


@cache
def _read(name: str) -> Module:
    tree = ast.parse(MODULES[name].read_text(encoding="utf-8"))
    parameters, anys = {}, 0
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            given = node.args
            names = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
            count = len(names) - (names[:1] in (["self"], ["cls"]))
            parameters[f"{name}.{node.name}:{node.lineno}"] = count
        anys += isinstance(node, ast.Name) and node.id == "Any"
    classes = [node.name for node in tree.body if isinstance(node, ast.ClassDef)]
    return Module(set(_imports(name, tree)), parameters, anys, classes)


def test_no_modules_import_each_other_in_a_circle() -> None:
    # A package's own __init__ hands on names: it imports its modules, and they do not import it.
    left = {
        name: {other for other in _read(name).imports if other in MODULES and other != name}
        for name, path in MODULES.items()
        if path.stem != "__init__"
    }
    left = {name: others & set(left) for name, others in left.items()}
    while left:
        ready = {name for name, others in left.items() if not others & set(left)}
        assert ready, f"in circles, or above one: {sorted(left)}"
        left = {name: others for name, others in left.items() if name not in ready}


def test_functions_have_few_parameters() -> None:
    long = [
        f"{function}: {count}"
        for name in MODULES
        if ".kernels" not in name
        for function, count in _read(name).parameters.items()
        if count > 6
    ]
    assert len(long) < 20, long


def _list_public() -> Iterator[tuple[str, Callable[..., object]]]:
    """Give the functions and methods of the public names of the packages."""
    for name, path in MODULES.items():
        parts = name.split(".")
        if path.stem != "__init__" or len(parts) != 2:
            continue
        package = importlib.import_module(name)
        for word in getattr(package, "__all__", ()):
            item = getattr(package, word)
            if inspect.isfunction(item):
                yield f"{name}.{word}", item
            for key, method in vars(item).items() if isinstance(item, type) else ():
                if inspect.isfunction(method) and not key.startswith("_"):
                    yield f"{name}.{word}.{key}", method


def test_public_functions_take_two_arguments_by_their_place() -> None:
    long = []
    for name, function in _list_public():
        given = inspect.signature(function).parameters.values()
        by_place = [p.name for p in given if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
        count = len(by_place) - (by_place[:1] in (["self"], ["cls"]))
        long += [f"{name}: {count}"] if count > 2 else []
    assert not long


def test_few_types_are_left_open() -> None:
    assert sum(_read(name).anys for name in MODULES) < 100


def test_the_type_checker_makes_few_exceptions() -> None:
    text = (SOURCE.parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    overrides = tomllib.loads(text)["tool"]["mypy"]["overrides"]
    ours = [name for part in overrides for name in part["module"] if name.startswith("bozzini")]
    assert len(ours) <= 5


def test_no_two_public_classes_have_one_name() -> None:
    homes: dict[str, list[str]] = {}
    for name in MODULES:
        if not any(part.startswith("_") for part in name.split(".")):
            for found in _read(name).classes:
                if not found.startswith("_"):
                    homes.setdefault(found, []).append(name)
    assert not {name: places for name, places in homes.items() if len(places) > 1}


def test_arrays_of_numbers_have_one_alias() -> None:
    left = [n for n, p in MODULES.items() if "\nFloats = " in p.read_text(encoding="utf-8")]
    assert left == ["bozzini.numeric.arrays"]
