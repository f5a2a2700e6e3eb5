"""Compiled kernels of the muscles: small, scalar, without Python objects."""
