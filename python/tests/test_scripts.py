"""Scripts, their params, values and what is wrong with them."""

from __future__ import annotations

import gc
import warnings
from pathlib import Path

import numpy as np
import pytest

import dscene


def test_values_are_what_numpy_has_for_them() -> None:
    s = dscene.parse("param x = [1, 2, 3]\nlet m = [[1, 2], [3, 4]]\nlet r = { a: 1, b: [true, false] }")
    assert s.eval("sum(x)") == 6.0
    assert isinstance(s.eval("sum(x)"), float)
    assert s.eval("m").tolist() == [[1, 2], [3, 4]]
    assert s.eval("r") == {"a": 1.0, "b": [True, False]}
    assert s.eval('"{1 + 1}"') == "2"
    assert s.eval("90deg") == pytest.approx(np.pi / 2)
    cube = s.eval("cube()")
    assert cube["vertices"].shape[1] == 3
    assert cube["faces"].max() < len(cube["vertices"])
    assert s.eval("image([[[1, 2, 3]], [[4, 5, 6]]])").shape == (2, 1, 3)


def test_arrays_of_the_engine_are_shared_and_not_written() -> None:
    s = dscene.parse("let m = [[1, 2], [3, 4]]")
    one, other = s.eval("m"), s.eval("m")
    assert np.shares_memory(one, other)
    with pytest.raises(ValueError):
        one[0, 0] = 5
    # The numbers live as long as anybody looks at them.
    del s, other
    gc.collect()
    assert one.tolist() == [[1, 2], [3, 4]]


def test_params_tell_what_the_script_says(shadow: dscene.Script) -> None:
    assert list(shadow.params) == ["corners", "glow", "turn"]
    corners, glow, turn = shadow.params.values()
    assert corners.shape == (4, 3)
    assert corners.doc == "Four corners of a plate."
    assert (corners.type, corners.unit, corners.bounds) == ("vec3[4]", None, None)
    assert glow.bounds is not None
    assert (glow.bounds[0], glow.bounds[1]) == (0, 100)
    assert (turn.unit, turn.kind) == ("rad", "angle")
    assert float(turn) == pytest.approx(np.radians(10))
    # What is computed from a param is an array as any other.
    assert type(corners * 2) is np.ndarray
    assert isinstance(corners.sum(), float)
    # A copy is of the same param, and a part of one in the same unit.
    copied = corners.copy()
    assert (copied.name, copied.type, copied.doc) == ("corners", "vec3[4]", corners.doc)
    assert (turn.copy().unit, turn.reshape(1).unit) == ("rad", "rad")
    assert "corners" in copied._repr_html_() and "<pre>" in corners[0]._repr_html_()


def test_values_of_a_question_are_gone_with_it() -> None:
    s = dscene.parse("param x = 2\nparam y = 3\nlight lamp = point(position: [0, 1, 0], intensity: 1)")
    assert s.eval("x * y", {"x": 10}) == 30
    assert s.eval("x * y", {"y": 10}) == 20
    assert s.eval("x * y") == 6
    assert s.eval("mean(lamp.intensity) * x", {"lamp.intensity": [4, 4, 4], "x": 1}) == 4
    assert s.eval("mean(lamp.intensity) * x") == 2
    s.params["x"] = 5
    s.params["lamp.intensity"] = [2, 2, 2]
    assert s.eval("x * y * mean(lamp.intensity)") == 30
    assert s.eval("x * y", {"x": 1}) == 3
    assert s.eval("x * y * mean(lamp.intensity)") == 30
    assert float(s.params["x"]) == 5
    s.params.reset()
    assert s.eval("x * y * mean(lamp.intensity)") == 6


def test_answers_do_not_depend_on_what_was_asked_before(shadow: dscene.Script) -> None:
    first = shadow.eval("render(eye, spp: 4)", seed=1)
    shadow.eval("mean(render(eye, spp: 4))", {"glow": 3}, seed=2)
    shadow.vjp("render(eye, spp: 4) * 2", seed=3)[1]()
    assert np.array_equal(first, shadow.eval("render(eye, spp: 4)", seed=1))
    assert np.array_equal(first, dscene.parse(shadow_text(shadow)).eval("render(eye, spp: 4)", seed=1))
    assert not np.array_equal(first, shadow.eval("render(eye, spp: 4)", seed=2))


def shadow_text(_: dscene.Script) -> str:
    from conftest import SHADOW

    return SHADOW


def test_overrides_are_expressions_or_numbers(shadow_file: Path) -> None:
    s = dscene.load(shadow_file, {"glow": 3, "turn": "90deg", "corners": np.ones((4, 3)) * 1e-7})
    assert float(s.params["glow"]) == 3
    assert float(s.params["turn"]) == pytest.approx(np.pi / 2)
    assert s.params["corners"].tolist() == [[1e-7] * 3] * 4


def test_what_is_wrong_is_raised_as_the_terminal_prints_it(tmp_path: Path) -> None:
    path = tmp_path / "wrong.dscene"
    path.write_text("let a = 1\nlet b = aa + 1\n")
    with pytest.raises(dscene.Error) as raised:
        dscene.load(path)
    (told,) = raised.value.diagnostics
    assert told.is_error
    assert told.code == raised.value.code == "dscene::name::unknown"
    assert (told.labels[0].line, told.labels[0].column) == (2, 9)
    assert "let b = aa + 1" in str(raised.value)
    assert str(told) in str(raised.value)
    assert [d.code for d in dscene.check(path)] == ["dscene::name::unknown"]
    assert dscene.check(text="let a = 1\nprint a") == []


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(dscene.Error, match="there is no such file") as raised:
        dscene.load("nowhere.dscene")
    assert raised.value.code == "dscene::file::unreadable"


@pytest.mark.parametrize(
    ("ask", "code"),
    [
        (lambda s: s.eval("no_such"), "dscene::name::unknown"),
        (lambda s: s.eval("1 +"), "dscene::syntax::unexpected"),
        (lambda s: s.eval("let y = 2"), "dscene::cli::expression"),
        (lambda s: s.eval("x", {"x": [1, 2]}), "dscene::run::value"),
        (lambda s: s.eval("x", {"x": float("nan")}), "dscene::run::value"),
        (lambda s: s.eval("x", {"z": 1}), "dscene::name::unknown"),
        (lambda s: s.eval("r @ [1, 2, 3]", {"r": np.ones((3, 3))}), "dscene::run::value"),
        (lambda s: s.vjp("eye")[1](), "dscene::run::gradient"),
        (lambda s: s.fd("x", step=-1), "dscene::run::out_of_range"),
        (lambda s: s.grad("[x, x]"), "dscene::run::gradient"),
        (lambda s: s.jvp("x", {}, {"x": [1, 2]}), "dscene::run::shape"),
    ],
)
def test_questions_that_have_no_answer(ask: object, code: str) -> None:
    s = dscene.parse(
        "param x = 1\nparam v = [1, 2]\nparam r: rotation = euler(y: 20deg)\n"
        "camera eye { position: [0, 0, 0], look_at: [0, 0, 1], fov: 45deg, film: [4, 4] }"
    )
    with pytest.raises(dscene.Error) as raised:
        ask(s)  # type: ignore[operator]
    assert raised.value.code == code, str(raised.value)
    # The script goes on as if it had not been asked.
    assert s.eval("x") == 1


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "one"])
def test_seeds_are_whole_numbers(seed: object) -> None:
    s = dscene.parse("param x = 1\nloss l = x ^ 2")
    for ask in (
        lambda: dscene.parse("let a = 1", seed=seed),  # type: ignore[arg-type]
        lambda: s.eval("x", seed=seed),  # type: ignore[arg-type]
        lambda: s.vjp("x", seed=seed),  # type: ignore[arg-type]
        lambda: s.vjp("x", grad_seed=seed),  # type: ignore[arg-type]
        lambda: s.grad("l", seed=seed),  # type: ignore[arg-type]
    ):
        with pytest.raises(ValueError, match=r"a seed is a whole number from 0 to 2\*\*64 - 1, not"):
            ask()
    assert s.eval("x", seed=np.int64(3)) == 1


def test_warnings_are_python_warnings() -> None:
    text = "param x = 1\nparam unused_here = 2\nloss l = x ^ 2\noptimize l { steps: 3, over: [x] }"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        s = dscene.parse(text)
    told = s.check()
    assert [w.message.diagnostic for w in caught if isinstance(w.message, dscene.ScriptWarning)] == told
    assert all(w.filename == __file__ for w in caught)


def test_numbers_of_every_kind_are_taken() -> None:
    s = dscene.parse("param m = [[1, 2], [3, 4], [5, 6]]")
    numbers = np.arange(6, dtype=np.float32).reshape(2, 3).T
    assert s.eval("m", {"m": numbers}).tolist() == numbers.tolist()
    assert s.eval("m", {"m": [[1, 2], [3, 4], [5, 7]]})[2, 1] == 7
    assert s.eval("m", {"m": np.arange(12.0).reshape(6, 2)[::2]}).tolist() == [[0, 1], [4, 5], [8, 9]]


def test_shapes_are_told_without_rendering(shadow: dscene.Script) -> None:
    assert shadow.shape("render(eye, spp: 1000000)") == (12, 16, 3)
    assert shadow.shape("fit") == ()
    assert shadow.shape("corners") == (4, 3)
