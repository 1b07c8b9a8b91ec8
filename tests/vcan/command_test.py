#!/usr/bin/python3
"""A supervisor computer over a real vcan0 (tests/link/supervisor.py): arms, leads, disarms by frames alone, and is missed
when it dies. What went over the bus is read with docs/esmc.dbc. usage: command_test.py ESMC SCENE"""
import json
import logging
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

logging.disable(logging.WARNING)  # canmatrix complains at import about formats whose libraries are missing
import canmatrix.formats  # noqa: E402

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SKIPPED = 77


def frames(log):
    """(name, {signal: decoded}) of the frames that docs/esmc.dbc knows."""
    dbc = {f.arbitration_id.id: f for f in canmatrix.formats.loadp_flat(str(ROOT / "docs/esmc.dbc")).frames}
    for line in log.read_text(encoding="ascii").splitlines():
        match = re.fullmatch(r"\(\d+\.\d+\) vcan0 ([0-9A-F]{3})#([0-9A-F]*)", line)
        frame = dbc.get(int(match[1], 16)) if match else None
        if frame:
            yield frame.name, frame.decode(bytes.fromhex(match[2]))


def words(log, signal):
    """The values of a signal of Status, one after the other, each once."""
    out = []
    for name, values in frames(log):
        if name == "Status" and (word := str(values[signal].named_value)) not in out[-1:]:
            out.append(word)
    return out


def in_order(wanted, found):
    rest = iter(found)
    return all(w in rest for w in wanted)


def main():
    esmc, scene = (str(Path(a).resolve()) for a in sys.argv[1:3])
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as folder:
        out = Path(folder)
        job = subprocess.run([HERE / "with_vcan", "--timeout", "300", "--", HERE / "command_job", esmc, scene, folder,
                              ROOT / "tests/link/supervisor.py"], capture_output=True, text=True)
        if job.returncode == SKIPPED:
            print(job.stdout.strip())
            return SKIPPED
        if job.returncode != 0:
            print(job.stdout, job.stderr)
            for name in ("circle.controller", "circle.plant", "dies.controller"):
                print(name, (out / name).read_text()[-500:] if (out / name).exists() else "was not started")
            return 1
        circle = json.loads((out / "circle.json").read_text())
        states = words(out / "circle.log", "State")
        on_circle = sum(abs(r) < 3e-6 for r in circle["radii"])
        print("circle:", states, "on the circle:", on_circle, "of", len(circle["radii"]), "ticks heard, tracking:",
              median(circle["errors"]), "m, counters:", circle["counters"])
        assert circle["after_wrong_frames"] == "disabled", circle
        assert circle["counters"][1] >= 2 and circle["counters"][3] >= 1, circle["counters"]
        assert circle["streamed_ticks"] >= 200 and circle["state_after_stream"] == "running", circle
        # Where the controller was led to, to the unit of the wire: where a sample was heard in the tick. How many were, and how
        # well it followed, is the machine's business.
        assert max(map(abs, circle["at_set_point"])) < 3e-6, circle["at_set_point"]
        assert on_circle >= 10, circle["radii"]
        assert circle["state"] == "disabled" and circle["fault"] == 0 and circle["records"] == [], circle
        assert in_order(["disabled", "enabling", "running", "halting", "stopping", "disabled"], states), states
        assert words(out / "circle.log", "Fault") == ["none"]
        assert (out / "circle.controller_exit").read_text().strip() == "0", (out / "circle.controller").read_text()

        dies = json.loads((out / "dies.json").read_text())
        print("dies:", words(out / "dies.log", "State"), words(out / "dies.log", "Fault"))
        assert words(out / "dies.log", "Fault") == ["none", "command_lost"]
        assert in_order(["running", "halting", "fault"], words(out / "dies.log", "State"))
        assert words(out / "dies.log", "Reaction")[:2] == ["none", "halt"]
        recorded = [str(v["Fault"].named_value) for name, v in frames(out / "dies.log") if name == "Fault_Record"]
        assert recorded[0] == "command_lost" and dies["state"] == "fault", (recorded, dies)
        assert "command_lost" in (out / "dies.controller").read_text()
    return 0


if __name__ == "__main__":
    sys.exit(main())
