#!/usr/bin/env python3
"""The pose of a block from one photograph, in Mitsuba 3 and PyTorch. `pose_dscene.py` is the same experiment, `pose.py` compares the two.

    pip install mitsuba torch          (and a libLLVM, version 17 or newer, named by DRJIT_LIBLLVM_PATH)
"""

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import torch
from torch import Tensor

mi.set_variant("llvm_ad_rgb")
T = mi.ScalarTransform4f
Render = Callable[[Tensor, Tensor, int, int], Tensor]

TRUTH = torch.tensor([0.2, -0.1]), torch.tensor(35.0).deg2rad()
START = torch.tensor([-0.4, 0.3]), torch.tensor(5.0).deg2rad()


def diffuse(*reflectance: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(reflectance)}}


# Guided sampling of edges would take four times the work for a third of the noise at best.
INTEGRATOR = {"type": "prb_projective", "max_depth": 3, "guiding": "none"}
BLOCK = {"type": "cube", "to_world": T().scale([0.6, 0.4, 0.25]), "bsdf": diffuse(0.7, 0.15, 0.1)}


def build(integrator: Any = INTEGRATOR, block: Any = BLOCK, height: float = 0.42) -> Render:
    """The picture as a function of the block's pose, the samples a pixel and the seed. `height` is that of the block's middle."""
    sensor = {
        "type": "perspective",
        "fov": 40,
        "fov_axis": "y",
        "to_world": T().look_at(origin=[0, 3, -4], target=[0, 0.2, 0], up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 48, "height": 36, "rfilter": {"type": "box"}},
        # Samples that are spread evenly over a pixel: a sixth of the noise of independent ones.
        "sampler": {"type": "multijitter"},
    }
    lamp = {
        "type": "rectangle",
        "to_world": T().translate([1.5, 4, -1]).rotate([1, 0, 0], 90).scale(0.5),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 20}},
    }
    table = {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(3), "bsdf": diffuse(0.6, 0.4, 0.25)}
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": 0.2}}
    things = {"integrator": integrator, "sensor": sensor, "table": table, "block": block, "lamp": lamp, "sky": sky}
    # Without `optimize=False` shapes are merged, and the block's corners have no name.
    scene = mi.load_dict({"type": "scene"} | things, optimize=False)
    params = mi.traverse(scene)
    x, y, z = torch.tensor(np.array(params["block.vertex_positions"])).reshape(-1, 3).unbind(1)

    @dr.wrap(source="torch", target="drjit")
    def picture(corners: Any, spp: int, seed: int) -> Any:
        params["block.vertex_positions"] = dr.ravel(corners)
        params.update()
        return mi.render(scene, params, spp=spp, seed=seed)

    def render(place: Tensor, turn: Tensor, spp: int, seed: int) -> Tensor:
        c, s = turn.cos(), turn.sin()
        return picture(torch.stack([c * x + s * z + place[0], y + height, c * z - s * x + place[1]], dim=1), spp, seed)

    return render


def distance(image: Tensor, photo: Tensor) -> Tensor:
    return (torch.log(image + 0.05) - torch.log(photo + 0.05)).abs().mean()


def fit(render: Render, told: Callable[[Tensor, Tensor], None], seed: int = 0, spp: int = 16) -> None:
    """Finds the pose, and calls `told` with it after each step."""
    with torch.no_grad():
        photo = render(*TRUTH, 256, 1000 * seed)
    place, turn = (start.clone().requires_grad_() for start in START)
    adam = torch.optim.Adam([place, turn], lr=0.06, betas=(0.9, 0.99))
    rate = torch.optim.lr_scheduler.ExponentialLR(adam, 0.97)
    for step in range(1, 81):
        adam.zero_grad()
        distance(render(place, turn, spp, 1000 * seed + step), photo).backward()
        adam.step()
        rate.step()
        told(place, turn)


if __name__ == "__main__":
    fit(build(), lambda place, turn: print(place.tolist(), turn.rad2deg().item()))
