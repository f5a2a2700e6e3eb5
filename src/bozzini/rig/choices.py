"""Names to choose from, for commands and pages that do not import the rig."""

CONTROLLERS = ("static", "feedforward", "predictive")
"""The controllers of `bozzini.rig.make_controller`."""
