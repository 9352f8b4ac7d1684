"""What a gradient costs beside the renderer: `vjp` of an image of 64² pixels and three channels that is not rendered, forward and back.

    python python/benches/question.py

Each question is asked many times; the middle of all times is told, and the least, which is what it takes when nothing else has the machine.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

import dscene

TEXT = """
param image = [[[0.5, 0.5, 0.5] for x in 0..64] for y in 0..64]
let doubled = 2 * image
"""


def measure(name: str, question: Callable[[int], object], times: int = 500) -> None:
    """Prints how long a question takes that is asked with one seed after the other."""
    seconds = []
    for seed in range(times):
        begun = time.perf_counter()
        question(seed)
        seconds.append(time.perf_counter() - begun)
    print(f"{name:28} {1e3 * statistics.median(seconds):.3f} ms, at least {1e3 * min(seconds):.3f} ms")


def main() -> None:
    s = dscene.parse(TEXT)
    image = np.random.default_rng(0).random((64, 64, 3))

    def vjp(seed: int) -> object:
        _, back = s.vjp("doubled", {"image": image + seed}, seed=seed)
        return back(image)

    measure("a value", lambda seed: s.eval("doubled", {"image": image + seed}, seed=seed))
    measure("a value and its derivative", vjp)


if __name__ == "__main__":
    main()
