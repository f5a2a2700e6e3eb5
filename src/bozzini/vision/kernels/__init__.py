"""Compiled parts of the vision package."""
