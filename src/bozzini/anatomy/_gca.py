"""Models of the Gut Cell Atlas (GCA-Models): voxel size, landmarks and organ from their JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .findings import Finding
from .tract import LabelTract, Organ, Point, SurfaceTract

__all__ = ["Model", "find_model"]

MOST_BYTES = 20_000_000
"""Largest JSON that is opened."""

MOST_FILES = 50
"""Files of a folder that are opened, at most."""

UPRIGHT = 2.0
"""How much longer a way must be along its main axis than along the others to prove the axis."""

_ORGANS: tuple[tuple[Organ, tuple[str, ...]], ...] = (
    ("small-bowel", ("small intestine", "small bowel", "jejunum", "ileum")),
    ("upper-tract", ("oesophagus", "esophagus", "stomach", "duodenum", "ogl", "gdj", "pol")),
    ("colon", ("large intestine", "large bowel", "colon", "rectum", "sigmoid", "hepatic flexure",
               "splenic flexure", "caecum", "cecum", "transverse")),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Model:
    """What the JSON of a model states on one of its surfaces.

    Attributes
    ----------
    file : str
        Name of the JSON.
    voxel : (3,) float
        Voxel size: coordinates times it are mm.
    organ : {"upper-tract", "small-bowel", "colon"} or None
    landmarks : mapping of str to (3,) float
        By name and abbreviation, in the model's coordinates.
    """

    file: str
    voxel: NDArray[np.float64]
    organ: Organ | None
    landmarks: Mapping[str, NDArray[np.float64]]

    def describe(
        self,
        tract: SurfaceTract | LabelTract,
        corners: NDArray[np.float64],
        sizes: NDArray[np.float64],
        *,
        found_unit: bool,
    ) -> SurfaceTract | LabelTract:
        """Add landmarks, organ and frame to a tract whose coordinates were scaled by `sizes`."""
        low, high = corners.min(axis=0), corners.max(axis=0)
        slack = 0.05 * float((high - low).max())
        places = {name: point * sizes for name, point in self.landmarks.items()}

        def count(points: Iterable[NDArray[np.float64]]) -> int:
            return sum(bool(((p >= low - slack) & (p <= high + slack)).all()) for p in points)

        # Some models have the mid-line in mm already.
        if count(self.landmarks.values()) > count(places.values()):
            places = dict(self.landmarks)
        kept = {
            name: (float(p[0]), float(p[1]), float(p[2]))
            for name, p in places.items()
            if count([p])
        }
        frame = _prove_frame(kept) if self.organ == "colon" else None
        said = [f"{len(kept)} names of landmarks" if kept else "no landmark"]
        if found_unit:
            said.insert(0, "voxel size " + " x ".join(f"{value:g}" for value in self.voxel) + " mm")
        if self.organ:
            said.append(f"organ {self.organ}")
        if frame:
            said.append(f"frame {frame}, as anus and flexures lie")
        message = f"read from the model's {self.file}: {', '.join(said)}"
        return replace(
            tract,
            organ=self.organ,
            landmarks=kept,
            frame=frame,
            findings=(*tract.findings, Finding("model-read", "note", message)),
        )


def find_model(surface: Path) -> Model | None:
    """Return what the JSON of a GCA model beside a surface, or one folder up, states on it."""
    for folder in (surface.parent, surface.parent.parent):
        try:
            files = sorted(folder.glob("*.json"))[:MOST_FILES]
        except OSError:
            continue
        for file in files:
            tree = _load(file)
            if not isinstance(tree, dict) or not isinstance(tree.get("model_objects"), list):
                continue
            try:
                model = _read_model(tree, file, surface)
            except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError):
                continue
            if model is not None:
                return model
    return None


def _load(file: Path) -> Any:
    try:
        if file.stat().st_size > MOST_BYTES:
            return None
        return json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None


def _read_model(tree: dict[str, Any], file: Path, surface: Path) -> Model | None:
    objects = [item for item in tree["model_objects"] if isinstance(item, dict)]
    name = _simplify(surface.stem)
    own = [item for item in objects if _simplify(Path(str(item.get("filename", ""))).stem) == name]
    if not own:
        return None
    voxel = np.ones(3)
    for item in objects:
        if "voxel_size" in item:
            voxel = np.array([float(value) for value in item["voxel_size"]])
    if voxel.shape != (3,) or not ((voxel > 1e-3) & (voxel < 1e2)).all():
        return None
    text = " ".join(str(item.get("display_props", {}).get("text", "")) for item in own)
    organ = _find_organ(f"{_simplify(surface.stem)} {text}".lower())
    landmarks = {}
    for path in tree.get("paths", []):
        if organ is not None and organ != _find_organ(_describe(path)):
            continue
        points = _read_path(str(path.get("spline_filename", "")), file, surface)
        if points is None:
            continue
        for mark in tree.get("landmarks", []):
            if path["id"] not in mark.get("paths", []):
                continue
            at = int(mark["position"][0])
            if 0 <= at < len(points):
                for anatomy in mark["anatomy"]:
                    for key in ("text", "abbreviated_name"):
                        if anatomy.get(key):
                            landmarks[str(anatomy[key])] = points[at]
    return Model(file=file.name, voxel=voxel, organ=organ, landmarks=landmarks)


def _describe(path: Mapping[str, Any]) -> str:
    text = str(path.get("anatomy", {}).get("text", ""))
    return f"{text} {_simplify(Path(str(path.get('spline_filename', ''))).stem)}".lower()


def _simplify(name: str) -> str:
    return name.lower().replace("_", " ").replace("-", " ")


def _find_organ(text: str) -> Organ | None:
    """Return the organ of the first word found; that of a part of it comes after the whole."""
    words = f" {text} "
    hits = [
        (words.find(word), organ) for organ, names in _ORGANS for word in names if word in words
    ]
    parts = [
        organ
        for organ, names in _ORGANS
        if organ == "upper-tract" and any(w in words for w in names)
    ]
    if parts:  # duodenum and stomach are parts of files named after the small intestine
        return parts[0]
    return min(hits)[1] if hits else None


def _read_path(name: str, file: Path, surface: Path) -> NDArray[np.float64] | None:
    if not name or Path(name).name != name:
        return None
    for folder in (
        surface.parent,
        file.parent,
        file.parent / "Paths",
        surface.parent.parent / "Paths",
    ):
        tree = _load(folder / name)
        if isinstance(tree, dict) and isinstance(tree.get("points"), list):
            points = np.array(tree["points"], dtype=np.float64)
            if points.ndim == 2 and points.shape[1] == 3 and np.isfinite(points).all():
                return points
    return None


def _prove_frame(landmarks: Mapping[str, Point]) -> str | None:
    """Return the frame that the anus and the two flexures of a colon prove, if they do.

    Both flexures lie above the anus, the hepatic one to the right of the splenic one, and the anus
    behind the middle of the flexures' height; a frame that is not right-handed proves nothing.
    """
    try:
        anus, liver, spleen = (np.array(landmarks[name]) for name in ("anus", "HF", "SF"))
    except KeyError:
        return None
    letters = ["", "", ""]
    axes = []
    for way, pair in ((0.5 * (liver + spleen) - anus, "SI"), (liver - spleen, "RL")):
        axis = int(np.abs(way).argmax())
        others = np.delete(np.abs(way), axis)
        if abs(way[axis]) < UPRIGHT * others.max() or letters[axis]:
            return None
        letters[axis] = pair[0] if way[axis] > 0 else pair[1]
        axes.append(np.eye(3)[axis] * math.copysign(1.0, way[axis]))
    front = np.cross(axes[0], axes[1])  # head x right
    axis = int(np.abs(front).argmax())
    if float(front @ (anus - 0.5 * (liver + spleen))) >= 0.0:
        return None
    letters[axis] = "A" if front[axis] > 0 else "P"
    return "".join(letters)
