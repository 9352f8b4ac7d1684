#!/usr/bin/env python3
"""Compares what `dsl check --estimate` says of the examples with what `dsl run --timings` measures, and writes the table of
docs/estimates.md. Only examples that are expected to take less than --limit seconds are run.

    cargo build --release && docs/estimates.py
    docs/estimates.py --dsl PROGRAM --limit 120 examples/12_cornell_box.dscene
"""

import argparse
import json
import pathlib
import platform
import resource
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "estimates.md"
BEGIN, END = "<!-- table -->", "<!-- end of the table -->"


def objects(program, *arguments):
    """What the program prints, an object a line; its exit code."""
    done = subprocess.run([program, *arguments], cwd=ROOT, capture_output=True, text=True)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return lines, done


def estimated(program, script):
    lines, done = objects(program, "check", "--estimate", "--json", script)
    found = [line["estimate"] for line in lines if "estimate" in line]
    if not found or done.returncode != 0:
        raise RuntimeError(f"no estimate of {script}: {done.stdout[-500:]}{done.stderr[-500:]}")
    return found[0]


def measured(program, script):
    """Seconds of each action, and the most memory that the process held."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["run", script, "--timings", "--json", "--part", "--out", f"{folder}/run"]
        # A process of its own between this one and the run, so that its children's memory is the run's alone.
        code = (
            "import resource, subprocess, sys\n"
            "done = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)\n"
            "text = done.stdout.read()\n"
            "done.wait()\n"
            "sys.stdout.write(text)\n"
            "print('{\"peak\": %d}' % (1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))\n"
        )
        lines, done = objects(sys.executable, "-c", code, program, *arguments)
        timings = [line for line in lines if line.get("event") == "timings"]
        peak = [line["peak"] for line in lines if "peak" in line]
        if not timings or not peak:
            raise RuntimeError(f"{script} did not run: {done.stdout[-500:]}{done.stderr[-500:]}")
        return timings[0], peak[0]


def seconds(value):
    return f"{value:.2f}" if value < 10 else f"{value:.1f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scripts", nargs="*", help="default: all examples")
    parser.add_argument("--dsl", default=str(ROOT / "target" / "release" / "dsl"))
    parser.add_argument("--limit", type=float, default=30.0, help="longest run, in expected seconds")
    arguments = parser.parse_args()
    program = str(pathlib.Path(arguments.dsl).resolve())
    scripts = arguments.scripts or sorted(str(path.relative_to(ROOT)) for path in (ROOT / "examples").glob("*.dscene"))
    rows, ratios, within = [], [], 0
    for script in scripts:
        try:
            estimate = estimated(program, script)
            expected = estimate["seconds"]
            if expected["expected"] > arguments.limit:
                print(f"{script}: {expected['expected']:.0f} s expected, not run", file=sys.stderr)
                continue
            timings, peak = measured(program, script)
        except (RuntimeError, OSError) as error:
            print(f"{script}: {error}", file=sys.stderr)
            continue
        taken = sum(action["seconds"] for action in timings["actions"])
        ratio = expected["expected"] / taken
        ratios.append(ratio)
        within += expected["low"] <= taken <= expected["high"]
        name = pathlib.Path(script).stem
        spread = f"{seconds(expected['low'])}–{seconds(expected['high'])}"
        memory = f"{estimate['bytes'] / 1e6:.0f} | {peak / 1e6:.0f}"
        rows.append(f"| `{name}` | {seconds(expected['expected'])} | {spread} | {seconds(taken)} | {ratio:.2f} | {memory} |")
        print(rows[-1], file=sys.stderr)
    if not rows:
        sys.exit("nothing was measured")
    ratios.sort()
    middle = ratios[len(ratios) // 2]
    machine = platform.processor() or platform.machine()
    table = [
        f"{len(rows)} examples, on {machine} with {len(__import__('os').sched_getaffinity(0))} cores: {within} within their range;",
        f"expected over taken is {middle:.2f} in the middle, {ratios[0]:.2f} at least and {ratios[-1]:.2f} at most.",
        "",
        "| example | expected, s | range, s | taken, s | expected / taken | memory expected, MB | held, MB |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *rows,
    ]
    text = PAGE.read_text()
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    PAGE.write_text(head + BEGIN + "\n" + "\n".join(table) + "\n" + END + tail)


if __name__ == "__main__":
    main()
