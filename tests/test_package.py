"""The package as a whole: cheap to import, its names resolve, its version is the installed one."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import metadata

import pytest

import bozzini

HEAVY = ("scipy", "numba", "trimesh", "matplotlib", "pint", "pandas", "skimage", "igl", "nibabel")


def _loaded_after(statement: str) -> set[str]:
    code = f"import sys, json\n{statement}\nprint(json.dumps(sorted(sys.modules)), file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    return {name.split(".")[0] for name in json.loads(done.stderr.splitlines()[-1])}


@pytest.mark.parametrize(
    "statement",
    [
        "import bozzini",
        "import bozzini.cli.main",
        "from bozzini.cli.main import main; main(['--help'])",
        "from bozzini import BozziniError",
    ],
)
def test_light_import_loads_nothing_heavy(statement: str) -> None:
    loaded = _loaded_after(statement)
    assert "bozzini" in loaded
    assert loaded.isdisjoint(HEAVY)


@pytest.mark.parametrize("name", bozzini.__all__)
def test_public_names_resolve(name: str) -> None:
    assert getattr(bozzini, name) is not None
    assert name in dir(bozzini)


@pytest.mark.parametrize(
    "name",
    ["anatomy", "continuum", "duct", "effector", "motion", "plot", "report", "scene", "study"],
)
def test_a_package_lists_its_public_names_alone(name: str) -> None:
    package = getattr(bozzini, name)
    assert dir(package) == sorted(package.__all__)


def test_names_are_the_same_object_as_in_their_room() -> None:
    from bozzini.motion.plan import Plan
    from bozzini.motion.scope import Scope

    assert bozzini.Plan is Plan
    assert bozzini.Scope is Scope


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'colonoscope'"):
        bozzini.colonoscope  # noqa: B018


def test_version_is_the_installed_one() -> None:
    try:
        installed = metadata.version("bozzini")
    except metadata.PackageNotFoundError:
        pytest.skip("bozzini runs from its source tree, it is not installed")
    assert installed == bozzini.__version__
