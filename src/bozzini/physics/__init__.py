"""Motions driven in MuJoCo: forces of a plan, of a pushed scope, files for simulators, learning.

Needs the extra ``physics``, but for the options.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
