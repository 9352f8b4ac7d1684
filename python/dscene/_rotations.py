"""Derivatives by rotations, for programs that know nothing but the nine numbers of a matrix."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

__all__ = ["slopes"]


def slopes(found: Mapping[str, np.ndarray], values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Derivatives with the shapes of the values that they are by.

    The engine's derivative g by a rotation R is by ω in ``exp([ω]×) R``. The matrix G that lies along rotations and gives the same change,
    ``<G, [ω]× R> = g · ω`` for all ω, is ``½ [g]× R``, since ``<[a]×, [b]×> = 2 a · b``.
    """
    return {name: slope if slope.shape == values[name].shape else _along(slope, values[name]) for name, slope in found.items()}


def _along(g: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    x, y, z = g
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    along: np.ndarray = 0.5 * cross @ rotation
    return along
