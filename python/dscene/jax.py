"""Expressions of a script as differentiable functions of JAX. JAX is not a dependency of the package: this module needs it.

>>> def loss(corners, step):                                                    # doctest: +SKIP
...     image = dscene.jax.render(s, "render(eye)", {"corners": corners}, seed=step)
...     return jnp.mean((image - target) ** 2)
>>> gradient = jax.jit(jax.grad(loss))(corners, 0)                              # doctest: +SKIP
"""

from __future__ import annotations

import functools
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._rotations import slopes
from ._script import Script, Vjp

__all__ = ["render"]


class _Asked:
    """An expression of a script, called from compiled programs.

    The graph of a value is kept from its computation to that of its derivative, which otherwise would compute it again.
    """

    KEPT = 4

    def __init__(self, script: Script, expression: str, names: tuple[str, ...]) -> None:
        self.script, self.expression, self.names = script, expression, names
        self.shape = script.shape(expression)
        self._kept: OrderedDict[bytes, tuple[Any, Vjp]] = OrderedDict()

    def ask(self, seed: Any, grad_seed: Any, *numbers: Any) -> tuple[Any, Vjp]:
        values = {name: np.asarray(one, np.float64) for name, one in zip(self.names, numbers)}
        key = b"".join([np.asarray(seed).tobytes(), np.asarray(grad_seed).tobytes(), *(v.tobytes() for v in values.values())])
        kept = self._kept.pop(key, None)
        if kept is None:
            kept = self.script.vjp(
                self.expression, values, wrt=self.names, seed=int(seed), grad_seed=int(grad_seed)
            )
        self._kept[key] = kept
        while len(self._kept) > self.KEPT:
            self._kept.popitem(last=False)
        return kept

    def value(self, dtype: Any, *asked: Any) -> np.ndarray:
        return np.asarray(self.ask(*asked)[0], dtype)

    def pulled(self, dtypes: tuple[Any, ...], adjoint: Any, *asked: Any) -> tuple[np.ndarray, ...]:
        values = dict(zip(self.names, (np.asarray(one, np.float64) for one in asked[2:])))
        found = slopes(self.ask(*asked)[1](np.asarray(adjoint, np.float64)), values)
        return tuple(np.asarray(found[name], dtype) for name, dtype in zip(self.names, dtypes))


@functools.lru_cache(maxsize=64)
def _asked(script: Script, expression: str, names: tuple[str, ...]) -> _Asked:
    return _Asked(script, expression, names)


@functools.partial(jax.custom_vjp, nondiff_argnums=(0,))
def _render(asked: _Asked, seed: Any, grad_seed: Any, *params: Any) -> Any:
    dtype = _dtype(params)
    shape = jax.ShapeDtypeStruct(asked.shape, dtype)
    call = functools.partial(asked.value, dtype)
    return jax.pure_callback(call, shape, seed, grad_seed, *params, vmap_method="sequential")


def _forward(asked: _Asked, seed: Any, grad_seed: Any, *params: Any) -> tuple[Any, Any]:
    return _render(asked, seed, grad_seed, *params), (seed, grad_seed, params)


def _backward(asked: _Asked, kept: Any, adjoint: Any) -> tuple[Any, ...]:
    seed, grad_seed, params = kept
    dtypes = tuple(p.dtype for p in params)
    shapes = tuple(jax.ShapeDtypeStruct(p.shape, p.dtype) for p in params)
    call = functools.partial(asked.pulled, dtypes)
    found = jax.pure_callback(call, shapes, adjoint, seed, grad_seed, *params, vmap_method="sequential")
    # Seeds are whole numbers, whose tangents have a type of their own.
    none = [np.zeros(np.shape(one), jax.dtypes.float0) for one in (seed, grad_seed)]
    return (*none, *found)


_render.defvjp(_forward, _backward)


def _dtype(params: tuple[Any, ...]) -> Any:
    floating = [p.dtype for p in params if jnp.issubdtype(p.dtype, jnp.floating)]
    return jnp.result_type(*floating) if floating else jnp.result_type(float)


def render(
    script: Script,
    expression: str,
    params: Mapping[str, Any],
    *,
    seed: Any = None,
    grad_seed: Any = None,
) -> jax.Array:
    """The value of an expression made of numbers, such as ``"render(eye)"``, as an array that can be differentiated by ``params``.

    It works under ``jit``, ``grad``, ``vjp`` and ``vmap`` (one after the other). The seeds may be traced: ``seed`` chooses the samples
    of the value, so give each step of an optimisation its own. The derivative draws samples that the value has not, from the same seed or
    from ``grad_seed``. Gradients by a rotation matrix ``R`` are along rotations, ``½ [g]× R``.
    """
    names = tuple(params)
    asked = _asked(script, expression, names)
    seed = jnp.asarray(script.seed if seed is None else seed)
    grad_seed = seed if grad_seed is None else jnp.asarray(grad_seed)
    arrays = [jnp.asarray(value) for value in params.values()]
    numbers = [a if jnp.issubdtype(a.dtype, jnp.floating) else a.astype(jnp.result_type(float)) for a in arrays]
    return _render(asked, seed, grad_seed, *numbers)
