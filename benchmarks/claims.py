"""Where pages state a number of a benchmark in a sentence, and which one.

`benchmarks.report` fills them in when it writes the pages, and a test holds the pages to it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .compare_peers import find_worst

Measured = dict[str, Any]


@dataclass(frozen=True)
class Claim:
    """A page, by its name from the root, the words round a number, and how it is found."""

    page: str
    before: str
    find: Callable[[Measured], str]
    after: str

    def fill(self, page: str, measured: Measured) -> str:
        """Return the page with the number as it was measured.

        Raises
        ------
        ValueError
            If the words are not there once.
        """
        pattern = f"({re.escape(self.before)}).*?({re.escape(self.after)})"
        value = self.find(measured)
        page, count = re.subn(pattern, lambda found: f"{found[1]}{value}{found[2]}", page)
        if count != 1:
            words = f"{self.before}…{self.after}"
            raise ValueError(f"{self.page} has '{words}' {count} times: not once")
        return page


def take(what: str, pattern: str) -> Callable[[Measured], str]:
    """Return how a number is found: in the row of this title, the group of the pattern."""

    def find(measured: Measured) -> str:
        (row,) = (row for row in measured["rows"] if row["what"] == what)
        found = re.search(pattern, row["measured"])
        if found is None:
            raise ValueError(f"'{what}' has no '{pattern}': {row['measured']}")
        return found[1]

    return find


def _name_peers(measured: Measured) -> str:
    found = measured["peers"]["versions"]
    return f"PyElastica {found['pyelastica']}, SoRoMoX {found['soromox']}"


PLAN = "human tract, diameter 6, links 12 mm, method tube: plan with certificate"
FRAME = "a frame of the upper tract, whole way certified, 2 thread(s)"
STUDY = "a study of 1,000,000 designs of an end-effector, 2 processes, files included"
CYLINDERS = "one link at the wall, cylinders: SLSQP's time over ours"

CLAIMS = (
    Claim("README.md", "through a human upper tract | ", take(PLAN, r"^([\d.]+ ms)"), " |"),
    Claim("README.md", "as the tract breathes | ", take(FRAME, r"^([\d.]+ ms)"), " a frame |"),
    Claim("README.md", "of a catheter tip, two cores | ", take(STUDY, r"^([\d.]+ s)"), " |"),
    Claim("docs/trust.md", "| loaded rods | ", _name_peers, " |"),
    Claim("docs/trust.md", "a wire of 100 mm: tips within ", find_worst, " mm"),
    Claim(
        "docs/benchmarks-all.md",
        "on the dearest representation, cylinders, ",
        take(CYLINDERS, r"nearest of all: ([\d,]+) times"),
        " times are left",
    ),
)
