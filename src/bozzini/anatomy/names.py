"""Names of labels: what tools call organs, how files hold names, which organ they mean."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from ..errors import InputError
from .tract import Organ

VERSIONS: Mapping[str, Mapping[str, int]] = {
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

MOST_BYTES = 1_000_000
"""Largest file of names that is opened."""


def normalise(name: str) -> str:
    """Return a name in small letters, its words apart by one space, spelled as in America."""
    words = re.sub(r"[\s_\-]+", " ", name.strip().lower())
    return re.sub(r"\boesoph", "esoph", words)


def match_name(name: str, names: Iterable[str], source: str) -> list[str]:
    """Return which of the names of labels a name means: itself, else the one alike, else none.

    Raises
    ------
    InputError
        If several names differ by no more than capitals and blanks from it.
    """
    alike = sorted({each for each in names if normalise(each) == normalise(name)})
    exact = [each for each in alike if each.strip() == name.strip()]
    if len(alike) > 1 and not exact:
        raise InputError(
            f"label is '{name}', but {source} has {' and '.join(alike)}: give one as it is written"
        )
    return exact or alike


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
    airway = re.search(r"\b(trachea|airways?|bronch\w+)\b", text)
    return airway is not None or find_organ([text]) is not None


def describe_label(label: int, names: Mapping[int, str]) -> str:
    """Return the name of a label, or ``label 3`` where it has none."""
    return names.get(label) or f"label {label}"


def split_version(label: int | str) -> tuple[str, str] | None:
    """Return version and organ of a label such as ``"totalsegmentator-v1:colon"``, else None.

    Raises
    ------
    InputError
        If there is no such version, or it has no such organ.
    """
    version, _, organ = str(label).strip().lower().partition(":")
    if not organ:
        return None
    organ = normalise(organ).replace(" ", "_")
    if version not in VERSIONS or organ not in VERSIONS[version]:
        raise InputError(
            f"label is '{label}': known are {' and '.join(VERSIONS)}, each with "
            f"{', '.join(VERSIONS['totalsegmentator-v2'])}, such as totalsegmentator-v2:colon"
        )
    return version, organ


def spread_version(labels: Iterable[int | str]) -> list[int | str]:
    """Return labels in which a version that is stated once holds for the organs after it, too."""
    found: list[int | str] = []
    stated = ""
    for label in labels:
        version, colon, _ = str(label).strip().lower().partition(":")
        organ = normalise(str(label)).replace(" ", "_")
        if colon and version in VERSIONS:
            stated = version
        found.append(f"{stated}:{organ}" if stated and organ in VERSIONS[stated] else label)
    return found


def find_version(labels: Iterable[int | str]) -> tuple[str, dict[int, str]] | None:
    """Return the version that labels name, and the organs asked of it by their numbers.

    Raises
    ------
    InputError
        If they name two versions.
    """
    found = [item for item in map(split_version, labels) if item is not None]
    if not found:
        return None
    versions = sorted({version for version, _ in found})
    if len(versions) > 1:
        raise InputError(f"the labels name {' and '.join(versions)}: a file has one version")
    return versions[0], {VERSIONS[versions[0]][organ]: organ for _, organ in found}


def read_sidecar(volume: Path, suffix: str) -> tuple[dict[int, str], list[Path]]:
    """Return the names of labels in files beside a volume, and which files state them.

    These are JSON (``{"1": "colon"}``; under ``labels``, ``names`` or the ``LabelMap`` of BIDS
    ``{"colon": 1}`` too), colour tables of 3D Slicer (``.ctbl``, ``.txt``) and label descriptions
    of ITK-SNAP (``.label``, ``.txt``), with the volume's name but for the suffix.
    """
    stem = volume.name[: -len(suffix)]
    names: dict[int, str] = {}
    files = []
    for kind, read in _SIDECARS.items():
        file = volume.with_name(f"{stem}{kind}")
        found = read(_read_text(file))
        if found:
            names = {**found, **names}
            files.append(file)
    return names, files


def read_json(file: Path) -> dict[str, object]:
    """Return the object in a JSON file; {} where there is none."""
    return _parse(_read_text(file))


def _parse(text: str) -> dict[str, object]:
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return tree if isinstance(tree, dict) else {}


def _read_text(file: Path) -> str:
    try:
        if file.stat().st_size <= MOST_BYTES:
            return file.read_text(encoding="utf-8", errors="replace")
    except (OSError, ValueError):
        pass
    return ""


def _read_tree(text: str) -> dict[int, str]:
    tree = _parse(text)
    for key in (None, "labels", "names", "LabelMap"):
        part = tree if key is None else tree.get(key)
        if not isinstance(part, dict):
            continue
        pairs = list(part.items())
        if key is not None and all(isinstance(item, int) for _, item in pairs):
            pairs = [(item, name) for name, item in pairs]
        if pairs and all(str(k).isdecimal() and isinstance(item, str) for k, item in pairs):
            return {int(k): item.strip() for k, item in pairs if int(k) and item.strip()}
    return {}


_SLICER = re.compile(r"^(\d+)\s+(\S*[^\W\d]\S*)(?:\s+\d+){4}\s*$")
_SNAP = re.compile(r'^\s*(\d+)(?:\s+[\d.]+){4,6}\s+"([^"]+)"\s*$')


def _read_table(text: str) -> dict[int, str]:
    lines = text.splitlines()
    found = [_SLICER.match(line) or _SNAP.match(line) for line in lines]
    return {int(hit[1]): hit[2].strip() for hit in found if hit and int(hit[1])}


_SIDECARS = {".json": _read_tree, ".ctbl": _read_table, ".label": _read_table, ".txt": _read_table}
