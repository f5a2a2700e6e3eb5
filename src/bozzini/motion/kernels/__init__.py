"""Compiled kernels of motions: scalars and arrays, no Python objects."""
