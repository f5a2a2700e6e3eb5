"""Compiled numerics that the kernels of all packages share."""
