"""JSON Schemas of records: what `bozzini.io.records` reads, for editors and other programs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np

from ..checks import Quantity, list_quantities
from ..results import Json
from .records import annotate_quantity, is_quantity, is_union

DRAFT = "https://json-schema.org/draft/2020-12/schema"

# What is not here may be anything.
_PLAIN: Mapping[object, Json] = {
    int: {"type": "integer"},
    bool: {"type": "boolean"},
    str: {"type": "string"},
    type(None): {"type": "null"},
}


def make_schema(record: type, title: str) -> Json:
    """Return the JSON Schema of a file that holds a record."""
    return {"$schema": DRAFT, "title": title, **describe_type(record)}


def describe_type(kind: object, *, text: bool = True) -> Json:
    """Return the schema of a type: a dataclass, or what its fields may be.

    Parameters
    ----------
    kind : type
    text : bool
        Whether a quantity may be text with a unit.
    """
    origin, members = get_origin(kind), get_args(kind)
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        return _describe_record(kind, text=text)
    if is_quantity(kind):
        return describe_quantity(members[1], text=text)
    if kind is float:
        return describe_quantity(Quantity(), text=text)
    if origin is Literal:
        return {"enum": list(members)}
    if is_union(kind):  # sequences are what Python takes: a file's lists are read as tuples
        read = [member for member in members if get_origin(member) is not Sequence]
        return {"anyOf": [describe_type(member, text=text) for member in read]}
    if origin is tuple and members[-1] is not Ellipsis:
        return {
            "type": "array",
            "prefixItems": [describe_type(member, text=text) for member in members],
            "minItems": len(members),
            "maxItems": len(members),
        }
    if origin is tuple:
        return {"type": "array", "items": describe_type(members[0], text=text)}
    if origin in (dict, Mapping):
        return {"type": "object", "additionalProperties": describe_type(members[1], text=text)}
    if origin is np.ndarray:
        return {"type": "array", "items": {"type": ["number", "array"]}}
    return dict(_PLAIN.get(kind, {}))


def describe_fields(record: type, *, text: bool = True) -> dict[str, Json]:
    """Return the schemas of a dataclass's fields by their names; `text` as for `describe_type`."""
    kinds, known = get_type_hints(record, include_extras=True), list_quantities(record)
    found: dict[str, Json] = {}
    for item in dataclasses.fields(record):
        kind = kinds[item.name]
        if item.name in known and known[item.name].words:
            found[item.name] = {"enum": list(known[item.name].words)}
        else:
            if item.name in known:
                kind = annotate_quantity(kind, known[item.name])
            found[item.name] = describe_type(kind, text=text)
        if item.name in known and known[item.name].describe():
            found[item.name]["description"] = known[item.name].describe()
    return found


def describe_quantity(known: Quantity, *, text: bool = True) -> Json:
    """Return the schema of a number of which something is known; `text` as for `describe_type`."""
    number: Json = {"type": "integer" if known.whole else "number"}
    if not callable(known.low) and math.isfinite(known.low):
        number["exclusiveMinimum" if known.low_open else "minimum"] = known.low
    if not callable(known.high) and math.isfinite(known.high):
        number["maximum"] = known.high
    return {"anyOf": [number, {"type": "string"}]} if text and not known.whole else number


def _describe_record(record: type, *, text: bool) -> Json:
    fields = [item for item in dataclasses.fields(record) if item.init]
    described = describe_fields(record, text=text)
    return {
        "type": "object",
        "properties": {item.name: described[item.name] for item in fields},
        "required": [
            item.name
            for item in fields
            if item.default is item.default_factory is dataclasses.MISSING
        ],
        "additionalProperties": False,
    }
