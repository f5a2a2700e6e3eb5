"""Write the page of the catalogue of muscle models.

python docs/make_catalogue.py
"""

from __future__ import annotations

from pathlib import Path

from bozzini.report.catalogue_page import format_catalogue

PAGE = Path(__file__).resolve().parent / "theory" / "catalogue.md"

if __name__ == "__main__":
    PAGE.write_text(format_catalogue(), "utf-8")
