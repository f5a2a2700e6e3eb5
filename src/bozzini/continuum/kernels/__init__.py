"""Compiled kernels of continuum robots: scalars and arrays, no Python objects."""
