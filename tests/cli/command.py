"""What the tests of the command share: it is run, a refusal is judged, tables are read, a test has a folder of its own.
Each is called with ESMC [--sample COUNT] [more]; COUNT: of the parts of a test that takes long."""
import csv
import json
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS, SCENES = ROOT / "docs", ROOT / "host_sim/scenes"
sys.path.insert(0, str(ROOT / "tests/support"))
import sample  # noqa: E402

SAMPLE = sample.take_option(sys.argv)
ESMC, MORE = str(Path(sys.argv[1]).resolve()), sys.argv[2:]
CIRCLE, FRICTION, PROGRAM, ROBUST = (SCENES / f"five_bar_{n}.toml" for n in ("circle", "friction", "pick_and_place", "robust"))
ARM = SCENES / "rr_line.toml"


def sets(*values):
    return [word for v in values for word in ("--set", v)]


def esmc(*arguments, **more):
    return subprocess.run([ESMC, *map(str, arguments)], capture_output=True, text=True, check=False, timeout=300, **more)


def read_table(file):
    """The rows of a file with a head."""
    with open(file, newline="", encoding="utf-8") as f:
        return list(csv.DictReader(f))


class Case(unittest.TestCase):
    def setUp(self):
        self.tmp = Path(self.enterContext(tempfile.TemporaryDirectory()))

    def document(self, *arguments, code=0):
        """The JSON document of a command."""
        run = esmc(*arguments, "--json")
        self.assertEqual((run.returncode, run.stderr), (code, ""), run.stdout)
        return json.loads(run.stdout)

    def refused(self, run, *words, code=2):
        """One line on stderr that has these words, and nothing on stdout."""
        self.assertEqual((run.returncode, run.stdout, run.stderr.count("\n")), (code, "", 1), run.stdout + run.stderr)
        self.assertTrue(run.stderr.startswith("esmc: "), run.stderr)
        for word in words:
            self.assertIn(word, run.stderr)

    def interrupted(self, *arguments, by=signal.SIGINT, has_begun=lambda out: True, stdin=None):
        """What a command prints that is stopped while it works, however long it takes to begin."""
        for patience in (0.7, 2, 8, 30):
            run = subprocess.Popen([ESMC, *map(str, arguments)], stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            time.sleep(patience)
            run.send_signal(by)
            out, err = run.communicate(timeout=120)
            if run.returncode != -by and has_begun(out):
                break
        self.assertEqual(run.returncode, 130, (arguments, err))
        return out, err


def main(**more):
    unittest.main(argv=[sys.argv[0], *MORE], **more)
