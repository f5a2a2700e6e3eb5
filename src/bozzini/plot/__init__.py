"""Pictures of plans, ducts, robots and muscles."""

import sys

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _let_notebooks_show_figures() -> None:
    """Have a notebook show figures that are not pyplot's: else it does so after one of pyplot's."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    if getattr(shell, "kernel", None) is not None:
        from matplotlib import get_backend, pyplot

        pyplot.switch_backend(get_backend())


_let_notebooks_show_figures()
