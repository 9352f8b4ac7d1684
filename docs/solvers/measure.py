"""How long solvers take to the same error: seconds of all steps until `error` of a script stays below a limit.

    cargo build --release && python3 docs/solvers/measure.py target/release/dsl [SCRIPT…] [--seed N] >docs/solvers/table.md

Each script is run as it is, and with `adam` and `lbfgs` in place of its solver: `adam` at several rates, of which the best counts. The seconds
are those of `log.jsonl`, on one thread: steps, without targets and pictures. `texture` and `sky` are run with and without the preconditioner of
their params, at the same rates. `blob` is the mesh of example 17 with its preconditioner and without, on two threads: all steps are taken, and what
counts is how far from the true shape they end.
"""
import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).parent
RELIEF = HERE.parent.parent / "examples" / "19_relief_from_shading.dscene"
# By script: the error to be reached, rates of adam, and the first step of lbfgs.
CASES = {
    RELIEF: (0.0006, [0.03, 0.1, 0.3], 0.3),
    HERE / "pose.dscene": (0.03, [0.01, 0.03, 0.1], 0.1),
    HERE / "camera.dscene": (0.05, [0.01, 0.03, 0.1], 0.1),
    HERE / "light.dscene": (0.05, [0.01, 0.03, 0.1], 0.1),
    HERE / "material.dscene": (0.05, [0.01, 0.03, 0.1], 0.05),
}

# By script of a grid: errors to be reached, and rates of adam.
GRIDS = {
    HERE / "texture.dscene": ([0.03, 0.0225, 0.0175], [0.005, 0.01, 0.02, 0.05]),
    HERE / "sky.dscene": ([0.3, 0.22, 0.19], [0.01, 0.03, 0.1]),
}

BLOB = HERE.parent.parent / "examples" / "17_ball_to_blob.dscene"
# Rates of `adam_uniform` with the preconditioner of the mesh's points, and without.
SMOOTH = ["cosine(0.1, 0.002)", "linear(0.06, 0.003)"]
PLAIN = ["cosine(0.1, 0.002)", "linear(0.06, 0.003)", "cosine(0.02, 0.002)"]


def errors_and_seconds(dsl, text, using, steps):
    """The error before each step, and the seconds that all steps before have taken."""
    if using:
        text = re.sub(r"using: .*", f"using: {using}", text)
        text = re.sub(r"steps: \d+", f"steps: {steps}", text)
    text = re.sub(r"(steps: \d+)", r'\1\n  every 1 { save error to "error/{step}.json" }', text)
    text = re.sub(r"expect .*", "", text)
    with tempfile.TemporaryDirectory() as folder:
        script = pathlib.Path(folder) / "script.dscene"
        script.write_text(text)
        run = pathlib.Path(folder) / "run"
        asked = ["--out", run, "--quiet", "--threads", "1", "--seed", SEED]
        subprocess.run([dsl, "run", script, *asked], check=True, stdout=sys.stderr)
        seconds, found = 0.0, []
        for line in map(json.loads, (run / "log.jsonl").read_text().splitlines()):
            error = json.loads((run / "error" / f"{line['step']}.json").read_text())
            found.append((error, seconds))
            seconds += line["seconds"]
    return found


def reached(found, limit):
    """Steps and seconds from which on the error is below the limit in three steps, or to the end."""
    for step in range(len(found)):
        if all(error < limit for error, _ in found[step : step + 3]):
            return step, found[step][1]
    return None


def row(dsl, script, limit, rates, first):
    text = script.read_text()
    least = reached(errors_and_seconds(dsl, text, None, 0), limit)
    quasi = reached(errors_and_seconds(dsl, text, f"lbfgs(first: {first})", 40), limit)
    tries = [(reached(errors_and_seconds(dsl, text, f"adam(lr: {lr})", 300), limit), lr) for lr in rates]
    tries = [(found, lr) for found, lr in tries if found]
    best, lr = min(tries, key=lambda t: t[0][1]) if tries else (None, None)
    show = lambda found: f"{found[0]}, {found[1]:.1f} s" if found else "not reached"
    ratio = f"{least[1] / best[1]:.2f}" if least and best else "–"
    name = script.stem.split("_", 1)[1].replace("_", " ") if script == RELIEF else script.stem
    rate = f" (`lr: {lr}`)" if best else ""
    print(f"| {name} | {limit} | {show(least)} | {show(quasi)} | {show(best)}{rate} | {ratio} |", flush=True)


def fewest(dsl, text, rates, limits):
    """For each limit, the fewest steps to it and their rate; a preconditioner that is there counts."""
    runs = [(errors_and_seconds(dsl, re.sub(r"lr: [0-9.]+", f"lr: {lr}", text), None, 0), lr) for lr in rates]
    for limit in limits:
        tries = [(reached(found, limit), lr) for found, lr in runs]
        tries = [(found[0], lr) for found, lr in tries if found]
        yield min(tries) if tries else None


def grid_rows(dsl, script, limits, rates):
    text = script.read_text()
    plain = re.sub(r"\s*\{\s*precondition: [^}]*\}", "", text)
    assert plain != text
    show = lambda found: f"{found[0]} (`lr: {found[1]}`)" if found else "not reached"
    for limit, some, many in zip(limits, fewest(dsl, text, rates, limits), fewest(dsl, plain, rates, limits)):
        ratio = f"{some[0] / many[0]:.2f}" if some and many else "–"
        print(f"| {script.stem} | {limit} | {show(some)} | {show(many)} | {ratio} |", flush=True)


def chamfer_and_seconds(dsl, text, seed):
    """The chamfer distance that a run of the blob prints at its end, and the seconds of its steps."""
    with tempfile.TemporaryDirectory() as folder:
        script = pathlib.Path(folder) / "script.dscene"
        script.write_text(text)
        run = pathlib.Path(folder) / "run"
        asked = ["--out", run, "--quiet", "--threads", "2", "--seed", str(seed)]
        told = subprocess.run([dsl, "run", script, *asked], check=True, stdout=subprocess.PIPE, text=True).stdout
        seconds = sum(json.loads(line)["seconds"] for line in (run / "log.jsonl").read_text().splitlines())
        return float(re.search(r"chamfer distance ([0-9.e-]+)", told)[1]), seconds


def blob_rows(dsl):
    """A row for each rate, with the preconditioner and without, and the distances of two seeds in it."""
    text = re.sub(r"expect .*", "", BLOB.read_text())
    smooth = re.search(r"precondition: (\w+\(.*?\))", text)[1]
    plain = re.sub(r"\s*\{\s*precondition: [^}]*\}", "", text)
    assert plain != text
    for what, text, rates in [(f"`precondition: {smooth}`", text, SMOOTH), ("without", plain, PLAIN)]:
        for rate in rates:
            tried = re.sub(r"lr: \w+\(.*?\)", f"lr: {rate}", text)
            runs = [chamfer_and_seconds(dsl, tried, seed) for seed in (0, 1)]
            far, long = (", ".join(f"{run[at]:.{digits}f}" for run in runs) for at, digits in ((0, 5), (1, 1)))
            print(f"| {what} | `{rate}` | {far} | {long} |", flush=True)


def main():
    is_wanted = lambda script: not WANTED or any(name in script.name for name in WANTED)
    print("| problem | error | `levenberg_marquardt` | `lbfgs` | `adam` | LM's seconds over Adam's |\n|---|--:|--:|--:|--:|--:|")
    for script, (limit, rates, first) in CASES.items():
        if is_wanted(script):
            row(DSL, script, limit, rates, first)
    print("\n| grid | error | with `pyramid()` | without | steps with over steps without |\n|---|--:|--:|--:|--:|")
    for script, (limits, rates) in GRIDS.items():
        if is_wanted(script):
            grid_rows(DSL, script, limits, rates)
    print("\n| blob | rate | chamfer distance, seeds 0 and 1 | seconds |\n|---|---|--:|--:|")
    if is_wanted(BLOB):
        blob_rows(DSL)


asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
asked.add_argument("dsl")
asked.add_argument("scripts", nargs="*")
asked.add_argument("--seed", default="0", help="of all problems but the blob, which has two")
asked = asked.parse_args()
DSL, WANTED, SEED = asked.dsl, asked.scripts, asked.seed
main()
