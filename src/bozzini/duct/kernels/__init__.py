"""Compiled kernels of ducts: scalars and arrays, no Python objects."""
