"""Samples of long tests: drawn by the commit's hash, so that a run can be repeated and commits together see everything."""

import pathlib
import random
import subprocess
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]


def seed():
    """The hash of the commit that is checked out; "no commit" without git."""
    git = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    return git.stdout.strip() if git.returncode == 0 else "no commit"


def drawn(items, count, key=str):
    """`count` of the items, or all if there are fewer, in their order. Says which; key gives what is printed of an item."""
    items = list(items)
    chosen = sorted(random.Random(seed()).sample(range(len(items)), min(count, len(items))))
    if len(chosen) < len(items):
        print(f"sample of {len(chosen)} of {len(items)}, commit {seed()}: {', '.join(key(items[i]) for i in chosen)}", flush=True)
    return [items[i] for i in chosen]


def take_option(arguments):
    """Removes `--sample COUNT` from the arguments and returns COUNT; without it a number that no list reaches."""
    if "--sample" not in arguments:
        return 1 << 30
    at = arguments.index("--sample")
    count = int(arguments[at + 1])
    del arguments[at:at + 2]
    return count


class SampledLoader(unittest.TestLoader):
    """Loads a sample of the test methods of a program: unittest.main(testLoader=SampledLoader(count))."""

    def __init__(self, count):
        super().__init__()
        self.count = count

    def loadTestsFromModule(self, module, *args, **more):  # noqa: N802 (name of the base class)
        def cases(suite):
            for test in suite:
                yield from cases(test) if isinstance(test, unittest.TestSuite) else [test]
        loaded = super().loadTestsFromModule(module, *args, **more)
        return self.suiteClass(drawn(cases(loaded), self.count, lambda test: test.id().split(".", 1)[1]))
