"""Losses of PyTorch and of JAX, where they are installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dscene

POLYNOMIAL = "param x = [1, 2, 3]\nparam y = 2\nparam r: rotation = euler(y: 20deg)\nlet z = x * y ^ 2\nlet t = r @ x"


class TestTorch:
    @pytest.fixture(autouse=True)
    def torch(self, optional: Callable[[str], Any]) -> object:
        torch = optional("torch")
        import dscene.torch

        self.torch = torch
        return torch

    def test_closed_forms(self) -> None:
        torch, s = self.torch, dscene.parse(POLYNOMIAL)
        x = torch.tensor([1.0, 2.0, 3.0], requires_grad=True)
        y = torch.tensor(3.0, dtype=torch.float64, requires_grad=True)
        z = dscene.torch.render(s, "z", {"x": x, "y": y})
        assert z.dtype == torch.float32
        (z**2).sum().backward()
        assert x.grad.tolist() == pytest.approx((2 * 9 * np.array([9.0, 18, 27])).tolist())
        assert y.grad.item() == pytest.approx((2 * np.array([9.0, 18, 27]) * 6 * [1, 2, 3]).sum())
        assert y.grad.dtype == torch.float64

    def test_gradients_pass_its_own_check(self) -> None:
        torch, s = self.torch, dscene.parse(POLYNOMIAL)
        x = torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64, requires_grad=True)
        y = torch.tensor(3.0, dtype=torch.float64, requires_grad=True)
        assert torch.autograd.gradcheck(lambda x, y: dscene.torch.render(s, "z", {"x": x, "y": y}), (x, y))

    def test_second_derivatives_are_refused(self) -> None:
        torch, s = self.torch, dscene.parse(POLYNOMIAL)
        y = torch.tensor(3.0, dtype=torch.float64, requires_grad=True)
        # The first derivatives are what they are without a graph of their own, whatever adjoint they have.
        linear = dscene.torch.render(s, "z[0]", {"y": y})
        assert torch.autograd.grad(linear, y, create_graph=True)[0].item() == pytest.approx(6)
        for value in (linear, linear**2, linear + y**3):
            (slope,) = torch.autograd.grad(value, y, create_graph=True)
            with pytest.raises(RuntimeError, match="first derivatives only"):
                torch.autograd.grad(slope, y)

    def test_rotations(self) -> None:
        torch, s = self.torch, dscene.parse(POLYNOMIAL)
        matrix = torch.tensor(np.array(s.params["r"]), requires_grad=True)
        g = np.array([0.5, -1, 2])
        turned = dscene.torch.render(s, "t", {"r": matrix})
        turned.backward(torch.tensor(g))
        for omega in np.eye(3):
            cross = np.cross(omega, np.array(s.params["r"]).T).T
            expected = g @ np.cross(omega, turned.detach().numpy())
            assert (matrix.grad.numpy() * cross).sum() == pytest.approx(expected)

    def test_tensors_are_numbers_to_any_question(self) -> None:
        s = dscene.parse(POLYNOMIAL)
        y = self.torch.tensor(3.0, requires_grad=True)
        assert np.array_equal(s.eval("z", {"y": y}), s.eval("z", {"y": 3}))
        s.params.update({"y": y})
        assert float(s.params["y"]) == 3

    def test_a_loss_of_an_image(self, shadow: dscene.Script) -> None:
        torch = self.torch
        corners = torch.tensor(np.array(shadow.params["corners"]), requires_grad=True)
        values = {"corners": corners, "glow": 11}
        image = dscene.torch.render(shadow, "render(eye, spp: 4)", values, seed=1, grad_seed=2)
        torch.log1p(image).mean().backward()
        value, vjp = shadow.vjp(
            "render(eye, spp: 4)", {"corners": corners.detach(), "glow": 11}, wrt=["corners"], seed=1, grad_seed=2
        )
        assert np.array_equal(image.detach().numpy(), value)
        expected = vjp(1 / (1 + np.array(value)) / value.size)["corners"]
        assert corners.grad.numpy() == pytest.approx(expected, rel=1e-12)
        with torch.no_grad():
            again = dscene.torch.render(shadow, "render(eye, spp: 4)", values, seed=1)
        assert torch.equal(again, image)


class TestJax:
    @pytest.fixture(autouse=True)
    def jax(self, optional: Callable[[str], Any]) -> object:
        jax = optional("jax")
        import dscene.jax

        self.jax, self.jnp = jax, jax.numpy
        return jax

    def test_closed_forms(self) -> None:
        s = dscene.parse(POLYNOMIAL)
        jax, jnp = self.jax, self.jnp

        def loss(x: object, y: object) -> object:
            return jnp.sum(dscene.jax.render(s, "z", {"x": x, "y": y}) ** 2)

        for run in (lambda f: f, jax.jit):
            value, (by_x, by_y) = run(jax.value_and_grad(loss, (0, 1)))(jnp.array([1.0, 2, 3]), 3.0)
            assert value == pytest.approx(81 * 14)
            assert by_x == pytest.approx(2 * 9 * np.array([9.0, 18, 27]))
            assert by_y == pytest.approx((2 * np.array([9.0, 18, 27]) * 6 * [1, 2, 3]).sum())

    def test_several_at_once(self) -> None:
        s = dscene.parse(POLYNOMIAL)
        ys = self.jnp.array([1.0, 2.0, 3.0])
        found = self.jax.vmap(self.jax.grad(lambda y: self.jnp.sum(dscene.jax.render(s, "z", {"y": y}))))(ys)
        assert found == pytest.approx(2 * np.array([1, 2, 3]) * 6)

    def test_a_loss_of_an_image(self, shadow: dscene.Script) -> None:
        jnp = self.jnp

        def loss(corners: object, seed: object) -> object:
            image = dscene.jax.render(shadow, "render(eye, spp: 4)", {"corners": corners}, seed=seed)
            return jnp.mean(jnp.log1p(image))

        step = self.jax.jit(self.jax.value_and_grad(loss))
        corners = jnp.asarray(np.array(shadow.params["corners"]))
        for seed in (1, 2):
            value, found = step(corners, seed)
            image, vjp = shadow.vjp("render(eye, spp: 4)", {"corners": corners}, seed=seed)
            assert value == pytest.approx(np.log1p(image).mean(), rel=1e-5)
            expected = vjp(1 / (1 + np.array(image)) / image.size)["corners"]
            assert found == pytest.approx(expected, rel=1e-4, abs=1e-6 * np.abs(expected).max())
