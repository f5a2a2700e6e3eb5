"""Ducts described by shapes: one module a kind."""
