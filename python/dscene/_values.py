"""Values as arrays that know what they are: images, params, gradients."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from . import _native

__all__ = ["Estimate", "Gradient", "Gradients", "Image", "Param", "Params"]


class _Array(np.ndarray):
    """An array whose kind is that of these very numbers: what is computed from it is a plain array."""

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        plain = np.asarray(array)
        return plain[()] if return_scalar or plain.ndim == 0 else plain

    def _plain(self) -> np.ndarray:
        return self.view(np.ndarray)


class Image(_Array):
    """Linear radiance, ``[height, width, channels]``, the first row on top. Notebooks show it as a picture.

    The numbers are shared with the engine and cannot be written: ``image.copy()`` can.
    """

    def to_png(self) -> bytes:
        """The image as a PNG: sRGB, clipped to what can be shown."""
        return _native.encode_png(np.asarray(self._plain(), np.float64, order="C"))

    def _repr_png_(self) -> bytes | None:
        is_picture = self.ndim == 3 and self.shape[2] in (1, 3) and self.size > 0
        return self.to_png() if is_picture else None


class Estimate(NamedTuple):
    """What ``estimate(…)`` of a script gives: a mean over independent samples, and its standard error."""

    mean: Any
    std_error: Any
    repeats: int


_TOLD = ("name", "doc", "unit", "bounds", "type", "kind", "frozen")


class Param(_Array):
    """The value of a param, with what the script says of it."""

    name: str
    doc: str
    """The ``///`` lines above it."""
    unit: str | None
    """``"rad"`` for angles."""
    bounds: tuple[np.ndarray, np.ndarray] | None
    """The least and the greatest values, infinite on an open side."""
    type: str
    """As the language writes it: ``vec3[4]``."""
    kind: str
    """``"plain"``, ``"angle"``, or ``"rotation"``: a 3×3 matrix, whose derivatives have 3 numbers (see :meth:`Script.vjp`)."""
    frozen: bool
    """Whether ``optimize`` leaves it where it is."""

    def __array_finalize__(self, whole: Any) -> None:
        # A copy is of the same param; a part of it is in the same unit.
        if isinstance(whole, Param):
            kept = _TOLD if whole.shape == self.shape else ("unit",)
            self.__dict__.update((name, getattr(whole, name)) for name in kept if hasattr(whole, name))

    @staticmethod
    def _of(told: dict[str, Any]) -> Param:
        param: Param = told["value"].view(Param)
        for name in _TOLD:
            setattr(param, name, told[name])
        return param

    def _repr_html_(self) -> str:
        if not hasattr(self, "name"):
            return f"<pre>{html.escape(str(self._plain()))}</pre>"
        return _table(_PARAM_HEAD, [_param_row(self)])


_PARAM_HEAD = ("param", "type", "value", "bounds", "unit", "")


def _param_row(param: Param) -> tuple[str, ...]:
    bounds = "" if param.bounds is None else f"{_short(param.bounds[0])} … {_short(param.bounds[1])}"
    frozen = "frozen. " if param.frozen else ""
    return (param.name, param.type, _short(param), bounds, param.unit or "", frozen + param.doc)


class Params(Mapping[str, Param]):
    """The params of a script by name: arrays with unit, bounds and documentation.

    ``params["corners"] = array`` moves one for all questions that follow; so does it with a field, ``params["lamp.radiance"] = 3``.
    """

    def __init__(self, script: _native.Script) -> None:
        self._script = script

    def _all(self) -> dict[str, Param]:
        return {told["name"]: Param._of(told) for told in self._script.params()}

    def __getitem__(self, name: str) -> Param:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def items(self) -> Any:
        return self._all().items()

    def values(self) -> Any:
        return self._all().values()

    def __setitem__(self, name: str, value: Any) -> None:
        self.update({name: value})

    def update(self, values: Mapping[str, Any]) -> None:
        """Moves several at once."""
        self._script.keep(_arrays(values))

    def reset(self) -> None:
        """All are again what the script says."""
        self._script.reset()

    def __repr__(self) -> str:
        lines = (f"{name}: {param.type} = {_short(param)}" for name, param in self.items())
        return "Params(" + ", ".join(lines) + ")"

    def _repr_html_(self) -> str:
        return _table(_PARAM_HEAD, [_param_row(param) for param in self.values()])


class Gradient(_Array):
    """A derivative of a scalar: the mean over independent samples."""

    std_error: np.ndarray | None
    """Its standard error; ``None`` of a single sample, where none is known."""
    fd: np.ndarray | None
    """Central finite differences beside it, if they were asked for."""
    fd_std_error: np.ndarray | None
    unit: str | None
    """``"1/rad"`` by an angle."""

    @staticmethod
    def _of(told: dict[str, Any], repeats: int) -> Gradient:
        gradient: Gradient = told["mean"].view(Gradient)
        gradient.std_error = told["std_error"] if repeats > 1 else None
        gradient.fd = told.get("fd")
        gradient.fd_std_error = told.get("fd_std_error") if repeats > 1 else None
        gradient.unit = told["unit"]
        return gradient


class Gradients(Mapping[str, Gradient]):
    """The derivatives of a scalar by name, each with its standard error. ``str`` of it is the table of ``dsl grad``."""

    def __init__(self, told: dict[str, Any]) -> None:
        self.value: float = told["value"]
        """The scalar: the mean over the samples."""
        self.repeats: int = told["repeats"]
        self.std_error: float | None = told["std_error"] if self.repeats > 1 else None
        """The standard error of the value."""
        self.seconds: tuple[float, float] = told["seconds"]
        """Mean wall time of one evaluation of the value, and of the value with its derivatives."""
        self._text: str = told["text"]
        self._entries = {name: Gradient._of(one, self.repeats) for name, one in told["params"].items()}

    def __getitem__(self, name: str) -> Gradient:
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return f"<Gradients of {', '.join(self)}: value {self.value:.6g}>"

    def _repr_html_(self) -> str:
        rows: list[tuple[str, ...]] = []
        for name, one in self.items():
            index = np.ndindex(one.shape) if one.size <= _SHOWN else iter(())
            for at in index:
                label = name + "".join(f"[{i}]" for i in at)
                error = "" if one.std_error is None else f"± {one.std_error[at]:.2g}"
                fd = "" if one.fd is None else f"{one.fd[at]:.5g}"
                rows.append((label, f"{one._plain()[at]:.5g}", error, fd, one.unit or ""))
            if one.size > _SHOWN:
                rows.append((name, _short(one), "", "", one.unit or ""))
        error = "" if self.std_error is None else f" ± {self.std_error:.2g}"
        caption = f"value {self.value:.6g}{error}, {self.repeats} repeats"
        return _table(("param", "derivative", "", "differences", "unit"), rows, caption)


_SHOWN = 48


def _short(array: np.ndarray) -> str:
    """The numbers of an array if they are few."""
    plain = np.asarray(array).view(np.ndarray)
    if plain.size > _SHOWN:
        shape = "×".join(str(n) for n in plain.shape)
        return f"{shape} ({plain.min():.4g} … {plain.max():.4g})"
    return np.array2string(plain, precision=4, separator=", ").replace("\n", "")


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]], caption: str = "") -> str:
    def cells(row: tuple[str, ...], tag: str) -> str:
        return "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row)

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    title = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    return f"<table>{title}<thead><tr>{cells(head, 'th')}</tr></thead><tbody>{body}</tbody></table>"


def _array(value: Any) -> np.ndarray:
    """The numbers of anything that NumPy understands, as the engine reads them."""
    # A tensor of PyTorch that requires a gradient is no array; its numbers are one.
    detach = getattr(value, "detach", None)
    numbers = detach().to("cpu") if callable(detach) else value
    return np.asarray(numbers, dtype=np.float64, order="C").view(np.ndarray)


def _arrays(values: Mapping[str, Any] | None) -> dict[str, np.ndarray]:
    return {name: _array(value) for name, value in (values or {}).items()}
