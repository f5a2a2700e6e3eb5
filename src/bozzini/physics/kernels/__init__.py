"""Numba kernels of `bozzini.physics`."""
