#!/usr/bin/python3
"""One fuzz target on its kept corpus, then a fixed number of executions with a fixed seed.

usage: run_target.py TARGET CORPUS --runs N [ARGUMENTS OF LIBFUZZER...]

A failing input is left in the build folder, next to the target, and printed in base64 with the command that runs it."""
import base64
import subprocess
import sys
from pathlib import Path

from corpus import unpack


def main():
    target, packed, runs, extra = Path(sys.argv[1]), sys.argv[2], sys.argv[4], sys.argv[5:]
    scratch = target.parent / "runs" / target.name
    kept = unpack(packed, scratch / "corpus")
    if kept == 0:
        print(f"{packed}: no kept inputs")
        return 1
    for old in scratch.glob("artifact-*"):
        old.unlink()
    run = subprocess.run([target, f"-runs={runs}", "-seed=1", f"-artifact_prefix={scratch}/artifact-", "-print_final_stats=1",
                          "-timeout=60", "-rss_limit_mb=2048", *extra, scratch / "corpus"],
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", check=False)
    lines = run.stdout.splitlines()
    if run.returncode == 0:
        print(f"{kept} kept inputs;", next((x for x in reversed(lines) if "DONE" in x), ""))
        return 0
    print("\n".join(lines[-60:]))
    for artifact in scratch.glob("artifact-*"):
        print(f"failing input: {artifact}\n  {base64.b64encode(artifact.read_bytes()).decode()}\n  again: {target} {artifact}")
    return 1


if __name__ == "__main__":
    sys.exit(main())
