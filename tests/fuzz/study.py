#!/usr/bin/python3
"""Every fuzz target until its coverage does not grow any more, and when it found a new edge for the last time.

usage: study.py BUILD_DIR_OF_THE_TARGETS [--scale X] [--keep] [TARGET...]

Each target runs twice: optimised and without sanitizers (`fast`), where most of the executions are, and then sanitized on
what was found. It runs for the executions in the table below, and on until ten times as many as had found the last new edge have
followed without another one (`quiet`), but not for more than X (20) times the executions of the table.
Writes BUILD_DIR/study.md, a table. --keep replaces tests/fuzz/corpus by the minimised inputs: with all features, or with all
edges where that would be more than KEPT.
A failing input ends the study; it is left in the build folder and printed."""
import base64
import re
import subprocess
import sys
from pathlib import Path

from corpus import pack, unpack

HERE = Path(__file__).resolve().parent
KEPT = 200
QUIET = 10
# target: longest input, executions fast, executions sanitized
TARGETS = {
    "codec": (64, 100_000_000, 4_000_000),
    "slcan": (96, 10_000_000, 1_000_000),
    "odrive": (256, 2_500_000, 250_000),
    "mit": (256, 2_500_000, 250_000),
    "cia402": (256, 500_000, 40_000),
    "link": (256, 500_000, 50_000),
    "cycle_odrive": (400, 40_000, 3_000),
    "cycle_cia402": (400, 40_000, 3_000),
    "cycle_mit": (400, 40_000, 3_000),
    "scene": (2048, 0, 20_000),
}


def run_round(program, folder, runs, seed, longest):
    """(executions, the one that found the last new edge or 0, edges, features) of one process."""
    arguments = [program, f"-runs={runs}", f"-seed={seed}", f"-max_len={longest}", f"-artifact_prefix={folder.parent}/artifact-",
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
    edges = int(re.search(r"^#\d+\s+INITED\s+cov: (\d+)", run.stdout, re.M)[1])
    last = 0
    for at, cov in re.findall(r"^#(\d+)\s+(?:NEW|REDUCE)\s+cov: (\d+)", run.stdout, re.M):
        if int(cov) > edges:
            edges, last = int(cov), int(at)
    done = re.search(r"^#(\d+)\s+DONE\s+cov: (\d+) ft: (\d+)", run.stdout, re.M)
    return int(done[1]), last, int(done[2]), int(done[3])


def study(program, folder, least, most, longest):
    total = last = 0
    runs, seed = min(100_000, least), 1
    while total < least or (total - last < QUIET * last and total < most):
        executed, new, cov, ft = run_round(program, folder, runs, seed, longest)
        if new:
            last = total + new
        total += executed
        print(f"{program.name}: {total} executions, {cov} edges, {ft} features, the last new edge at {last}", flush=True)
        runs, seed = min(2 * runs, max(least - total, least)), seed + 1
    return {"total": total, "last": last, "cov": cov, "ft": ft, "quiet": (total - last) / max(last, 1) if last else float("inf")}


def quiet_text(r):
    return f"{r['quiet']:.1f}" if r["last"] else "none new"


def keep(program, folder, name):
    """Fewest inputs with all features; with all edges where that is too many."""
    for counters in (1, 0):
        kept = folder.parent / "kept"
        unpack("", kept)
        subprocess.run([program, "-merge=1", f"-use_counters={counters}", kept, folder], stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL, check=True)
        if len(list(kept.iterdir())) <= KEPT:
            break
    print(name, "kept: %d inputs, %d bytes packed" % pack(kept, HERE / "corpus" / f"{name}.txt"), flush=True)


def main():
    arguments = sys.argv[1:]
    build = Path(arguments.pop(0)).resolve()
    scale = 20.0
    if "--scale" in arguments:
        at = arguments.index("--scale")
        scale = float(arguments[at + 1])
        del arguments[at:at + 2]
    keeps = "--keep" in arguments
    names = [a for a in arguments if a != "--keep"] or list(TARGETS)
    rows = ["| target | build | executions | edges | features | last new edge at | quiet | inputs |", "|---|---|---|---|---|---|---|---|"]
    whole = 0
    for name in names:
        longest, fast, sanitized = TARGETS[name]
        folder = build / "study" / name / "corpus"
        unpack(HERE / "corpus" / f"{name}.txt", folder)
        for kind, most in (("_fast", fast), ("", sanitized)):
            if most == 0:
                continue
            r = study(build / f"fuzz_{name}{kind}", folder, most, int(most * scale), longest)
            whole += r["total"]
            rows.append(f"| `{name}` | {'fast' if kind else 'sanitized'} | {r['total']:,} | {r['cov']} | {r['ft']} | {r['last']:,} | {quiet_text(r)} | "
                        f"{len(list(folder.iterdir()))} |".replace(",", " "))
            (build / "study.md").write_text("\n".join(rows) + f"\n\n{whole:,} executions\n".replace(",", " "), encoding="utf-8")
        if keeps:
            keep(build / f"fuzz_{name}", folder, name)
    print((build / "study.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
