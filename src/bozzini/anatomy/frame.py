"""Where a file's axes point in the patient, the frame nearest to an affine, two that disagree."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

Matrix = NDArray[np.float64]

_SIDES = {"RL": "left and right", "AP": "front and back", "SI": "head and feet"}


def check_frame(frame: str) -> str:
    """Return the code of a frame in capitals.

    Parameters
    ----------
    frame : str
        Where the world's +x, +y, +z point in the patient, a letter each: one of R (right) or L
        (left), one of A (front) or P (back), one of S (head) or I (feet), in any order: 48 codes.

    Raises
    ------
    InputError
        If it is none of them.
    """
    code = frame.strip().upper() if isinstance(frame, str) else ""
    if len(code) != 3 or any(sum(letter in side for letter in code) != 1 for side in _SIDES):
        raise InputError(
            f"frame is '{frame}': it must be three letters, one of R L, one of A P, one of S I, "
            f"such as RAS or LPS"
        )
    return code


def find_axis(frame: str, side: str) -> NDArray[np.float64]:
    """Return the unit vector in the world that points to a side of the patient.

    Parameters
    ----------
    frame : str
        Where the world's axes point, such as ``"RAS"``; see `check_frame`.
    side : {"R", "L", "A", "P", "S", "I"}
        Right, left, front, back, head or feet.

    Returns
    -------
    ndarray, shape (3,)

    Raises
    ------
    InputError
        If the frame or the side is none of those.
    """
    code = check_frame(frame)
    for pair in _SIDES:
        if side in pair and len(side) == 1:
            at = next(k for k, letter in enumerate(code) if letter in pair)
            return np.asarray(np.eye(3)[at] * (1.0 if code[at] == side else -1.0))
    raise InputError(f"side is '{side}': it must be one of R, L, A, P, S, I")


def convert_frame(affine: Matrix, frame: str, to: str = "RAS") -> Matrix:
    """Return the affine that takes the same voxels to the same places in another world frame.

    Parameters
    ----------
    affine : ndarray, shape (4, 4)
    frame, to : str
        Where the world's axes point before and after; see `check_frame`.
    """
    turn = np.eye(4)
    turn[:3, :3] = np.stack([find_axis(frame, side) for side in check_frame(to)])
    return turn @ affine


def fit_frame(affine: Matrix) -> tuple[Matrix, NDArray[np.float64]]:
    """Return the orthonormal matrix nearest to the voxel axes, and the voxel sizes [mm]."""
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    left, _, right = np.linalg.svd(affine[:3, :3] / spacing)
    return left @ right, spacing


def measure_shift(affine: Matrix, shape: tuple[int, ...]) -> float:
    """Return how far the frame moves any place of a box of voxels, its centre held fixed [mm].

    The move is linear in the place, so it is largest at a corner of the box.
    """
    rotation, spacing = fit_frame(affine)
    change = affine[:3, :3] - rotation * spacing
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * np.array(shape)
    return float(np.linalg.norm(corners @ change.T, axis=1).max())


@dataclass(frozen=True, kw_only=True)
class AffineGap:
    """By how much two affines of the same voxels disagree.

    Parameters
    ----------
    farthest : float
        Largest distance between the two places of a voxel [mm].
    turn : float
        Angle between their axes, mirrored ones taken back first [deg].
    swapped : tuple of str
        Sides that are exchanged, such as ``"left and right"``.
    """

    farthest: float
    turn: float
    swapped: tuple[str, ...]

    def __str__(self) -> str:
        """Return the gap as words."""
        words = [f"by up to {self.farthest:.3g} mm"]
        if self.turn >= 0.05:
            words.append(f"and {self.turn:.3g} degrees")
        text = " ".join(words)
        return f"{text}; {' and '.join(self.swapped)} are swapped" if self.swapped else text


def compare_affines(
    one: Matrix, other: Matrix, shape: tuple[int, ...], *, frame: str | None = None
) -> AffineGap:
    """Measure by how much two affines of a volume disagree.

    Parameters
    ----------
    one, other : ndarray, shape (4, 4)
        Voxel index to world [mm], neither singular.
    shape : tuple of int
        Voxels per axis.
    frame : str, optional
        Where the world's axes point, by which sides are named; without it they are x, y and z.
    """
    corners = np.array(list(itertools.product((0, 1), repeat=3))) * (np.array(shape[:3]) - 1)
    corners = np.column_stack((corners, np.ones(8)))
    farthest = float(np.linalg.norm((corners @ (one - other).T)[:, :3], axis=1).max())
    turn = fit_frame(one)[0] @ fit_frame(other)[0].T
    swapped = [axis for axis in range(3) if turn[axis, axis] < -0.5]
    mirror = np.eye(3)
    if np.linalg.det(turn) < 0.0:  # of a mirror image one axis is taken back
        axis = int(np.argmin(np.diag(turn)))
        mirror[axis, axis] = -1.0
    elif len(swapped) == 2:  # half a turn about an axis is two exchanges
        mirror[swapped, swapped] = -1.0
    cosine = 0.5 * (float(np.trace(turn @ mirror)) - 1.0)
    names: tuple[str, ...] = ("x and -x", "y and -y", "z and -z")
    if frame is not None:
        names = tuple(next(_SIDES[pair] for pair in _SIDES if letter in pair) for letter in frame)
    return AffineGap(
        farthest=farthest,
        turn=math.degrees(math.acos(min(max(cosine, -1.0), 1.0))),
        swapped=tuple(names[axis] for axis in swapped),
    )


def rescale(affine: Matrix, spacing: NDArray[np.float64]) -> Matrix:
    """Return an affine with other voxel sizes [mm] and the same axes and origin."""
    with np.errstate(divide="ignore", invalid="ignore"):  # no axis: whoever uses it refuses
        scale = np.append(spacing / np.linalg.norm(affine[:3, :3], axis=0), 1.0)
        return np.asarray(affine * scale)
