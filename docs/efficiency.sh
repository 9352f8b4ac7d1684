#!/usr/bin/env bash
# Measures this renderer and Mitsuba 3 on the same scenes and writes docs/efficiency_table.md.
#   docs/efficiency.sh            everything; PYTHON=… chooses the Python that has mitsuba
#                                 PEER_ARGUMENTS=… passes arguments to docs/peers/mitsuba_efficiency.py (--patience, --seconds), but for rows of
#                                 several bounces
#   docs/efficiency.sh rows|forward|growth
#                                 one part; the others are those that were measured last (in target/efficiency)
#   docs/efficiency.sh page       only the page
set -euo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
part=${1:-all}
work=target/efficiency
case $part in all | rows | forward | growth | page) ;; *) echo "unknown part: $part" >&2 && exit 2 ;; esac
mkdir -p $work
bench() { cargo bench --quiet --bench efficiency -- "$@"; }
peer() { "$python" docs/peers/mitsuba_efficiency.py $work/scenes "$@"; }

measures() { [ "$part" = all ] || [ "$part" = "$1" ]; }

# A line of how much memory and time a script takes.
whole() {
    "$python" - target/release/dsl run "$1" --quiet --force --out $work/whole <<'END'
import os, resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True)
seconds, peak = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print("%-18s %6.2f GB %6.1f s" % (os.path.basename(sys.argv[3]).removesuffix(".dscene"), peak * 1024 / 1e9, seconds))
END
}

# Notes what a part was measured with. (The page itself may have changed.)
measured() {
    local dirty=
    git diff --quiet HEAD -- . ':!docs/efficiency_table.md' || dirty=-dirty
    echo "dscene $(git describe --always)$dirty, $(date -u +%Y-%m-%d), $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1), $(nproc) threads" >$work/$1.version
}

[ "$part" = page ] || [ "$part" = growth ] || bench --export $work/scenes
if measures rows; then
    bench --json --precise | tee $work/dscene.jsonl
    # Gradients of several bounces take it so long that little patience means one setting.
    peer ${PEER_ARGUMENTS:-} --skip "3 bounces" --skip "4 bounces" | tee $work/mitsuba.jsonl
    peer --scene "3 bounces" --scene "4 bounces" --pilot 3 --seconds 60 --timeout 1800 | tee -a $work/mitsuba.jsonl
    measured rows
fi
if measures forward; then
    rm -f $work/forward.jsonl $work/mitsuba_forward.jsonl
    # What a machine gives varies by a tenth within the hour: speed alone is compared in turns.
    for _ in 1 2 3 4 5; do
        bench --json --scene forward | tee -a $work/forward.jsonl
        peer --scene forward | tee -a $work/mitsuba_forward.jsonl
    done
    measured forward
fi
if measures growth; then
    bench --scaling | tee $work/scaling.txt
    cargo build --quiet --release
    for script in docs/growth/*.dscene; do
        whole "$script"
    done | tee $work/whole.txt
    measured growth
fi

for needed in dscene.jsonl mitsuba.jsonl rows.version forward.jsonl mitsuba_forward.jsonl forward.version scaling.txt whole.txt growth.version; do
    [ -e $work/$needed ] || { echo "the page needs all parts: $work/$needed has not been measured" >&2 && exit 1; }
done
page=$(mktemp)
{
    cat <<'END'
# Both programs on the same scenes

Written by `docs/efficiency.sh`; `docs/efficiency.md` says what follows from it. Each row is the derivative of one linear loss (the mean
of image × ramp) in one parameter, 256 × 256 pixels, box filter. *z*: distance from a closed form or from central differences with common
random numbers (`docs/efficiency_references.json`), in combined standard errors; *error*: that combined error over the derivative.
*rel. std*: standard deviation of a single gradient over the derivative. (18's derivative is zero: both are over the loss there, along a
direction of unit length.) *CPU s*: CPU seconds of a single gradient, all threads, warm.
Higher 1/(variance × CPU seconds) is better; *ratio* is ours over Mitsuba's. Mitsuba runs `direct_projective`, `prb_projective` or (where
no geometry moves) `prb` with no guiding, a grid and an octree at two sample counts, kernels warm; the table shows the best of those that
agree with the reference, or of all if none does, and says of how many that finished. Both programs render the same exported arrays; where their losses differ by more than
1 % it says so. A ratio marked "biased" says little: Mitsuba converges there, but to another number (more than 4 standard errors and 5 %
from the reference). Its default octree settings take minutes a gradient on a CPU and are only run by `docs/peers/mitsuba_efficiency.py
--default`.

END
    echo "* $(cat $work/rows.version)"
    echo "* $(rustc --version); $(uname -sm)"
    echo "* $("$python" -c 'import importlib.metadata as m; print("Mitsuba", m.version("mitsuba") + ", Dr.Jit", m.version("drjit"))')"
    echo
    bench --table $work/dscene.jsonl $work/mitsuba.jsonl
    printf '\n## Forward path tracing\n\nThe Cornell box of scene 17, path length 5: million samples a CPU second, both programs in turns (%s).\n\n' "$(cat $work/forward.version)"
    bench --turns $work/forward.jsonl $work/mitsuba_forward.jsonl
    printf '\n## Growth\n\nOne gradient step at 256 × 256, 4 samples a pixel, direct light; `numbers` is the length of the derivative, `over primal` compares CPU times (%s).\n\n```text\n' "$(cat $work/growth.version)"
    cat $work/scaling.txt
    printf '```\n\nWhole optimisations (`dsl run docs/growth/…`: a target, three steps of `adam`; 1.5, 6.3 and 50 million numbers), peak memory and time:\n\n```text\n'
    cat $work/whole.txt
    echo '```'
} >"$page"
mv "$page" docs/efficiency_table.md
chmod 644 docs/efficiency_table.md
