"""Write the page of the catalogue of muscle models, and the README's table of it.

python docs/make_catalogue.py
"""

from __future__ import annotations

from pathlib import Path

from bozzini.report.catalogue_page import format_catalogue, format_counts

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "theory" / "catalogue.md"
README = ROOT / "README.md"
BEGIN, END = "<!-- catalogue: begin -->", "<!-- catalogue: end -->"


def make_readme() -> str:
    """Return the README with the table of today."""
    before, rest = README.read_text("utf-8").split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{format_counts()}\n\n{END}{after}"


def main() -> None:
    """Write both."""
    PAGE.write_text(format_catalogue(), "utf-8")
    README.write_text(make_readme(), "utf-8")


if __name__ == "__main__":
    main()
