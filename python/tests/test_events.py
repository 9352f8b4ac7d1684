"""What runs leave for TensorBoard, read by TensorBoard itself."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

# Two optimisations, whose steps TensorBoard counts together.
OPTIMIZATIONS = """
optimize fit { using: adam(lr: 0.02), steps: 3 }
loss size = mean(corners ^ 2)
optimize size { using: sgd(lr: 0.1), steps: 2 }
"""


def curves(line: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """What a line of the log says, by the names of TensorBoard's curves."""
    of = line["of"]
    for name in ("loss", "lr", "grad_norm", "skipped_steps", "samples", "seconds", "spp"):
        if name in line:
            yield f"{name}/{of}", line[name]
    yield "bytes", line["bytes"]
    for name, gradient in line["gradients"].items():
        yield f"gradient/{name}", gradient["norm"]
        if gradient["error"] is not None:
            yield f"gradient_error/{name}", gradient["error"]
    for name, value in line["params"].items():
        for at, number in np.ndenumerate(value):
            yield f"param/{name}" + "".join(f"[{i}]" for i in at), number


def test_tensorboard_reads_what_the_log_holds(dsl: str, shadow_file: Path, optional: Callable[[str], Any]) -> None:
    reader = optional("tensorboard.backend.event_processing.event_accumulator")
    shadow_file.write_text(shadow_file.read_text() + OPTIMIZATIONS)
    run = shadow_file.parent / "run"
    subprocess.run([dsl, "run", str(shadow_file), "--out", str(run), "--tensorboard"], check=True, capture_output=True)
    lines = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert [line["of"] for line in lines] == ["fit"] * 3 + ["size"] * 2

    # It looks for the file in the run folder, as `tensorboard --logdir` does; 0 is for all of the events.
    events = reader.EventAccumulator(str(run), size_guidance={reader.SCALARS: 0}).Reload()
    expected: dict[str, list[tuple[int, float]]] = {}
    for step, line in enumerate(lines):
        for tag, number in curves(line):
            expected.setdefault(tag, []).append((step, float(np.float32(number))))
    assert {"loss/fit", "loss/size", "param/corners[3][2]", "param/turn", "gradient_error/glow"} <= set(expected)
    tags = events.Tags()
    assert set(tags.pop("scalars")) == set(expected)
    assert not any(tags.values()), "curves are all that it holds"
    for tag, numbers in expected.items():
        assert [(event.step, event.value) for event in events.Scalars(tag)] == numbers, tag
    assert all(event.wall_time > 1.6e9 for event in events.Scalars("bytes")), "seconds since 1970"
