#!/usr/bin/env python3
"""The pose of a block from one photograph, in dscene and PyTorch. `pose_mitsuba.py` is the same experiment, `pose.py` compares the two.

    pip install ./python torch
"""

from collections.abc import Callable

import dscene
import dscene.torch
import torch
from torch import Tensor

Render = Callable[[Tensor, Tensor, int, int], Tensor]

TRUTH = torch.tensor([0.2, -0.1]), torch.tensor(35.0).deg2rad()
START = torch.tensor([-0.4, 0.3]), torch.tensor(5.0).deg2rad()

SCENE = """
param place: vec2 = [0, 0]
param turn: angle = 0deg
let height = 0.42

camera eye { position: [0, 3, -4], look_at: [0, 0.2, 0], fov: 40deg, film: [48, 36] }
shape table { mesh: rectangle(width: 6, depth: 6), material: diffuse(reflectance: [0.6, 0.4, 0.25]) }
shape block {
  mesh: cube() |> scale([1.2, 0.8, 0.5]) |> rotate(y: turn) |> translate([place.x, height, place.y])
  material: diffuse(reflectance: [0.7, 0.15, 0.1])
}
light lamp = area(rectangle(width: 1, depth: 1) |> flip() |> translate([1.5, 4, -1]), radiance: 20)
light sky = constant(0.2)
"""


def build(bounces: int = 2, height: float = 0.42) -> Render:
    """The picture as a function of the block's pose, the samples a pixel and the seed. `height` is that of the block's middle."""
    script = dscene.parse(SCENE, {"height": height})

    def render(place: Tensor, turn: Tensor, spp: int, seed: int) -> Tensor:
        picture = f"render(eye, spp: {spp}, max_bounces: {bounces})"
        return dscene.torch.render(script, picture, {"place": place, "turn": turn}, seed=seed)

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
