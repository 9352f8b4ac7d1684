"""Scripts that the tests ask."""

from __future__ import annotations

import importlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dscene

# An occluder between a lamp and a floor: its shadow's edge moves, so that derivatives have boundary terms.
SHADOW = """
/// Four corners of a plate.
param corners: vec3[4] = [[-0.5, 1, -0.5], [-0.5, 1, 0.5], [0.5, 1, -0.5], [0.5, 1, 0.5]]
/// How bright the lamp is.
param glow = 10 in 0..100
param turn: angle = 10deg

camera eye { position: [0, 3, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 12] }
material grey = diffuse(reflectance: 0.5)
shape ground { mesh: rectangle(width: 4, depth: 4), material: grey }
shape blocker { mesh: mesh(vertices: corners, faces: [[0, 1, 2], [1, 3, 2]]) |> rotate(axis: [0, 1, 0], angle: turn), material: grey }
light lamp = area(rectangle(width: 0.5, depth: 0.5) |> flip() |> translate([0, 3, 0]), radiance: glow)

let target = render(eye, spp: 16, max_bounces: 1) with { glow: 12 }
loss fit = mse(render(eye, spp: 16, max_bounces: 1), target)
"""


@pytest.fixture
def shadow() -> dscene.Script:
    return dscene.parse(SHADOW)


@pytest.fixture
def shadow_file(tmp_path: Path) -> Path:
    path = tmp_path / "shadow.dscene"
    path.write_text(SHADOW)
    return path


@pytest.fixture
def dsl() -> str:
    """The command line's program: ``DSL`` in the environment, or the one of a release build."""
    built = Path(__file__).parents[2] / "target" / "release" / "dsl"
    program = os.environ.get("DSL") or (str(built) if built.is_file() else shutil.which("dsl"))
    if program is None:
        pytest.skip("there is no dsl to compare with: DSL=PROGRAM names one")
    return program


@pytest.fixture
def optional() -> Callable[[str], Any]:
    """Imports a module that the package does not need: where it is not installed, the test is left out.

    That must not hide what failed to be installed: ``DSCENE_WITHOUT`` in the environment names the modules that may be missing (``python/ci``
    sets it), and tests of all others then fail.
    """

    def found(name: str) -> Any:
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as missing:
            # What is there but lacks something that it needs itself is broken.
            is_absent = missing.name is not None and f"{name}.".startswith(f"{missing.name}.")
            may_be_absent = os.environ.get("DSCENE_WITHOUT")
            if not is_absent or may_be_absent is not None and name.partition(".")[0] not in may_be_absent.split():
                raise
            pytest.skip(f"{name} is not installed")

    return found
