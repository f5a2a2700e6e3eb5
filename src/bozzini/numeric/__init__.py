"""Numerics that several packages share."""
