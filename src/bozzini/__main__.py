"""``python -m bozzini`` is the command ``bozzini``."""

from __future__ import annotations

import os
import sys

__all__ = ["run"]


def run() -> int:
    """Load and run the command line; return its exit code, also if the loading is interrupted."""
    # Matrices are small here. On busy cores threads of BLAS wait for each other: 23 ms in place of
    # 0.1 ms for a product of 120 rows.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from .cli.main import main

        return main()
    except KeyboardInterrupt:
        sys.stderr.write("bozzini: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(run())
