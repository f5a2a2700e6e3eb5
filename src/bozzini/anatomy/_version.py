"""Whether a label can be the organ that a version of TotalSegmentator has at its number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .names import VERSIONS, normalise
from .tract import Finding, show_volume

if TYPE_CHECKING:
    from .labels import Runs

VOLUMES_ML = {
    "stomach": (10.0, 6000.0), "esophagus": (5.0, 250.0), "trachea": (8.0, 200.0),
    "small_bowel": (100.0, 6000.0), "duodenum": (15.0, 500.0), "colon": (100.0, 6000.0),
}  # fmt: skip
"""Volume of a whole organ, its wall and what it holds included: wide limits."""

TUBES = ("esophagus", "trachea", "colon")
"""Organs that are long and thin, however they are bent."""

COMPACT_FILL = 0.25
"""Share of the ball over its longest side that a compact body fills; a bent tube fills 0.15."""

COMPACT_RATIO = 2.0
"""Spread along the longest axis, by that along the second, below which a body is compact."""

LEAST_COMPACT_ML = 5.0
"""Volume below which nothing is said of a body's shape: bones are larger."""

VERTEBRA_STEP_MM = (10.0, 50.0)
VERTEBRA_ML = (5.0, 200.0)
VERTEBRA_RATIO = 2.5
"""Distance between neighbouring vertebrae, their volume, and the largest by the smallest."""

LAST_OF_VERSION_1, LAST_OF_VERSION_2 = 104, 117


@dataclass(frozen=True, kw_only=True)
class _Body:
    """What the voxels of one label are like.

    Attributes
    ----------
    label : int
    volume : float
        [mm^3].
    against : str
        What makes it impossible to be the organ, else "".
    doubt : str
        What makes it improbable, else "".
    sides : str
        Of its box [mm].
    """

    label: int
    volume: float
    against: str
    doubt: str
    sides: str

    def __str__(self) -> str:
        return f"label {self.label}, {show_volume(self.volume)} in {self.sides} mm"


def check_version(
    version: str,
    organs: Mapping[int, str],
    *,
    runs: Runs,
    axes: NDArray[np.float64],
    source: str,
) -> list[Finding]:
    """Refuse or doubt a version whose labels cannot be the organs that are asked for.

    Parameters
    ----------
    version : str
        One of `VERSIONS`.
    organs : mapping of int to str
        The organs asked for, by their number in it.
    runs : Runs
        All labels of the file.
    axes : ndarray, shape (4, 4)
        Voxel to world [mm], in the order of the runs' axes.
    source : str

    Raises
    ------
    InputError
        If a label is another body: compact where the organ is a tube, in a column of vertebrae, of
        a file of another version, or of an impossible volume where another version's label fits.
    """
    found = []
    there = set(np.unique(runs.labels).tolist())
    for number, organ in organs.items():
        mine = _judge(version, organ, runs, axes)
        fits = ""
        for other in VERSIONS:
            label = VERSIONS[other][organ]
            body = _judge(other, organ, runs, axes) if label in there - {number} else None
            if body is not None and not body.against and (mine.against or not body.doubt):
                fits = f"{other}:{organ} fits ({body})"
        wrong = mine.against or mine.doubt
        message = f"{version}:{organ} is {mine}: {wrong}"
        if mine.against or (mine.doubt and fits):
            raise InputError(
                f"{message}, so it is no {organ.replace('_', ' ')} in {source}; "
                f"{fits or 'no other version fits'}; to read it all the same, give {number}"
            )
        if mine.doubt:
            found.append(Finding("version-doubtful", "warning", f"{message}; check the version"))
    return found


def name_version(
    labels: Sequence[int | str], *, runs: Runs, axes: NDArray[np.float64]
) -> tuple[Sequence[int | str], list[Finding]]:
    """Return organs as labels of the one version in which all of them can be what they are.

    Labels that are other than names of organs, or that fit no version or two, stay as they are.
    """
    organs = [normalise(str(label)).replace(" ", "_") for label in labels]
    there = set(np.unique(runs.labels).tolist())
    fitting: dict[tuple[int, ...], str] = {}
    shown = ""
    for version, numbers in VERSIONS.items():
        asked = tuple(numbers.get(organ, 0) for organ in organs)
        if not asked or not set(asked) <= there:
            continue
        bodies = [_judge(version, organ, runs, axes) for organ in organs]
        if not any(body.against or body.doubt for body in bodies):
            fitting[asked] = version
            shown = ", ".join(f"{o} is {body}" for o, body in zip(organs, bodies, strict=True))
    if len(fitting) != 1:
        return labels, []
    version = fitting.popitem()[1]
    message = f"the file states no names; taken as {version}, which alone fits: {shown}"
    found = Finding("version-assumed", "warning", message)
    return [f"{version}:{organ}" for organ in organs], [found]


def guess_names(runs: Runs, axes: NDArray[np.float64]) -> dict[int, str]:
    """Return the names that labels have in the one version in which hollow organs can be these.

    It must have two of them at least, such as ``totalsegmentator-v2:colon``; else there are none.
    """
    there = set(np.unique(runs.labels).tolist())
    fitting = []
    for version, numbers in VERSIONS.items():
        organs = [organ for organ, number in numbers.items() if number in there]
        bodies = (_judge(version, organ, runs, axes) for organ in organs)
        if len(organs) > 1 and not any(body.against or body.doubt for body in bodies):
            fitting.append({numbers[organ]: f"{version}:{organ}" for organ in organs})
    return fitting[0] if len(fitting) == 1 else {}


def _judge(version: str, organ: str, runs: Runs, axes: NDArray[np.float64]) -> _Body:
    label = VERSIONS[version][organ]
    index = runs.keep(runs.labels == label).expand()
    voxel = abs(float(np.linalg.det(axes[:3, :3])))
    places = index @ axes[:3, :3].T
    sides = np.ptp(places, axis=0) + np.abs(axes[:3, :3]).sum(axis=1)
    volume = len(index) * voxel
    low, high = VOLUMES_ML[organ]
    cut = bool((index == 0).any() or (index == np.array(runs.shape) - 1).any())
    against = doubt = ""
    if volume > 1000.0 * high or (volume < 1000.0 * low and not cut):
        doubt = f"expected {low:g} to {high:g} mL"
    if organ in TUBES and not cut and _is_compact(places, volume, float(sides.max())):
        against = "a compact body, no tube"
    if _is_vertebra(label, runs, axes, voxel):
        against = f"labels {label - 1} to {label + 1} lie in a row like vertebrae"
    most = int(runs.labels.max())
    if version == "totalsegmentator-v1" and LAST_OF_VERSION_1 < most <= LAST_OF_VERSION_2:
        against = f"the file has label {most}, and version 1 ends at {LAST_OF_VERSION_1}"
    shown = " x ".join(f"{side:.0f}" for side in sides)
    return _Body(label=label, volume=volume, against=against, doubt=doubt, sides=shown)


def _is_compact(places: NDArray[np.float64], volume: float, longest: float) -> bool:
    if volume < 1000.0 * LEAST_COMPACT_ML or volume < COMPACT_FILL * np.pi / 6.0 * longest**3:
        return False
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(places.T)))
    return bool(spread[2] < COMPACT_RATIO * spread[1])


def _is_vertebra(label: int, runs: Runs, axes: NDArray[np.float64], voxel: float) -> bool:
    """Whether a label stands in a row with those before and after it, as vertebrae do."""
    three = np.array([label - 1, label, label + 1])
    sizes = runs.sum_by(runs.labels)
    if label + 1 >= len(sizes) or not sizes[three].all():
        return False
    volumes = sizes[three] * voxel / 1000.0
    steps = np.diff(runs.find_middles(runs.labels)[three] @ axes[:3, :3].T, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    low, high = VERTEBRA_STEP_MM
    return bool(
        VERTEBRA_ML[0] <= volumes.min()
        and volumes.max() <= min(VERTEBRA_ML[1], VERTEBRA_RATIO * volumes.min())
        and low <= lengths.min()
        and lengths.max() <= high
        and steps[0] @ steps[1] > 0.85 * lengths.prod()
    )
