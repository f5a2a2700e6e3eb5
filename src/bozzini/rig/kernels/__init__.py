"""Compiled kernels of the rig: scalars and arrays, no Python objects."""
