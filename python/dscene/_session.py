"""Optimisations and runs."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from . import _native
from ._values import Params

__all__ = ["Optimized", "Progress", "RunReport", "Step", "Steps"]


class Progress(NamedTuple):
    """What a run tells after each step of an optimisation."""

    name: str
    """That of the loss, with that of the stage if there is one."""
    done: int
    total: int
    loss: float
    seconds_per_step: float


class Step:
    """A step that an optimisation has taken."""

    def __init__(self, script: _native.Script, name: str, told: tuple[int, int, float]) -> None:
        self._script = script
        self.name: str = name
        self.done, self.total, self.loss = told
        """Steps done, steps in all, and the loss before this step."""

    @property
    def params(self) -> Params:
        """Where the params are after the step."""
        return Params(self._script)

    def __repr__(self) -> str:
        return f"<Step {self.done} of {self.total} of {self.name}: loss {self.loss:.6g}>"


@dataclass(frozen=True)
class Optimized:
    """What became of an optimisation."""

    name: str
    steps: int
    """Steps taken."""
    loss: float | None
    """Where the params are now, over samples that no step has used; ``None`` if it has no value."""
    std_error: float | None
    """Its standard error; 0 if it has no noise."""
    losses: list[float]
    """At every step."""
    skipped_steps: int
    """Steps that moved nothing, because a gradient was not finite."""
    failed: bool
    """It ended before its time, or no step could be taken."""

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    def __str__(self) -> str:
        first = f"from {self.losses[0]:.4g} " if self.losses else ""
        loss = "nothing" if self.loss is None else f"{self.loss:.4g}"
        return f"optimised `{self.name}` {first}to {loss} in {self.steps} steps"


class Steps(Iterator[Step]):
    """The steps of an optimisation, taken as they are asked for.

    Between two of them the script answers questions as ever, at the params so far; that changes nothing of the steps to come.
    """

    def __init__(self, script: _native.Script, steps: _native.Steps) -> None:
        self._script, self._steps = script, steps
        self._name = steps.name or ""
        self._losses: list[float] = []

    def __iter__(self) -> Steps:
        return self

    def __next__(self) -> Step:
        told = self._steps.step()
        if told is None:
            raise StopIteration
        self._losses.append(told[2])
        return Step(self._script, self._name, told)

    def finish(self) -> Optimized:
        """Ends the optimisation, however many of its steps were taken; the params stay where they are."""
        told = self._steps.finish()
        return Optimized(
            told["name"],
            told["steps"],
            told["loss"],
            told["std_error"],
            self._losses,
            told["skipped_steps"],
            told["failed_optimizations"] > 0,
        )


@dataclass(frozen=True)
class RunReport:
    """What became of a run. It is true if all went as the script wants it."""

    folder: Path
    """The run folder, with all that was saved and ``log.jsonl``."""
    page: Path | None
    """The page about the run."""
    success: bool
    interrupted: bool
    steps: int
    skipped_steps: int
    expects: int
    failed_expects: int
    saved: list[Path]
    losses: dict[str, float]
    """By what was optimised: the loss after the last step."""
    reported: dict[str, float]
    """What the script's ``report`` says."""

    @staticmethod
    def _of(told: dict[str, Any]) -> RunReport:
        return RunReport(
            Path(told["folder"]),
            None if told["page"] is None else Path(told["page"]),
            told["success"],
            told["interrupted"],
            told["steps"],
            told["skipped_steps"],
            told["expects"],
            told["failed_expects"],
            [Path(path) for path in told["saved"]],
            dict(told["losses"]),
            dict(told["reported"]),
        )

    def __bool__(self) -> bool:
        return self.success
