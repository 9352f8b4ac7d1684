"""Optimisations, runs, threads and interruptions."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import dscene

BOWL = """
param x = [3, -2]
loss bowl = sum((x - [1, 2]) ^ 2)
optimize bowl { using: sgd(lr: 0.1), steps: 40 }
print x
expect bowl < 1e-3, "it rolls down"
"""

# Everything that an optimisation has: noise, samples that are found, a schedule, an end by the loss.
GLOW = """
param glow = 2
camera eye { position: [0, 3, -4], look_at: [0, 0, 0], fov: 45deg, film: [24, 24] }
shape ground { mesh: rectangle(width: 4, depth: 4), material: diffuse(reflectance: 0.5) }
light lamp = area(rectangle(width: 1, depth: 1) |> flip() |> translate([0, 3, 0]), radiance: glow)
let target = render(eye, spp: 64) with { glow: 4 }
loss fit = mse(render(eye, spp: 4), target)
optimize fit { using: adam(lr: cosine(0.2, 0.02)), steps: 30 }
save render(eye, spp: 16) to "final.png"
"""


def test_a_step_is_what_the_solver_says() -> None:
    s = dscene.parse(BOWL)
    x = np.array([3.0, -2.0])
    for step in s.steps("bowl", steps=5):
        assert step.loss == pytest.approx(((x - [1, 2]) ** 2).sum())
        x -= 0.1 * 2 * (x - [1, 2])
        assert step.params["x"] == pytest.approx(x)
        assert (step.name, step.total) == ("bowl", 5)
    assert step.done == 5


def test_what_was_found_stays_in_the_params() -> None:
    s = dscene.parse(BOWL)
    seen: list[int] = []
    found = s.optimize(callback=lambda step: seen.append(step.done))
    assert seen == list(range(1, 41))
    assert found.steps == 40
    assert found.loss == pytest.approx(s.eval("bowl"))
    assert len(found.losses) == 40
    assert not found.failed
    assert s.params["x"] == pytest.approx([1, 2], abs=1e-3)
    s.params.reset()
    assert s.params["x"].tolist() == [3, -2]
    assert s.optimize("bowl", callback=lambda step: step.done == 3).steps == 3
    # It goes on from there.
    assert s.optimize("bowl", steps=1).losses[0] < found.losses[3] * 1.001


def test_questions_between_steps_change_nothing_of_them() -> None:
    alone = dscene.parse(GLOW)
    alone.optimize("fit")
    asked = dscene.parse(GLOW)
    for step in asked.steps("fit"):
        asked.eval("render(eye, spp: 2)", {"glow": step.done}, seed=step.done)
        asked.vjp("fit", seed=1, grad_seed=5)[1]()
        assert asked.eval("step") == 0
    assert float(asked.params["glow"]) == float(alone.params["glow"])
    assert abs(alone.params["glow"] - 4) < abs(2 - 4) / 4


def test_a_run_is_that_of_the_command_line(dsl: str, tmp_path: Path) -> None:
    path = tmp_path / "glow.dscene"
    path.write_text(GLOW)
    subprocess.run([dsl, "run", str(path), "--out", str(tmp_path / "theirs"), "--quiet"], check=True)
    told: list[dscene.Progress] = []
    report = dscene.load(path).run(out=tmp_path / "ours", callback=told.append)
    assert report
    assert [one.done for one in told] == list(range(1, 31))
    assert report.saved == [tmp_path / "ours" / "final.png"]
    assert report.page is not None
    assert report.page.is_file()
    for name in ("final.png",):
        assert (tmp_path / "ours" / name).read_bytes() == (tmp_path / "theirs" / name).read_bytes()
    assert report.steps == 30
    assert set(report.losses) == {"fit"}


def test_a_run_prints_and_expects(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert dscene.parse(BOWL).run(out=tmp_path / "run").failed_expects == 0
    assert capsys.readouterr().out.startswith("[1.0002")
    wrong = dscene.parse('param x = 1\nexpect x > 2, "x is {x}"')
    with pytest.warns(dscene.ScriptWarning, match="x is 1"):
        report = wrong.run(out=tmp_path / "wrong")
    assert not report
    assert report.failed_expects == 1
    with pytest.raises(dscene.Error, match="files in it|not empty|--force"):
        wrong.run(out=tmp_path / "wrong")


def test_what_a_callback_raises_ends_the_run(tmp_path: Path) -> None:
    s = dscene.parse(BOWL)

    def ask(_: dscene.Progress) -> None:
        s.eval("bowl")

    with pytest.raises(RuntimeError, match="in the middle of a run"):
        s.run(out=tmp_path / "run", callback=ask)
    # Other scripts can be asked, and this one afterwards.
    other = dscene.parse("let y = 2")
    s.run(out=tmp_path / "other", callback=lambda _: other.eval("y") != 2)
    assert s.eval("bowl") < 1e-3


def test_threads_get_the_answers_that_one_gets(shadow: dscene.Script) -> None:
    def ask(k: int) -> np.ndarray:
        image, vjp = shadow.vjp("render(eye, spp: 4)", {"glow": 5 + k}, wrt=["corners"], seed=k)
        return np.concatenate([np.ravel(image), vjp()["corners"].ravel()])

    expected = [ask(k) for k in range(6)]
    found: dict[int, list[np.ndarray]] = {}

    def work(me: int) -> None:
        found[me] = [ask((me + k) % 6) for k in range(6)]

    threads = [threading.Thread(target=work, args=(me,)) for me in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for me, answers in found.items():
        for k, answer in enumerate(answers):
            assert np.array_equal(answer, expected[(me + k) % 6])


def test_python_goes_on_while_the_engine_works(shadow: dscene.Script) -> None:
    """The interpreter's lock is free: this thread counts while another renders."""
    thread = threading.Thread(target=lambda: shadow.eval("mean(render(eye, spp: 4000))"))
    thread.start()
    counted = 0
    while thread.is_alive():
        counted += 1
        time.sleep(0.001)
    assert counted > 10


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_an_interrupt_is_heard() -> None:
    program = f"""
import dscene, time
s = dscene.parse({GLOW!r})
begun = time.perf_counter()
print("ready", flush=True)
try:
    s.eval("render(eye, spp: 100000000)")
except KeyboardInterrupt:
    # It ended where it was, and the script still answers.
    print(time.perf_counter() - begun < 20, float(s.eval("mean(render(eye, spp: 1))")) > 0)
"""
    child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.5)
    child.send_signal(signal.SIGINT)
    assert child.communicate(timeout=60)[0] == "True True\n"


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_memory_does_not_grow(shadow: dscene.Script) -> None:
    def held() -> int:
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def steps(first: int, count: int) -> None:
        for step in range(first, first + count):
            image, vjp = shadow.vjp("render(eye, spp: 1)", {"glow": 5 + step * 1e-3}, wrt=["glow", "corners"], seed=step)
            vjp(image)

    steps(0, 200)
    before = held()
    steps(200, 1000)
    assert held() - before < 8_000_000
