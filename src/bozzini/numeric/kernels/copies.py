"""Numba kernels that copy arrays: an array assigned to a slice compiles NumPy's broadcasting."""

from __future__ import annotations

from ..compiling import kernel


@kernel
def copy_vector(source, target):
    """Fill the first entries of `target` with the vector `source`."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@kernel
def copy_matrix(source, target):
    """Fill the first rows and columns of `target` with the matrix `source`."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel
def set_identity(matrix):
    """Fill a matrix with ones on the diagonal and zeros beside it."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 1.0 if i == j else 0.0
