"""Compiled kernels of voxels and triangles: scalars and arrays, no Python objects."""
