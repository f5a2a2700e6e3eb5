"""Shapes fitted inside a sampled tract."""
