"""``%load_ext dscene``: cells that are scripts."""

from __future__ import annotations

import argparse
import html
import shlex
import sys
import time
from typing import Any

from ._diagnostics import Error
from ._script import Script, parse
from ._session import Step

__all__ = ["register"]

# Seconds between two looks at an optimisation.
_LOOK = 0.2

_USAGE = "%%%%dscene [NAME] [--seed N] [--set NAME=EXPR] [--optimize LOSS] [--steps N]"


class _Wrong(Exception):
    pass


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> Any:
        raise _Wrong(f"{message}\nusage: {self.usage}".replace("%%", "%"))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="%%dscene", usage=_USAGE, add_help=False)
    parser.add_argument("name", nargs="?", default="s")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=EXPR")
    parser.add_argument("--optimize", metavar="LOSS")
    parser.add_argument("--steps", type=int)
    return parser


def register(shell: Any) -> None:
    """Makes the cell magic known to an IPython shell."""

    def dscene(line: str, cell: str) -> Any:
        """The cell is a script: %%dscene [NAME] [--seed N] [--set NAME=EXPR] [--optimize LOSS] [--steps N]

        NAME (by default `s`) is the script afterwards. --optimize takes the steps of an `optimize`, and shows how it gets on.
        """
        try:
            asked = _parser().parse_args(shlex.split(line))
            overrides = dict(_parted(one) for one in asked.set)
            script = parse(cell, overrides, seed=asked.seed)
            shell.user_ns[asked.name] = script
            return _optimized(script, asked.optimize, asked.steps) if asked.optimize else script.params
        except (Error, _Wrong) as error:
            # The mistake is in the cell: a trace through Python's functions says nothing about it.
            print(str(error).lstrip("\n"), file=sys.stderr)
            return None

    shell.register_magic_function(dscene, magic_kind="cell", magic_name="dscene")
    # IPython brings Pygments.
    from ._highlight import color_cells

    color_cells(shell)


def _parted(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise _Wrong(f"--set {text}: write NAME=EXPR")
    return name.strip(), value.strip()


class _Live:
    """A line that an optimisation keeps up to date."""

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html, self._looked = HTML, time.monotonic()
        self._handle = display(HTML(""), display_id=True)

    def __call__(self, step: Step) -> None:
        now = time.monotonic()
        if now - self._looked < _LOOK and step.done < step.total:
            return
        self._looked = now
        told = f"{html.escape(step.name)}: step {step.done} of {step.total}, loss {step.loss:.4g}"
        bar = f'<progress value="{step.done}" max="{step.total}"></progress> {told}'
        if self._handle is not None:
            self._handle.update(self._html(bar))


def _optimized(script: Script, loss: str, steps: int | None) -> Any:
    return script.optimize(loss, steps=steps, callback=_Live())
