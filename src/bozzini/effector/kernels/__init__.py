"""Compiled kernels of the effector: small, scalar, without Python objects."""
