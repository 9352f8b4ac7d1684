#!/usr/bin/env python3
"""The same experiment in Mitsuba's Python and in dscene's, side by side: `pose_mitsuba.py` and `pose_dscene.py`.

    pip install ./python mitsuba torch          (and a libLLVM, version 17 or newer: apt-get install libllvm19)
    python3 docs/peers/pose.py                  (a quarter of an hour; prints Markdown)

Both programs run in turns, each time in a process of its own. Seconds count from the start of the process; those in brackets are CPU
seconds of all its threads, which other programs on the machine disturb less. Mitsuba keeps the kernels that it compiled on disk, so it is run twice:
with none kept (in a home folder that is new), and with those that the first run left there.

The gradients are by one adjoint image, that of the loss at the start, without noise: so both programs estimate the same three numbers, and
noise and bias are those of the derivative of the picture alone. Central differences of both programs' pictures are held against them.
"""

import argparse
import ast
import difflib
import importlib
import io
import json
import math
import os
import resource
import site
import statistics
import subprocess
import sys
import tempfile
import time
import tokenize
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mitsuba_efficiency import llvm

HERE = Path(__file__).parent
NEAR, TURNED = 0.02, 3.0  # How near the truth is near: in the place, and in degrees.
SEEDS = 16
Job = dict[str, Any]


# ---- in a process of its own ---------------------------------------------------------------------------------------


def settings(job: Job) -> dict[str, Any]:
    """What to build otherwise than the script does."""
    changed: dict[str, Any] = {"height": job.get("height", 0.42)}
    bounces = job.get("bounces", 2)
    if job["program"] == "dscene":
        return changed | {"bounces": bounces}
    import mitsuba as mi

    unguided = {"type": "prb_projective", "max_depth": bounces + 1, "guiding": "none"}
    match job.get("way", "script"):
        case "script":
            changed["integrator"] = unguided
        case "direct":
            changed["integrator"] = {"type": "direct_projective", "guiding": "none"}
        case "octree":
            # As it comes, an octree takes 512 paths a pixel and 256 probes a leaf for each gradient, some ten CPU seconds. These are
            # attributes of the integrator that its documentation does not have.
            changed["integrator"] = mi.load_dict({"type": "prb_projective", "max_depth": bounces + 1})
            changed["integrator"].proj_seed_spp = 4
            changed["integrator"].octree_extra_leaf_sample = 16
        case "corners":
            changed["integrator"] = unguided
            changed["block"] = welded()
    return changed


def welded() -> Any:
    """The block with 8 corners instead of the 24 of `cube`, so that faces share their edges."""
    import mitsuba as mi

    import pose_mitsuba

    properties = mi.Properties()
    properties["face_normals"] = True
    properties["bsdf"] = mi.load_dict(pose_mitsuba.BLOCK["bsdf"])
    mesh = mi.Mesh("block", 8, 12, props=properties)
    corners = [(x, y, z) for x in (-0.6, 0.6) for y in (-0.4, 0.4) for z in (-0.25, 0.25)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    params = mi.traverse(mesh)
    params["vertex_positions"] = [number for corner in corners for number in corner]
    params["faces"] = [corner for a, b, c, d in sides for corner in (a, b, c, a, c, d)]
    params.update()
    return mesh


def cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def run(job: Job) -> dict[str, Any]:
    """The experiment: when what was done, and the pose after each step."""
    marks, poses = [], []

    def told(place: Any, turn: Any) -> None:
        marks.append((time.time() - job["started"], cpu()))
        poses.append((*place.tolist(), turn.item()))

    program = importlib.import_module("pose_" + job["program"])
    render = program.build(**settings(job))
    built = time.time() - job["started"], cpu()
    program.fit(render, told, job["seed"], job.get("spp", 16))
    (x, z), turn = program.TRUTH[0].tolist(), program.TRUTH[1].item()
    errors = [(math.dist(pose[:2], (x, z)), abs(math.degrees(pose[2] - turn))) for pose in poses]
    return {"built": built, "marks": marks, "errors": errors}


def alone(job: Job) -> dict[str, Any]:
    """PyTorch without a renderer: both programs begin with it, and its optimisers bring half of it when the first is made."""
    import torch

    torch.optim.Adam([torch.zeros(1, requires_grad=True)])
    return {"begun": (time.time() - job["started"], cpu())}


def gradient(job: Job) -> dict[str, Any]:
    """The first gradient by many seeds, and central differences; what a picture costs; how far the photograph is from dscene's."""
    import numpy as np
    import torch

    program = importlib.import_module("pose_" + job["program"])
    render = program.build(**settings(job))
    folder = Path(job["folder"])
    with torch.no_grad():
        photo, first = (sum(render(*pose, 1024, 10**6 + k) for k in range(4)) / 4 for pose in (program.TRUTH, program.START))
    noise, begun = [], cpu()
    with torch.no_grad():
        for seed in range(SEEDS):
            noise.append((render(*program.START, 16, 1 + seed) - first).square().mean().item())
    told: dict[str, Any] = {"picture": (cpu() - begun) / SEEDS, "noise": (math.sqrt(statistics.mean(noise)) / first.mean()).item()}
    if job["program"] == "dscene" and not (folder / "adjoint.npy").exists():
        first.requires_grad_()
        program.distance(first, photo).backward()
        np.save(folder / "adjoint.npy", first.grad)
        np.save(folder / "photo.npy", photo)
    adjoint, other = (torch.from_numpy(np.load(folder / name)) for name in ("adjoint.npy", "photo.npy"))
    told |= {"apart": ((photo - other).abs().mean() / other.mean()).item(), "mean": (photo.mean() / other.mean() - 1).item()}

    found, begun = [], cpu()
    for seed in range(-1, job.get("seeds", SEEDS)):
        if seed == 0:  # The one before has compiled what is to be compiled.
            begun = cpu()
        place, turn = (start.clone().requires_grad_() for start in program.START)
        render(place, turn, job.get("spp", 16), 1 + seed).backward(adjoint)
        found.append((*place.grad.tolist(), turn.grad.item()))
    told |= {"gradients": found[1:], "cpu": (cpu() - begun) / len(found[1:])}
    if job.get("differences"):
        told["differences"] = [differences(render, program.START, adjoint, 2 * 10**6 + seed) for seed in range(SEEDS)]
    return told


def differences(render: Any, start: Any, adjoint: Any, seed: int, step: float = 0.005) -> list[float]:
    """Central differences of `sum(adjoint * picture)`, both sides with the same samples."""
    import torch

    found = []
    with torch.no_grad():
        for move in torch.eye(3) * step:
            sides = [render(start[0] + sign * move[:2], start[1] + sign * move[2], 1024, seed) for sign in (1, -1)]
            found.append(((sides[0] - sides[1]).double() * adjoint).sum().item() / (2 * step))
    return found


# ---- from outside --------------------------------------------------------------------------------------------------


def ask(what: str, home: str | None = None, **job: Any) -> dict[str, Any]:
    """Has a new process do one of the above."""
    environment = {"DRJIT_LIBLLVM_PATH": llvm(), "PYTHONUSERBASE": site.getuserbase()} | os.environ
    if home is not None:
        environment["HOME"] = home
    job["started"] = time.time()
    command = [sys.executable, __file__, "--worker", what, json.dumps(job)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        sys.exit(f"{job}\n{done.stderr}")
    # What Mitsuba's logger writes to set colours comes before it.
    found: dict[str, Any] = json.loads(done.stdout[done.stdout.index("{") :])
    print(what, job, f"{time.time() - job['started']:.0f} s", file=sys.stderr, flush=True)
    return found


def code(name: str) -> list[str]:
    """The lines of a script that are neither empty nor comment nor docstring."""
    text = (HERE / name).read_text()
    told = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)]
    skipped = {line for node in told for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    kinds = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    tokens = [token for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type not in kinds]
    used = {line for token in tokens for line in range(token.start[0], token.end[0] + 1)} - skipped
    lines = text.splitlines()
    return [lines[line - 1] for line in sorted(used) if lines[line - 1].strip()]


def arrived(run: dict[str, Any]) -> int | None:
    """The step from which on the pose stays near the truth."""
    outside = [step for step, (place, turn) in enumerate(run["errors"], 1) if place >= NEAR or turn >= TURNED]
    step = outside[-1] + 1 if outside else 1
    return step if step <= len(run["errors"]) else None


def middle(pairs: list[tuple[float, float]]) -> str:
    """The medians of wall and CPU seconds."""
    return "{:.2f} ({:.2f})".format(*(statistics.median(values) for values in zip(*pairs)))


def columns(runs: dict[str, list[dict[str, Any]]], all_rows: bool) -> None:
    """A table of runs, a column for each way."""

    def row(title: str, cell: Callable[[list[dict[str, Any]]], str]) -> None:
        print(f"| {title} |", " | ".join(cell(several) for several in runs.values()), "|")

    def reached(run: dict[str, Any], clock: int) -> str | None:
        step = arrived(run)
        return None if step is None else f"{run['marks'][step - 1][clock]:.1f}"

    def each(values: list[Any]) -> str:
        return ", ".join("never" if value is None else f"{value}" for value in values)

    def later(run: dict[str, Any]) -> tuple[float, float]:
        (a, b), (c, d) = run["marks"][4], run["marks"][-1]
        return (c - a) / (len(run["marks"]) - 5), (d - b) / (len(run["marks"]) - 5)

    print("| |", " | ".join(runs), "|")
    print("| --- |" + " ---: |" * len(runs))
    if all_rows:
        row("import and build, seconds", lambda several: middle([run["built"] for run in several]))
        row("first gradient after, seconds", lambda several: middle([run["marks"][0] for run in several]))
    row("a step afterwards, seconds", lambda several: middle([later(run) for run in several]))
    row(f"steps until within {NEAR} and {TURNED:.0f}°, for good", lambda several: each([arrived(run) for run in several]))
    row("seconds until then", lambda several: each([reached(run, 0) for run in several]))
    row("CPU seconds until then", lambda several: each([reached(run, 1) for run in several]))
    row("place is off by, at the end", lambda several: each([f"{run['errors'][-1][0]:.4f}" for run in several]))
    row("turn is off by, at the end", lambda several: each([f"{run['errors'][-1][1]:.2f}°" for run in several]))
    print()


def estimates(label: str, found: list[list[float]], seconds: float | None) -> None:
    """A row: means with standard errors, CPU seconds of one."""
    cells = []
    for values in zip(*found):
        error = statistics.stdev(values) / math.sqrt(len(values))
        cells.append(f"{statistics.mean(values):.4f} ± {error:.4f}")
    print(f"| {label} |", " | ".join(cells), "|", "" if seconds is None else f"{seconds:.2f}", "|")


def compared(title: str, ways: dict[str, Job], **scene: Any) -> None:
    """A table of first gradients in one scene."""
    print(f"\n{title}\n\n| | by x | by z | by the turn | CPU s |\n| --- | --- | --- | --- | ---: |")
    pictures = {}
    with tempfile.TemporaryDirectory() as folder:
        for label, way in ways.items():
            told = ask("gradient", folder=folder, **scene, **way)
            if "differences" in told:
                estimates(f"differences, {label}", told["differences"], None)
                pictures[label] = told
            estimates(label, told["gradients"], told["cpu"])
    print()
    for label, told in pictures.items():
        print(f"{label}: a picture of 16 samples a pixel takes {told['picture']:.3f} CPU s, its noise is {100 * told['noise']:.1f} % of its mean.")
    print(f"Photographs of 4096 samples a pixel differ by {100 * told['apart']:.2f} % in the mean, their means by {100 * told['mean']:.2f} %.")


def main() -> None:
    parser = argparse.ArgumentParser(formatter_class=argparse.RawDescriptionHelpFormatter, description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--worker", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        what, job = args.worker
        print(json.dumps({"run": run, "gradient": gradient, "alone": alone}[what](json.loads(job))))
        return

    print(f"{time.strftime('%Y-%m-%d')}, {os.cpu_count()} cores,", ", ".join(f"{p} {version(p)}" for p in ("dscene", "mitsuba", "drjit", "torch")))
    ours, theirs = code("pose_dscene.py"), code("pose_mitsuba.py")
    same = sum(block.size for block in difflib.SequenceMatcher(None, ours, theirs, autojunk=False).get_matching_blocks())
    print(f"\nLines of code: dscene {len(ours)}, Mitsuba {len(theirs)}, of which {same} are the same.\n")

    runs: dict[str, list[dict[str, Any]]] = {"dscene": [], "Mitsuba, nothing compiled": [], "Mitsuba, kernels kept": []}
    for seed in range(1, args.repeats + 1):
        runs["dscene"].append(ask("run", program="dscene", seed=seed))
        with tempfile.TemporaryDirectory() as home:
            for label in ("Mitsuba, nothing compiled", "Mitsuba, kernels kept"):
                runs[label].append(ask("run", home, program="mitsuba", seed=seed))
    columns(runs, True)
    begun = middle([ask("alone")["begun"] for _ in range(args.repeats)])
    print(f"Of the seconds to the first gradient PyTorch takes {begun}: its import and the first optimiser.")

    mitsuba: Job = {"program": "mitsuba"}
    ours_too: dict[str, Job] = {
        "dscene": {"program": "dscene", "differences": True},
        "Mitsuba": mitsuba | {"differences": True},
    }
    compared(
        "Two bounces",
        ours_too
        | {
            "Mitsuba, 64 samples a pixel": mitsuba | {"spp": 64},
            "Mitsuba, guided by an octree": mitsuba | {"way": "octree"},
            "Mitsuba, 64, a mesh of 8 corners": mitsuba | {"spp": 64, "way": "corners"},
        },
    )
    compared("One bounce", ours_too | {"Mitsuba, `direct_projective`": mitsuba | {"way": "direct"}}, bounces=1)
    more = {"Mitsuba, 64 samples a pixel": mitsuba | {"spp": 64}}
    compared("Two bounces, the block touches the table", ours_too | more, height=0.4)

    print("\nRuns with other settings\n")
    ways: dict[str, Job] = {
        "Mitsuba, a mesh of 8 corners": mitsuba | {"way": "corners"},
        "dscene, touching": {"program": "dscene", "height": 0.4},
        "Mitsuba, touching": mitsuba | {"height": 0.4},
        "Mitsuba, touching, 64 samples": mitsuba | {"height": 0.4, "spp": 64},
    }
    runs = {label: [] for label in ways}
    for seed in range(1, args.repeats + 1):
        for label, way in ways.items():
            runs[label].append(ask("run", **way, seed=seed))
    columns(runs, False)


if __name__ == "__main__":
    main()
