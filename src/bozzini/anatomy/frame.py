"""Where a file's axes point in the patient, and the frame nearest to an affine."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

Matrix = NDArray[np.float64]

_SIDES = ("RL", "AP", "SI")


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
