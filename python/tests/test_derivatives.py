"""Derivatives against closed forms, differences, and what the command line prints."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import dscene


def test_closed_forms() -> None:
    s = dscene.parse("param x = [1, 2, 3]\nparam y = 2\nlet z = x * y ^ 2")
    value, vjp = s.vjp("z")
    assert value.tolist() == [4, 8, 12]
    found = vjp([1, 10, 100])
    assert found["x"].tolist() == [4, 40, 400]
    assert found["y"] == 4 * (1 + 20 + 300)
    # The graph stays when params move.
    s.params["y"] = 0
    assert vjp([1, 10, 100])["x"].tolist() == [4, 40, 400]
    s.params.reset()

    value, tangent = s.jvp("z", {"y": 3}, {"x": [1, 0, 0], "y": 1})
    assert value.tolist() == [9, 18, 27]
    assert tangent.tolist() == [9 + 6, 12, 18]
    found = s.jacobian("z")
    assert found["x"].tolist() == (4 * np.eye(3)).tolist()
    assert found["y"].tolist() == [4, 8, 12]
    assert s.jvp("sum(z)", None, {"y": 1}) == (24, 24)


def test_what_is_given_is_what_is_differentiated_by() -> None:
    s = dscene.parse("param x = 1\nparam y = 2\nlight lamp = point(position: [0, 1, 0], intensity: 1)\nlet z = x * y")
    assert set(s.vjp("z")[1]()) == {"x", "y"}
    assert s.vjp("z", {"x": 5})[1]() == {"x": 2}
    assert s.vjp("z", {"x": 5}, wrt=["y"])[1]() == {"y": 5}
    assert s.vjp("sum(lamp.intensity ^ 2)", wrt=["lamp.intensity"])[1]()["lamp.intensity"].tolist() == [2, 2, 2]


def test_rotations_have_three_derivatives() -> None:
    s = dscene.parse("param r: rotation = euler(y: 20deg)\nlet z = r @ [1, 2, 3]")
    matrix = np.array(s.params["r"])
    turned, vjp = s.vjp("z", {"r": matrix.astype(np.float32)})
    # d/dω exp([ω]×) v = ω × v.
    g = np.array([0.5, -1, 2])
    assert vjp(g)["r"] == pytest.approx(np.cross(turned, g), rel=1e-6)
    omega = np.array([0.1, 0.2, 0.3])
    assert s.jvp("z", {"r": matrix}, {"r": omega})[1] == pytest.approx(np.cross(omega, matrix @ [1, 2, 3]))


def test_a_gradient_is_what_the_command_line_prints(dsl: str, shadow_file: Path) -> None:
    for seed in (0, 7):
        command = [dsl, "grad", str(shadow_file), "--json", "--of", "fit", "--seed", str(seed)]
        told = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
        s = dscene.load(shadow_file, seed=seed)
        s.eval("mean(target)")
        value, vjp = s.vjp("fit")
        assert value == told["value"]["mean"]
        for name, found in vjp().items():
            assert found.tolist() == told["wrt"][name]["mean"], name
        assert {name: one.tolist() for name, one in s.grad("fit", repeats=1).items()} == {
            name: one["mean"] for name, one in told["wrt"].items()
        }


def test_measured_gradients_are_what_the_command_line_prints(dsl: str, shadow_file: Path) -> None:
    of = "mean(render(eye, spp: 4))"
    command = [dsl, "grad", str(shadow_file), "--json", "--of", of, "--repeats", "3", "--fd", "--wrt", "glow"]
    told = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    found = dscene.load(shadow_file).grad(of, wrt=["glow"], repeats=3, fd=True)
    assert (found.value, found.std_error) == (told["value"]["mean"], told["value"]["std_error"])
    glow, other = found["glow"], told["wrt"]["glow"]
    assert (float(glow), float(glow.std_error)) == (other["mean"], other["std_error"])
    assert (float(glow.fd), float(glow.fd_std_error)) == (other["fd"]["mean"], other["fd"]["std_error"])


def test_values_are_what_the_command_line_prints(dsl: str, shadow_file: Path) -> None:
    of = "mean(render(eye, spp: 4))"
    command = [dsl, "eval", str(shadow_file), of, "--json", "--seed", "3"]
    told = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert dscene.load(shadow_file, seed=3).eval(of) == told["value"]


def test_the_vjp_of_an_image_is_the_gradient_of_its_sum(shadow: dscene.Script) -> None:
    """By ``glow`` the image is linear: the derivative is known from the image itself."""
    image, vjp = shadow.vjp("render(eye, spp: 64, max_bounces: 1)", {"glow": 10}, seed=1)
    weights = np.linspace(-1, 1, image.size).reshape(image.shape)
    samples = [
        float(shadow.vjp("render(eye, spp: 64, max_bounces: 1)", {"glow": 10}, seed=1, grad_seed=k)[1](weights)["glow"])
        for k in range(12)
    ]
    error = np.std(samples, ddof=1) / np.sqrt(len(samples))
    expected = float((weights * shadow.eval("render(eye, spp: 4096, max_bounces: 1)", {"glow": 10})).sum()) / 10
    assert abs(np.mean(samples) - expected) < 5 * error + 2e-3 * abs(expected)


def test_derivatives_agree_with_differences(shadow: dscene.Script) -> None:
    """Shadows move: boundary terms are in. Both are means over seeds, and differences have an error of their own."""
    of = "mean(render(eye, spp: 64, max_bounces: 1))"
    found = shadow.grad(of, wrt=["corners", "turn", "glow"], repeats=24, fd=True, fd_step=0.03)
    for name, one in found.items():
        error = np.hypot(one.std_error, one.fd_std_error)
        deviation = np.abs(one - one.fd)
        assert (deviation < 5 * error + 0.02 * np.abs(one.fd).max()).all(), f"{name}\n{found}"
    one = shadow.fd(of, wrt=["corners"], step=0.03, seed=3)["corners"]
    assert one.shape == (4, 3)


def test_forward_and_reverse_mode_agree(shadow: dscene.Script) -> None:
    expression = "render(eye, spp: 256, max_bounces: 1)"
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(12, 16, 3))
    direction = rng.normal(size=(4, 3))
    forward, reverse = [], []
    for seed in range(6):
        tangent = shadow.jvp(expression, None, {"corners": direction}, seed=seed)[1]
        forward.append(float((weights * tangent).sum()))
        pulled = shadow.vjp(expression, seed=seed + 100, wrt=["corners"])[1](weights)["corners"]
        reverse.append(float((pulled * direction).sum()))
    error = np.hypot(np.std(forward, ddof=1), np.std(reverse, ddof=1)) / np.sqrt(6)
    assert abs(np.mean(forward) - np.mean(reverse)) < 5 * error


def test_differences_have_the_shape_of_jacobians() -> None:
    s = dscene.parse("param v = [1, 2]\nparam m = [[1, 2, 3], [4, 5, 6]]\nlet z = [v[0] * m[1][2], v[1] ^ 2, sin(v[0] * 1rad)]")
    exact, found = s.jacobian("z"), s.fd("z", wrt=["v", "m"], step=1e-4)
    for name in ("v", "m"):
        assert found[name].shape == exact[name].shape
        np.testing.assert_allclose(found[name], exact[name], atol=1e-6)


def test_jacobians_of_images(shadow: dscene.Script) -> None:
    found = shadow.jacobian("render(eye, spp: 4)", wrt=["glow", "corners"], seed=1)
    assert found["glow"].shape == (12, 16, 3)
    assert found["corners"].shape == (12, 16, 3, 4, 3)
    tangent = shadow.jvp("render(eye, spp: 4)", None, {"glow": 1}, seed=1)[1]
    image = shadow.eval("render(eye, spp: 4096)")
    assert found["glow"].sum() == pytest.approx(image.sum() / 10, rel=0.05)
    assert tangent.sum() == pytest.approx(found["glow"].sum(), rel=0.05)


def test_seeds_choose_the_samples(shadow: dscene.Script) -> None:
    def ask(**seeds: int) -> tuple[np.ndarray, np.ndarray]:
        image, vjp = shadow.vjp("render(eye, spp: 4)", wrt=["corners"], **seeds)
        return np.array(image), vjp()["corners"]

    image, gradient = ask(seed=1)
    again, same = ask(seed=1, grad_seed=1)
    assert np.array_equal(image, again)
    assert np.array_equal(gradient, same)
    again, other = ask(seed=1, grad_seed=2)
    assert np.array_equal(image, again)
    assert not np.array_equal(gradient, other)
    new, _ = ask(seed=2)
    assert not np.array_equal(image, new)
    assert np.array_equal(image, shadow.eval("render(eye, spp: 4)", seed=1))


def test_targets_are_rendered_once() -> None:
    """A question renders its target only the first time, whatever the seeds: it depends on no param that moves."""
    import time

    text = """
    param glow = 1
    camera eye { position: [0, 3, -4], look_at: [0, 0, 0], fov: 45deg, film: [96, 96] }
    shape ground { mesh: rectangle(width: 4, depth: 4), material: diffuse(reflectance: 0.5) }
    light lamp = point(position: [0, 3, 0], intensity: glow)
    let target = render(eye, spp: 2000) with { glow: 2 }
    loss fit = mse(render(eye, spp: 1), target)
    """
    s = dscene.parse(text)
    # The work of the processor, of all threads: the target has 2,000 times the samples of the others.
    begun = time.process_time()
    s.vjp("fit", seed=0)[1]()
    first = time.process_time() - begun
    begun = time.process_time()
    for seed in range(1, 5):
        s.vjp("fit", {"glow": 1 + seed / 10}, seed=seed)[1]()
    assert (time.process_time() - begun) / 4 < first / 3
