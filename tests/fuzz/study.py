#!/usr/bin/python3
"""Every fuzz target until what it reaches of the source does not grow any more.

usage: study.py BUILD_DIR_OF_THE_TARGETS [--scale X] [--keep] [TARGET...]
       study.py BUILD_DIR_OF_THE_TARGETS --check [TARGET...]     only whether the kept inputs reach all but what unreached.txt explains

Each target runs optimised and without sanitizers (`fast`), where most of the executions are, and then sanitized on what was
found. The measure are the outcomes of conditions in the source (branches.py), looked at after each round of executions, each
round as long as all before it. A target runs for the executions in the table below, and on until QUIET times as many as it had
when its measure last grew, but not for more than X (20) times the executions of the table.
Writes BUILD_DIR/study.md, a table, and BUILD_DIR/study/<target>/missing.txt: conditions of functions that ran which were never
true or never false, without those that unreached.txt explains. --keep replaces tests/fuzz/corpus by the minimised inputs: with all features, or with all edges where that
would be more than KEPT.
A failing input ends the study; it is left in the build folder and printed."""
import base64
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from branches import explained, measure
from corpus import pack, unpack

HERE = Path(__file__).resolve().parent
KEPT = 200
QUIET = 4
# target: longest input, executions fast, executions sanitized
TARGETS = {
    "codec": (64, 100_000_000, 4_000_000),
    "slcan": (96, 10_000_000, 1_000_000),
    "odrive": (256, 2_500_000, 250_000),
    "mit": (256, 2_500_000, 250_000),
    "moteus": (256, 1_000_000, 50_000),
    "cia402": (256, 500_000, 40_000),
    "link": (256, 500_000, 50_000),
    "slots": (256, 500_000, 50_000),
    "recording": (256, 2_000_000, 100_000),
    "clock": (256, 2_000_000, 100_000),
    "drives": (256, 2_000_000, 100_000),
    "cycle_odrive": (400, 5_120_000, 30_000),
    "cycle_cia402": (400, 5_120_000, 30_000),
    "cycle_mit": (400, 5_120_000, 30_000),
    "scene": (2048, 0, 20_000),
}
# The whole cycle is told the same with any drive: an input of one target often goes as deep in another.
CYCLES = [name for name in TARGETS if name.startswith("cycle_")]


def run_round(program, folder, runs, seed, longest):
    """(executions, edges) of one process."""
    # Without the schedule by entropy: on thousands of inputs its books take longer than the target.
    arguments = [program, "-entropic=0", f"-runs={runs}", f"-seed={seed}", f"-max_len={longest}", f"-artifact_prefix={folder.parent}/artifact-",
                 "-print_final_stats=1", "-len_control=0", "-timeout=60", "-rss_limit_mb=2048"]
    dictionary = HERE / (program.name.removeprefix("fuzz_").removesuffix("_fast") + ".dict")
    if dictionary.is_file():
        arguments.append(f"-dict={dictionary}")
    run = subprocess.run([*arguments, folder], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", check=False)
    if run.returncode != 0:
        print("\n".join(run.stdout.splitlines()[-40:]))
        for artifact in folder.parent.glob("artifact-*"):
            print(f"failing input: {artifact}\n  {base64.b64encode(artifact.read_bytes()).decode()}\n  again: {program} {artifact}")
        sys.exit(1)
    done = re.search(r"^#(\d+)\s+DONE\s+cov: (\d+)", run.stdout, re.M)
    return int(done[1]), int(done[2])


def study(program, looker, folder, least, most, longest):
    reached, all_, _ = measure(looker, folder)
    total, last = 0, 0
    runs, seed = max(1, least // 8), 1
    while total < least or (total < QUIET * last and total < most):
        executed, edges = run_round(program, folder, runs, seed, longest)
        total += executed
        now, of, missing = measure(looker, folder)
        if now - reached:
            last = total
        reached, all_ = reached | now, all_ | of
        print(f"{program.name}: {total} executions, {edges} edges, {len(reached)} of {len(all_)} outcomes, grew last within {last}", flush=True)
        runs, seed = total, seed + 1
    open_, _ = explained(folder.parent.name, missing)
    (folder.parent / "missing.txt").write_text("".join(f"{m}\n" for m in open_), encoding="utf-8")
    return {"total": total, "last": last, "edges": edges, "reached": len(reached), "of": len(all_), "open": len(open_)}


def reached_by(looker, inputs, scratch):
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    for f in inputs:
        os.link(f, scratch / f.name)
    return measure(looker, scratch)[0]


def holders(looker, inputs, wanted, scratch):
    """Few inputs that together reach all of `wanted`, which all of `inputs` do."""
    if not wanted:
        return []
    if len(inputs) == 1:
        return inputs
    half = inputs[:len(inputs) // 2], inputs[len(inputs) // 2:]
    first = wanted & reached_by(looker, half[0], scratch)
    return holders(looker, half[0], first, scratch) + holders(looker, half[1], wanted - first, scratch)


def keep(program, looker, folder, name):
    """Fewest inputs with all features; with all edges where that is too many, and what then is lost of the measure."""
    for counters in (1, 0):
        kept = folder.parent / "kept"
        unpack("", kept)
        subprocess.run([program, "-merge=1", f"-use_counters={counters}", kept, folder], stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL, check=True)
        if len(list(kept.iterdir())) <= KEPT:
            break
    whole = sorted(folder.iterdir(), key=lambda f: (f.stat().st_size, f.name))
    lost = measure(looker, folder)[0] - measure(looker, kept)[0]
    for f in holders(looker, whole, lost, folder.parent / "half"):
        shutil.copy(f, kept / f.name)
    print(name, "kept: %d inputs, %d bytes packed" % pack(kept, HERE / "corpus" / f"{name}.txt"), flush=True)


def check(build, names):
    """Whether each target reaches all but what is explained, and nothing that was explained away."""
    good = True
    for name in names:
        folder = build / "study" / name / "check"
        count = unpack(HERE / "corpus" / f"{name}.txt", folder)
        reached, all_, missing = measure(build / f"fuzz_{name}_branches", folder)
        open_, stale = explained(name, missing)
        print(f"{name}: {count} kept inputs reach {len(reached)} of {len(all_)} outcomes; {len(all_) - len(reached) - len(open_)} explained, "
              f"{len(open_)} open", flush=True)
        for text in open_:
            print(f"  open: {text}")
        for text in stale:
            print(f"  reached after all, or gone: {text}")
        good = good and not open_ and not stale
    return good


def main():
    arguments = sys.argv[1:]
    build = Path(arguments.pop(0)).resolve()
    if "--check" in arguments:
        sys.exit(0 if check(build, [a for a in arguments if a != "--check"] or list(TARGETS)) else 1)
    scale = 20.0
    if "--scale" in arguments:
        at = arguments.index("--scale")
        scale = float(arguments[at + 1])
        del arguments[at:at + 2]
    keeps = "--keep" in arguments
    names = [a for a in arguments if a != "--keep"] or list(TARGETS)
    rows = ["| target | build | executions | edges | outcomes reached | of | open | grew last within | inputs |", "|---|---|---|---|---|---|---|---|---|"]
    whole = 0
    for name in names:
        longest, fast, sanitized = TARGETS[name]
        folder = build / "study" / name / "corpus"
        unpack(HERE / "corpus" / f"{name}.txt", folder)
        for other in CYCLES if name in CYCLES else ():
            theirs = folder.parent / "others"
            unpack(HERE / "corpus" / f"{other}.txt", theirs)
            for f in theirs.iterdir():
                f.replace(folder / f.name)
        for kind, least in (("_fast", fast), ("", sanitized)):
            if least == 0:
                continue
            r = study(build / f"fuzz_{name}{kind}", build / f"fuzz_{name}_branches", folder, least, int(least * scale), longest)
            whole += r["total"]
            rows.append(f"| `{name}` | {'fast' if kind else 'sanitized'} | {r['total']:,} | {r['edges']} | {r['reached']} | {r['of']} | {r['open']} | "
                        f"{r['last']:,} | {len(list(folder.iterdir()))} |".replace(",", " "))
            (build / "study.md").write_text("\n".join(rows) + f"\n\n{whole:,} executions\n".replace(",", " "), encoding="utf-8")
        if keeps:
            keep(build / f"fuzz_{name}", build / f"fuzz_{name}_branches", folder, name)
    print((build / "study.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
