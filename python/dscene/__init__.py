"""dscene: scenes, unknowns and losses in one short script, rendered by a path tracer whose derivatives are unbiased.

>>> import dscene
>>> s = dscene.parse("param x = [1, 2, 3]\\nloss bowl = sum(x ^ 2)")
>>> value, vjp = s.vjp("bowl")
>>> value, vjp()["x"].tolist()
(14.0, [2.0, 4.0, 6.0])
"""

from ._diagnostics import Diagnostic, Error, Label, ScriptWarning
from ._native import __version__, start_threads
from ._script import Script, Vjp, check, load, parse
from ._session import Optimized, Progress, RunReport, Step, Steps
from ._values import Estimate, Gradient, Gradients, Image, Param, Params

__all__ = [
    "Diagnostic",
    "Error",
    "Estimate",
    "Gradient",
    "Gradients",
    "Image",
    "Label",
    "Optimized",
    "Param",
    "Params",
    "Progress",
    "RunReport",
    "Script",
    "ScriptWarning",
    "Step",
    "Steps",
    "Vjp",
    "__version__",
    "check",
    "load",
    "parse",
    "set_threads",
]


def set_threads(threads: int) -> None:
    """How many threads render, for the whole process. To be called before anything is evaluated; by default there are as many as processors.

    What is computed does not depend on it.
    """
    if threads < 1:
        raise ValueError("there is at least one thread")
    if not start_threads(threads):
        raise RuntimeError("threads were started already: set their number before anything is evaluated")


def load_ipython_extension(shell: object) -> None:
    """``%load_ext dscene``: cells that begin with ``%%dscene`` are scripts."""
    from ._notebook import register

    register(shell)
