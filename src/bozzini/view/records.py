"""Numbers out of records that may lack them, and bounds rounded to the safe side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

__all__ = ["ceil_mm", "read_number"]


def ceil_mm(value: float, digits: int = 2) -> str:
    """Write a length rounded up, as an upper bound must be."""
    return f"{math.ceil(value * 10**digits - 1e-9) / 10**digits:.{digits}f}"


def read_number(values: Mapping[str, Any], key: str) -> float | None:
    """Return a finite number from a record, None where there is none."""
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if math.isfinite(value) else None
