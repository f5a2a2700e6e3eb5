"""Words to choose from, without what they stand for."""

CAMERAS = ("still", "tip")
"""The head's camera on its arm; or one at the end of the holder, which turns with it, as
conventional scopes have it."""

EFFECTORS = ("1", "2", "3")
"""Numbers of a head's end-effectors, of which it may have fewer."""
