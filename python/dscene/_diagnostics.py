"""What is wrong with a script: diagnostics as objects, errors, warnings."""

from __future__ import annotations

import json
import sys
import warnings
from dataclasses import dataclass
from types import FrameType

__all__ = ["Diagnostic", "Error", "Label", "ScriptWarning"]


@dataclass(frozen=True)
class Label:
    """A place in a script, and what there is to say about it. Lines and columns count from 1."""

    file: str
    line: int
    column: int
    end_line: int
    end_column: int
    text: str


@dataclass(frozen=True)
class Diagnostic:
    """One thing that can be acted upon. ``str`` of it is what the command line prints."""

    code: str
    """Stable, such as ``dscene::type::mismatch``: ``dsl explain CODE`` says more."""
    severity: str
    """``"error"`` or ``"warning"``."""
    message: str
    labels: tuple[Label, ...]
    """The first one is where it is wrong."""
    helps: tuple[str, ...]
    """What to write instead."""
    text: str
    """As the command line prints it."""

    @property
    def is_error(self) -> bool:
        return self.severity == "error"

    def __str__(self) -> str:
        return self.text

    @staticmethod
    def _of(encoded: str, text: str) -> Diagnostic:
        told = json.loads(encoded)
        labels = tuple(
            Label(
                label["file"],
                label["start"]["line"],
                label["start"]["column"],
                label["end"]["line"],
                label["end"]["column"],
                label["text"],
            )
            for label in told["labels"]
        )
        return Diagnostic(
            told["code"], told["severity"], told["message"], labels, tuple(told["help"]), text
        )


class Error(Exception):
    """A script that is wrong, or an evaluation that failed. ``str`` of it is what the command line prints."""

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        super().__init__(diagnostics)
        self.diagnostics: tuple[Diagnostic, ...] = tuple(diagnostics)
        """What was told, in the order of the script; at least one."""

    @property
    def code(self) -> str:
        """That of the first diagnostic."""
        return self.diagnostics[0].code if self.diagnostics else ""

    def __str__(self) -> str:
        # A snippet begins below the line that names the exception.
        return "\n" + "\n\n".join(str(one) for one in self.diagnostics)


class ScriptWarning(UserWarning):
    """What the checker or an evaluation warns of. ``warnings.simplefilter`` treats it as any other warning."""

    def __init__(self, diagnostic: Diagnostic) -> None:
        super().__init__("\n" + str(diagnostic))
        self.diagnostic = diagnostic


def warn(diagnostic: Diagnostic) -> None:
    """Warns where the program called the package."""
    level = 1
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] == "dscene":
        level, frame = level + 1, frame.f_back
    warnings.warn(ScriptWarning(diagnostic), stacklevel=level + 1)
