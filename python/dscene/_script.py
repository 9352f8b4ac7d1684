"""Scripts: values of expressions, and their derivatives."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from . import _native
from ._diagnostics import Diagnostic, warn
from ._session import Optimized, Progress, RunReport, Step, Steps
from ._values import Gradients, Params, _array, _arrays

__all__ = ["Script", "Vjp", "check", "load", "parse"]

Values = Mapping[str, Any]
"""Numbers by the names of params (``"corners"``) and of fields (``"lamp.radiance"``): anything that NumPy makes an array of."""


def load(
    path: str | os.PathLike[str], overrides: Mapping[str, Any] | None = None, *, seed: int = 0
) -> Script:
    """Reads and checks a script.

    ``overrides`` replace values of declarations, as ``--set`` does: a string is an expression of the language (``"45deg"``), anything else
    is written as one. ``seed`` is ``--seed``: all that is drawn at random follows from it. What is wrong raises :class:`Error`; what the
    checker warns of is warned of.
    """
    script = _native.Script(os.fspath(path), None, None, _overrides(overrides), seed)
    return Script._of(script, os.fspath(path))


def parse(
    text: str,
    overrides: Mapping[str, Any] | None = None,
    *,
    seed: int = 0,
    folder: str | os.PathLike[str] | None = None,
) -> Script:
    """Checks a text, as :func:`load` does with a file. Files that it imports and reads are looked for in ``folder``."""
    base = None if folder is None else os.fspath(folder)
    return Script._of(_native.Script(None, text, base, _overrides(overrides), seed), "<text>")


def check(
    path: str | os.PathLike[str] | None = None,
    *,
    text: str | None = None,
    overrides: Mapping[str, Any] | None = None,
    folder: str | os.PathLike[str] | None = None,
) -> list[Diagnostic]:
    """All errors and warnings of a file or a text, without running anything: ``dsl check``."""
    if (path is None) == (text is None):
        raise TypeError("give a path or a text")
    file = None if path is None else os.fspath(path)
    base = None if folder is None else os.fspath(folder)
    return _native.check(file, text, base, _overrides(overrides))


class Vjp:
    """The derivative of a value that was computed, in reverse mode: call it with the adjoint of the value."""

    def __init__(self, linear: _native.Linear) -> None:
        self._linear = linear

    def __call__(self, adjoint: Any = 1.0) -> dict[str, np.ndarray]:
        """The derivatives of ``sum(adjoint * value)``, by name.

        The adjoint has the value's shape, or is spread to it. It may be called as often as you like, and after params have moved.
        """
        return self._linear.pull_back(np.array(np.broadcast_to(_array(adjoint), self._linear.shape), order="C"))

    @property
    def names(self) -> list[str]:
        """What it differentiates by."""
        return self._linear.names


class Script:
    """A checked script with its engine. Made by :func:`load` and :func:`parse`.

    Questions may be asked from any thread; one is answered at a time, by all processors, without Python's lock. Ctrl-C ends them. Each
    question says at which params it is asked; those that it does not name are where the script, or :attr:`params`, puts them. What depends
    on no param that moved (target images, files) is computed once.

    ``seed`` chooses the samples. Without one they are those that the command line draws: ``s.eval(e)`` is ``dsl eval``, ``s.vjp(e)`` and
    ``s.grad(e)`` are ``dsl grad``, to the bit. A step of an optimisation wants samples of its own: ``seed=step``.
    """

    def __init__(self) -> None:
        raise TypeError("scripts are made by dscene.load and dscene.parse")

    _script: _native.Script
    name: str

    @classmethod
    def _of(cls, script: _native.Script, name: str) -> Script:
        made = cls.__new__(cls)
        made._script, made.name = script, name
        for diagnostic in script.check():
            warn(diagnostic)
        return made

    def __repr__(self) -> str:
        return f"<dscene.Script {self.name}: {len(self.params)} params, losses {self.losses}>"

    @property
    def params(self) -> Params:
        """The params by name: arrays with unit, bounds and documentation; to be set, too."""
        return Params(self._script)

    @property
    def losses(self) -> list[str]:
        """The names of the losses that the script declares."""
        return self._script.losses

    @property
    def seed(self) -> int:
        return self._script.seed

    def check(self) -> list[Diagnostic]:
        """What the checker warned of; ``str`` of each is what the command line prints. (What is wrong was raised by ``load``.)"""
        return self._script.check()

    def shape(self, expression: str) -> tuple[int, ...]:
        """The shape of an expression made of numbers, evaluated only if its type does not tell."""
        found = self._script.shape(expression)
        return tuple(found) if found is not None else np.shape(self.eval(expression))

    def eval(self, expression: str, params: Values | None = None, *, seed: int | None = None) -> Any:
        """The value of an expression.

        A number is a float, an image an :class:`Image`, other numbers are arrays (angles in radians); arrays of the engine are not copied
        and cannot be written. Records are dictionaries, lists lists, meshes dictionaries of arrays; what has no numbers of its own, such as a
        camera, is described by dictionaries as in ``dsl eval --json``.
        """
        return self._script.eval(expression, _arrays(params), seed)

    def vjp(
        self,
        expression: str,
        params: Values | None = None,
        *,
        wrt: Iterable[str] | None = None,
        seed: int | None = None,
        grad_seed: int | None = None,
    ) -> tuple[Any, Vjp]:
        """The value of an expression made of numbers, and its derivative in reverse mode, for a loss of your own::

            image, vjp = s.vjp("render(eye)", {"corners": a}, seed=step)
            gradient = vjp(2 * (image - target) / image.size)["corners"]

        It is by the names in ``wrt``; else by those that ``params`` gives; else by every param that reaches the expression.

        Value and derivative never share samples, even of one ``seed``: a loss's gradient is as unbiased as its adjoint. ``grad_seed`` draws
        the derivative's samples from another seed, so that several derivatives of one value are independent of one another.

        The derivative by a rotation has 3 numbers: by ω in ``exp([ω]×) R`` at ω = 0.
        """
        names = _wrt(wrt, params)
        linear = self._script.linear(expression, _arrays(params), names, seed, grad_seed)
        return linear.value, Vjp(linear)

    def jvp(
        self,
        expression: str,
        params: Values | None = None,
        tangents: Values | None = None,
        *,
        seed: int | None = None,
        grad_seed: int | None = None,
    ) -> tuple[Any, Any]:
        """The value of an expression, and its derivative as what ``tangents`` names moves along them, in forward mode."""
        tangents = _arrays(tangents)
        if not tangents:
            raise ValueError("tangents say what moves, and where to")
        linear = self._script.linear(expression, _arrays(params), list(tangents), seed, grad_seed)
        return linear.value, linear.push_forward([tangents[name] for name in linear.names])

    def jacobian(
        self,
        expression: str,
        params: Values | None = None,
        *,
        wrt: Iterable[str] | None = None,
        seed: int | None = None,
        grad_seed: int | None = None,
    ) -> dict[str, np.ndarray]:
        """All derivatives of an expression, by name: the shape of the value followed by that of the param."""
        names = _wrt(wrt, params)
        return self._script.linear(expression, _arrays(params), names, seed, grad_seed).jacobian()

    def fd(
        self,
        expression: str,
        params: Values | None = None,
        *,
        wrt: Iterable[str] | None = None,
        step: float = 1e-2,
        seed: int | None = None,
    ) -> dict[str, np.ndarray]:
        """Central finite differences, by name, to hold derivatives against. Both sides draw the same samples.

        Their shapes are those of :meth:`jacobian`: the value's followed by the param's.
        """
        return self._script.differences(expression, _arrays(params), _wrt(wrt, params), step, seed)

    def grad(
        self,
        of: str | None = None,
        params: Values | None = None,
        *,
        wrt: Iterable[str] | None = None,
        repeats: int = 16,
        seed: int | None = None,
        fd: bool = False,
        fd_step: float = 1e-2,
        warm: bool = False,
    ) -> Gradients:
        """The gradient of a scalar, by default the first loss, over ``repeats`` independent samples, with standard errors: ``dsl grad``.

        ``fd`` puts finite differences beside it. ``warm`` keeps learnt sampling tables from repeat to repeat, as an optimisation does from step
        to step.
        """
        if of is None:
            if not self.losses:
                raise ValueError("the script declares no loss: say what to differentiate")
            of = self.losses[0]
        if repeats < 1:
            raise ValueError("repeats are at least 1")
        names = _wrt(wrt, params)
        step = fd_step if fd else None
        return Gradients(self._script.measure(of, _arrays(params), names, repeats, seed, step, warm))


    def steps(
        self, name: str | None = None, *, steps: int | None = None, out: str | os.PathLike[str] | None = None
    ) -> Steps:
        """The steps of an ``optimize`` of the script, by the name of its loss (by default the only one)::

            for step in s.steps("fit"):
                if step.done % 10 == 0:
                    display(s.eval("render(eye)"))

        They begin where :attr:`params` are, and leave them where they are found. ``steps`` replaces the script's number; ``out`` is the
        folder into which ``every`` blocks save.
        """
        folder = None if out is None else os.fspath(out)
        return Steps(self._script, self._script.begin(name, steps, folder))

    def optimize(
        self,
        name: str | None = None,
        *,
        steps: int | None = None,
        callback: Callable[[Step], Any] | None = None,
        out: str | os.PathLike[str] | None = None,
    ) -> Optimized:
        """Takes all steps of an ``optimize`` of the script, and calls ``callback`` after each: if it returns something true, that was enough.

        See :meth:`steps`, which gives them one by one. Afterwards :attr:`params` are where they were found.
        """
        taken = self.steps(name, steps=steps, out=out)
        for step in taken:
            if callback is not None and callback(step):
                break
        return taken.finish()

    def run(
        self,
        *,
        out: str | os.PathLike[str] | None = None,
        force: bool = False,
        steps: int | None = None,
        callback: Callable[[Progress], Any] | None = None,
    ) -> RunReport:
        """Does all that the script says to do, in order, in a run folder: ``dsl run``, with the same bytes.

        The folder is ``out``, or a new one below ``runs``; ``force`` takes one with files in it. What the script prints is printed; remarks
        (saved files, skipped steps) go to the logger ``dscene``. ``callback`` is told of each step of an optimisation; if it returns something
        true, the run ends there. It cannot ask the script, which is in the middle of its run: :meth:`steps` can be asked in between.
        """
        folder = None if out is None else os.fspath(out)
        return RunReport._of(self._script.run(folder, force, steps, callback))


def _wrt(wrt: Iterable[str] | None, params: Values | None) -> list[str]:
    if isinstance(wrt, str):
        return [wrt]
    return list(wrt) if wrt is not None else list(params or ())


def _overrides(overrides: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    return [(name, _literal(value)) for name, value in (overrides or {}).items()]


def _literal(value: Any) -> str:
    """A value as the language writes it; a string is one already."""
    if isinstance(value, str):
        return value
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (list, tuple, np.ndarray)) and np.ndim(value) > 0:
        return "[" + ", ".join(_literal(item) for item in value) + "]"
    number = float(value)
    if not np.isfinite(number):
        raise ValueError("the language has no infinite numbers")
    return repr(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


