"""Plans with options as keywords, and plans and files with another description."""

from __future__ import annotations

import json

import numpy as np

from bozzini.motion import Plan, PlannerOptions, plan_insertion

ARRAYS = ("joints", "head_arc_length", "clearance", "path", "path_arc_length", "path_radius")
TEXTS = ("method", "status", "reason_code", "reason")


def insert(duct, line, *, scope, method="best", **options):
    """Return `plan_insertion` with these options."""
    made = PlannerOptions(**options)
    return plan_insertion(duct, line, scope=scope, method=method, options=made)


def describe_anew(plan, meta):
    """Return a plan with another description, as a file holds it."""
    return Plan.from_meta(meta, **{name: getattr(plan, name) for name in (*ARRAYS, *TEXTS)})


def rewrite(file, **changes):
    """Write the archive again with other arrays."""
    with np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files}
    np.savez_compressed(file, **{**arrays, **changes})
    return file


def forge(path, change):
    """Write the archive again with its meta changed by a function."""
    with np.load(path) as archive:
        meta = json.loads(str(archive["meta"]))
    change(meta)
    return rewrite(path, meta=np.array(json.dumps(meta)))
