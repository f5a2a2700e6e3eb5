"""Loops of any input and output: laws with memory, fitted side by side and judged by prediction.

Inputs and outputs are in the units of their table. The operators of muscles are in
`bozzini.muscle.hysteresis`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
