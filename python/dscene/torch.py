"""Expressions of a script as differentiable functions of PyTorch. PyTorch is not a dependency of the package: this module needs it.

>>> image = dscene.torch.render(s, "render(eye)", {"corners": corners}, seed=step)   # doctest: +SKIP
>>> loss = network(image).mean()                                                     # doctest: +SKIP
>>> loss.backward()                                                                  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from ._rotations import slopes
from ._script import Script
from ._values import _array

__all__ = ["render"]


class _Expression(torch.autograd.Function):
    """The value of an expression, whose derivative the engine takes with samples of its own."""

    @staticmethod
    def forward(
        ctx: Any,
        script: Script,
        expression: str,
        names: tuple[str, ...],
        constant: dict[str, np.ndarray],
        seeds: tuple[int | None, int | None],
        *tensors: torch.Tensor,
    ) -> torch.Tensor:
        moving = [name for name, tensor in zip(names, tensors) if tensor.requires_grad]
        values = {name: _numbers(tensor) for name, tensor in zip(names, tensors)}
        seed, grad_seed = seeds
        if moving:
            value, ctx.vjp = script.vjp(expression, constant | values, wrt=moving, seed=seed, grad_seed=grad_seed)
        else:
            # The same samples as if something moved.
            value = script.eval(expression, constant | values, seed=script.seed if seed is None else seed)
        ctx.names, ctx.values, ctx.likes = names, values, [(t.dtype, t.device, t.requires_grad) for t in tensors]
        ctx.save_for_backward(*tensors)
        like = next((t for t in tensors if t.is_floating_point()), torch.empty(()))
        return torch.as_tensor(np.array(value, np.float64), dtype=like.dtype, device=like.device)

    @staticmethod
    def backward(ctx: Any, adjoint: torch.Tensor) -> tuple[Any, ...]:
        found = slopes(ctx.vjp(_numbers(adjoint)), ctx.values)
        gradients = [
            torch.as_tensor(found[name], dtype=dtype, device=device) if moves else None
            for name, (dtype, device, moves) in zip(ctx.names, ctx.likes)
        ]
        # Gradients are calculated with a graph of their own where somebody wants to differentiate them in turn (`create_graph=True`).
        if torch.is_grad_enabled():
            gradients = [None if one is None else _Once.apply(one, adjoint, *ctx.saved_tensors) for one in gradients]
        return (None, None, None, None, None, *gradients)


class _Once(torch.autograd.Function):
    """A gradient that depends on tensors as nobody here can tell: to differentiate it is an error, where a constant would be a wrong answer."""

    @staticmethod
    def forward(ctx: Any, gradient: torch.Tensor, *tensors: torch.Tensor) -> torch.Tensor:
        return gradient.clone()

    @staticmethod
    def backward(ctx: Any, adjoint: torch.Tensor) -> tuple[Any, ...]:
        raise RuntimeError("dscene has first derivatives only: a gradient of dscene.torch.render cannot be differentiated again")


def render(
    script: Script,
    expression: str,
    params: Mapping[str, Any],
    *,
    seed: int | None = None,
    grad_seed: int | None = None,
) -> torch.Tensor:
    """The value of an expression made of numbers, such as ``"render(eye)"``, as a tensor that can be differentiated by ``params``.

    Tensors among the params that require a gradient get one; everything else is a constant. The tensor has the type and the device of the
    first tensor of floating-point numbers among the params; the engine computes on the CPU, positions and sums in double precision.

    ``seed`` chooses the samples of the value: give each step of an optimisation its own, ``seed=step``. The derivative draws samples
    that the value has not, from the same seed or from ``grad_seed``, so that the gradient of any differentiable loss is unbiased but for the
    noise of the image in a loss that is not linear. The gradient by a rotation matrix ``R`` is the one along rotations, ``½ [g]× R``.
    It cannot be differentiated again: that is an error.
    """
    tensors = {name: value for name, value in params.items() if isinstance(value, torch.Tensor)}
    constant = {name: _array(value) for name, value in params.items() if name not in tensors}
    return _Expression.apply(script, expression, tuple(tensors), constant, (seed, grad_seed), *tensors.values())


def _numbers(tensor: torch.Tensor) -> np.ndarray:
    numbers: np.ndarray = tensor.detach().to("cpu", torch.float64).numpy()
    return numbers
