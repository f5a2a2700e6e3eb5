"""Names of labels: what tools call organs, how files hold names, which organ they mean."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from .tract import Organ

__all__ = [
    "TOTALSEGMENTATOR",
    "describe_label",
    "find_organ",
    "is_digestive",
    "list_sides",
    "normalise",
    "read_label_table",
    "write_label_table",
]

TOTALSEGMENTATOR: Mapping[str, Mapping[str, int]] = {
    "totalsegmentator-v1": {
        "stomach": 6, "esophagus": 42, "trachea": 43, "small_bowel": 55, "duodenum": 56,
        "colon": 57,
    },
    "totalsegmentator-v2": {
        "stomach": 6, "esophagus": 15, "trachea": 16, "small_bowel": 18, "duodenum": 19,
        "colon": 20,
    },
}  # fmt: skip
"""Numbers of hollow organs in the multi-label files of TotalSegmentator, from ``total_v1`` and
``total`` in totalsegmentator/map_to_binary.py of github.com/wasserth/TotalSegmentator, commit
0275d30 (Wasserthal et al., Radiology: Artificial Intelligence 2023, doi:10.1148/ryai.230024)."""

_ORGANS: tuple[tuple[Organ, str], ...] = (
    ("colon", r"colon|large (bowel|intestine)|rectum|sigmoid|c(a)?ecum"),
    ("small-bowel", r"small (bowel|intestine)|jejunum|ileum"),
    ("upper-tract", r"o?esophagus|stomach|duodenum|upper gi"),
)

_ABOVE = (
    ("esophagus", "S", "duodenum"),
    ("esophagus", "S", "stomach"),
    ("trachea", "S", "colon"),
    ("stomach", "L", "duodenum"),
    ("stomach", "L", "liver"),
    ("spleen", "L", "liver"),
)
"""Pairs of organs of which the first lies towards that side of the patient, centre to centre."""


def normalise(name: str) -> str:
    """Return a name in small letters, its words apart by one space, spelled as in America."""
    words = re.sub(r"[\s_\-]+", " ", name.strip().lower())
    return re.sub(r"\boesoph", "esoph", words)


def find_organ(names: Iterable[str]) -> Organ | None:
    """Return the organ that names of labels mean, None where they mean none or several.

    Parts of the upper tract together with the small bowel are the upper tract: it is entered
    there.
    """
    text = [normalise(name) for name in names]
    found = {
        organ
        for organ, pattern in _ORGANS
        if any(re.search(rf"\b({pattern})\b", name) for name in text)
    }
    if found == {"upper-tract", "small-bowel"}:
        return "upper-tract"
    return found.pop() if len(found) == 1 else None


def is_digestive(name: str) -> bool:
    """Whether a name is that of a hollow organ a scope goes through."""
    text = normalise(name)
    return text == "trachea" or find_organ([text]) is not None


def describe_label(label: int, names: Mapping[int, str]) -> str:
    """Return the name of a label, or ``label 3`` where it has none."""
    return names.get(label) or f"label {label}"


def list_sides() -> tuple[tuple[str, str, str], ...]:
    """Return pairs of organs and the side of the patient on which the first lies."""
    return _ABOVE


def read_label_table(text: str) -> dict[int, str]:
    """Return the names in a label table of a NIfTI header extension; {} where it is none.

    The form is that of Caret and of TotalSegmentator: ``<Label Key="1">name</Label>``.
    """
    begin, end = text.find("<LabelTable>"), text.find("</LabelTable>")
    if begin < 0 or end < 0 or "<!" in re.sub(r"<!\[CDATA\[", "", text[begin:end]):
        return {}
    try:
        root = ElementTree.fromstring(text[begin : end + len("</LabelTable>")])
        found = {int(item.get("Key", "")): (item.text or "").strip() for item in root}
    except (ElementTree.ParseError, ValueError):
        return {}
    return {label: name for label, name in found.items() if label > 0 and name}


def write_label_table(names: Mapping[int, str]) -> str:
    """Return a label table for a NIfTI header extension; see `read_label_table`."""
    rows = "".join(
        f'<Label Key="{label}" Red="1" Green="1" Blue="1" Alpha="1">{escape(name)}</Label>'
        for label, name in sorted(names.items())
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?><CaretExtension><VolumeInformation Index="0">'
        f"<LabelTable>{rows}</LabelTable><VolumeType>Label</VolumeType></VolumeInformation>"
        "</CaretExtension>"
    )
