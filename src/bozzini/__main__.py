"""``python -m bozzini`` is the command ``bozzini``."""

from __future__ import annotations

import sys

__all__ = ["run"]


def run() -> int:
    """Load and run the command line; return its exit code, also if the loading is interrupted."""
    try:
        from .cli.main import main

        return main()
    except KeyboardInterrupt:
        sys.stderr.write("bozzini: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(run())
