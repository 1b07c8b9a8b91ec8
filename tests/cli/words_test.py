#!/usr/bin/env python3
"""What commands say: `schema` in every JSON document, completion, Ctrl-C, and messages that name the remedy.
usage: words_test.py ESMC [unittest args]"""
import json
import re
import signal
import subprocess
from pathlib import Path

from command import ARM, CIRCLE, PROGRAM, ROBUST, SCENES, Case, esmc, main, sets

NO_JSON = {"init", "export", "keys", "bake", "completion"}  # they print a scene, a model, a table, C++, a script


def commands():
    return set(re.findall(r"^  (\w+) ", esmc("--help").stdout.split("Subcommands:")[1], re.M))


class Words(Case):
    def sweep(self):
        spec = self.tmp / "spec.toml"
        spec.write_text(f'scene = "{CIRCLE}"\nset = ["simulation.duration=60"]\nsample = {{ method = "grid" }}\n[[vary]]\nkey = "control.lambda"\nfrom = 30.0\nto = 50.0\nsteps = 400\n')
        return spec

    def test_every_json_document_has_its_schema(self):
        run, short = self.tmp / "run", sets("simulation.duration=0.3")
        esmc("sim", CIRCLE, "--out", run, *short)
        calibration, identification = self.tmp / "calibration", self.tmp / "identification"
        for scene, out in (("five_bar_calibration", calibration), ("five_bar_identification", identification)):
            self.assertEqual(esmc("sim", Path(SCENES, scene + ".toml"), "--out", out).returncode, 0)
        cases = json.dumps({"cases": []})
        spec = self.tmp / "small.toml"
        spec.write_text(f'scene = "{CIRCLE}"\nsample = {{ method = "grid" }}\n[[vary]]\nkey = "control.lambda"\nvalues = [30.0, 40.0]\n')
        arguments = {
            "sim": [CIRCLE, *short], "hil": [CIRCLE, *short], "check": [CIRCLE], "margins": [CIRCLE], "plan": [PROGRAM], "replay": [run], "compare": [run, run],
            "campaign": ["--episodes", 2], "design": [ROBUST], "sweep": [spec],
            "accuracy": [ARM], "calibrate": [calibration, "--trust-half-base"], "identify": [identification],
            "spatial": [next(Path(SCENES, "spatial").glob("*.toml")), *short], "live": [CIRCLE, "--port", 0, "--duration", 0.2]}
        on_a_bus = {"plant", "controller", "drive", "operate"}  # vcan.loop, slcan.echo and slcan.operate read theirs
        self.assertEqual(commands(), set(arguments) | NO_JSON | on_a_bus | {"eval"})
        for command, given in arguments.items():
            done = esmc(command, *given, "--json")
            self.assertEqual(next(iter(json.loads(done.stdout).items())), ("schema", 1), command)
        self.assertEqual(json.loads(esmc("eval", "-", input=cases).stdout), {"schema": 1, "cases": []})
        self.assertEqual(json.loads((run / "summary.json").read_text())["schema"], 1)

    def test_studies_leave_a_page_and_the_document_that_they_print(self):
        log = self.tmp / "log"
        esmc("sim", Path(SCENES, "five_bar_calibration.toml"), "--out", log)
        for command, name, given in (("check", "check", [CIRCLE]), ("design", "design", [ROBUST]),
                                     ("plan", "plan", [PROGRAM]),
                                     ("calibrate", "calibration", [log, "--trust-half-base"])):
            out = self.tmp / name
            done = esmc(command, *given, "--json", "--out", out)
            self.assertEqual(done.stdout, (out / f"{name}.json").read_text())
            page = (out / "report.html").read_text()
            self.assertIn("class='panel verdict'", page)
            self.assertEqual(len(re.findall(r"<h1>", page)), 1)
            self.assertEqual(esmc(command, *given, "--out", out).returncode, done.returncode, "its own folder is written again")
        refused = esmc("calibrate", log, "--trust-half-base", "--out", log)
        self.assertEqual(refused.returncode, 2)
        self.assertIn("would replace", refused.stderr)
        self.assertTrue((log / "log.csv").is_file())

    def complete(self, *words):
        script = self.tmp / "esmc.bash"
        script.write_text(esmc("completion", "bash").stdout)
        line = (f'load() {{ . "{script}"; }}; load; compopt() {{ :; }}; COMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); '  # as bash-completion does
                '_esmc; printf "%s\\n" "${COMPREPLY[@]}"')
        done = subprocess.run(["bash", "-c", line, "bash", *words], capture_output=True, text=True, timeout=60)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return set(done.stdout.split())

    def test_completion_offers_what_help_lists(self):
        self.assertEqual(self.complete("esmc", "") - {"help", "--help", "--version"}, commands())
        for command in commands():
            listed = set(re.findall(r"^  (?:-\w,)?(--[\w-]+)", esmc(command, "--help").stdout, re.M))
            self.assertEqual(self.complete("esmc", command, "-"), listed, command)
        self.assertEqual(self.complete("esmc", "hil", "--scalar", ""), {"double", "float"})
        self.assertEqual(self.complete("esmc", "init", ""), {"five_bar", "rr"})
        self.assertEqual(self.complete("esmc", "sim", "x", "--set", "control.la"), {"control.law=", "control.lambda=", "control.layer="})

    def test_one_exit_status_for_ctrl_c(self):
        long, endless = sets("simulation.duration=20"), sets("simulation.duration=100000")
        spec, out = self.sweep(), self.tmp / "out"
        for line in (["sim", CIRCLE, *endless], ["accuracy"], ["accuracy", CIRCLE, *long, "--effects", "all"],
                     ["campaign", "--episodes", 10**7], ["spatial", next(Path(SCENES, "spatial").glob("*.toml")), *endless]):
            self.interrupted(*line)
        for number in (signal.SIGINT, signal.SIGTERM):  # drives that have said that they are idle
            text, _ = self.interrupted("hil", CIRCLE, "--json", *endless, by=number, has_begun=lambda out: json.loads(out)["ticks"] > 0)
            s = json.loads(text)
            self.assertEqual((s["interrupted"], s["supervisor"]["final_state"], s["supervisor"]["faults"]), (True, "disabled", []))
        text, err = self.interrupted("sweep", spec, "--json", "--out", out, "--jobs", 1, "--scalar")
        summary = json.loads(text)
        self.assertGreater(summary["outcomes"]["not_run"], 0)
        self.assertRegex(err, r"^esmc: interrupted after \d+ of 400 cases, which the summary is of; the same command goes on from there\n$")
        robust = ["design", ROBUST, "--simulate", 10**6, "--json"]
        text, err = self.interrupted(*robust, has_begun=bool)  # while plants are simulated, not while gains are designed
        plants = json.loads(text)["simulated"]["exact_lengths"]
        self.assertEqual((plants["wanted"], err), (10**6, ""))
        self.assertLess(plants["plants"], 10**6)

    def test_messages_name_the_remedy(self):
        for direction in ("[2, 1]", "[0.5, 1]", "[0, 1]"):
            self.refused(esmc("sim", CIRCLE, *sets(f"drives.direction={direction}")), "'drives.direction' must be 1 or -1 for every axis")
        piped = esmc("sim", "-", *sets("simulation.duration=0.05"), input=CIRCLE.read_text())
        self.assertEqual(piped.returncode, 0, piped.stderr)
        spec = self.tmp / "spec.toml"
        spec.write_text('scene = "gone.toml"\n[[vary]]\nkey = "control.lambda"\nvalues = [30.0]\n')
        self.refused(esmc("sweep", spec), f"esmc: {spec}:1: ")


if __name__ == "__main__":
    main()
