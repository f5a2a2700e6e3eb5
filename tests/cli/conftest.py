"""Fixtures of the command line's tests: a small tract in every form, and ``bozzini plan``."""

from __future__ import annotations

import pytest

from bozzini.cli import common
from bozzini.cli.main import main
from tests.cli.plan_cases import Outcome, Run, Tracts, write_tracts


@pytest.fixture(scope="session")
def tracts(tmp_path_factory: pytest.TempPathFactory) -> Tracts:
    return write_tracts(tmp_path_factory.mktemp("tracts"))


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = main(["plan", *map(str, arguments)])
        return Outcome(code, *capsys.readouterr())

    return call


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep a slow machine from adding lines of progress to what the tests read."""
    monkeypatch.setattr(common.LineProgress, "interval", float("inf"))
