"""Kernels: written so that they compile quickly, and all known to `doctor --compile`."""

from __future__ import annotations

import ast
import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

import bozzini
from bozzini.numeric.signatures import find_kernel, read_signature, read_signatures, write_type

SOURCE = Path(bozzini.__file__).parent
MODULES = sorted(SOURCE.glob("*/kernels/*.py"))


@functools.cache
def _find_axes(path: Path) -> dict[str, dict[str, int]]:
    """Return the axes of the arrays that each kernel of a module takes or makes, by their names."""
    module = f"{path.parent.parent.name}.kernels.{path.stem}"
    listed = read_signatures()
    found: dict[str, dict[str, int]] = {}
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(function, ast.FunctionDef):
            continue
        axes: dict[str, int] = {}
        for signature in listed.get(f"{module}.{function.name}", [])[:1]:
            for argument, kind in zip(function.args.args, read_signature(signature), strict=False):
                axes[argument.arg] = getattr(kind, "ndim", 0)
        for node in ast.walk(function):
            if not isinstance(node, ast.Assign):
                continue
            target, value = node.targets[0], node.value
            pairs = [(target, value)]
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = list(zip(target.elts, value.elts, strict=True))
            for name, made in pairs:
                if isinstance(name, ast.Name) and isinstance(made, ast.Call):
                    if ast.unparse(made.func) in ("np.empty", "np.zeros", "np.full", "np.ones"):
                        shape = made.args[0]
                        axes[name.id] = len(shape.elts) if isinstance(shape, ast.Tuple) else 1
        found[function.name] = axes
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: f"{path.parts[-3]}/{path.stem}")
def test_no_array_is_assigned_to_a_part_of_another(path: Path) -> None:
    """Numba then compiles NumPy's broadcasting and the text of its errors, for seconds."""
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(function, ast.FunctionDef):
            continue
        axes = _find_axes(path)[function.name]
        for node in ast.walk(function):
            if not isinstance(node, (ast.Assign, ast.AugAssign, ast.AnnAssign)):
                continue
            first = node.targets[-1] if isinstance(node, ast.Assign) else node.target
            targets = first.elts if isinstance(first, ast.Tuple) else [first]
            several = isinstance(node.value, ast.Tuple) and len(targets) > 1
            values = node.value.elts if several else [node.value]
            for target, value in zip(targets, values, strict=len(targets) == len(values)):
                if not isinstance(target, ast.Subscript):
                    continue
                place = target.slice.elts if isinstance(target.slice, ast.Tuple) else [target.slice]
                known = axes.get(getattr(target.value, "id", ""), 0)
                if any(isinstance(index, ast.Slice) for index in place) or len(place) < known:
                    constant = ast.unparse(value).lstrip("-")
                    where = f"{path.name}:{node.lineno}: {ast.unparse(node)}"
                    assert constant in ("np.nan", "np.inf", "math.nan", "math.inf") or (
                        isinstance(getattr(value, "operand", value), ast.Constant)
                    ), f"{where}: copy it by a loop, see numeric/kernels/copies.py"


def test_listed_signatures_are_of_kernels_and_read_back() -> None:
    listed = read_signatures()
    assert len(listed) > 100
    for name, signatures in listed.items():
        arguments = find_kernel(name).py_func.__code__.co_argcount
        for signature in signatures:
            kinds = read_signature(signature)
            assert len(kinds) <= arguments, name
            assert "".join(f"{write_type(kind)}, " for kind in kinds) == signature[1:-1], name


def test_few_kernels_are_compiled_for_several_types() -> None:
    """One layout at the edge: only kinds of ducts and of labels have kernels of their own."""
    several = {name for name, kinds in read_signatures().items() if len(kinds) > 1}
    packed = {name for name in several if "NamedTuple" in read_signatures()[name][0]}
    assert several - packed <= {
        "anatomy.kernels.voxels." + name for name in ("find_runs", "paint_runs")
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", ["muscle solve --pressure 100psi", "effector pose --pressure R=300kPa"]
)
def test_compiled_code_that_cannot_be_kept_is_told_once_and_the_work_goes_on(
    tmp_path: Path, command: str
) -> None:
    code = (
        "import errno\n"
        "from bozzini.cli.main import main\n"
        "from numba.core.caching import IndexDataCacheFile\n"
        "def full(*_): raise OSError(errno.ENOSPC, 'No space left on device')\n"
        "IndexDataCacheFile._save_data = full\n"
        f"raise SystemExit(main({command.split()}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and done.stdout
    assert done.stderr.count("cannot be kept") == 1 and "No space left" in done.stderr


def test_a_place_for_compiled_code_that_cannot_be_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "bozzini", "muscle", "presets"],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "file")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert done.stderr.count("note:") == 1 and "cannot be written" in done.stderr
