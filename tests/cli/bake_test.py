#!/usr/bin/python3
"""esmc bake from outside: what it prints, and what it refuses without leaving anything behind. The numbers themselves are
tested by the images (tests/boards). usage: bake_test.py ESMC"""
import re

from command import ARM, CIRCLE, DOCS, Case, esmc, main, sets


def bake(*arguments):
    return esmc("bake", *arguments)


class Bake(Case):
    def bad(self, *arguments, text):
        done = bake(*arguments, "--out", self.tmp / "scene.hpp")
        self.refused(done)
        self.assertRegex(done.stderr, text)
        self.assertEqual(list(self.tmp.iterdir()), [])

    def test_every_scene_protocol_and_scalar(self):
        mit = sets('drives.protocol="mit"', 'drives.dialect="mini_cheetah"', "drives.master_id=[11,12]",
                   "drives.position_range=[12.5,12.5]", "drives.velocity_range=[50.0,50.0]", "drives.torque_range=[18.0,18.0]")
        for scene, name in ((CIRCLE, "FiveBar"), (ARM, "Rr")):
            for scalar in ("double", "float"):
                for protocol, axis in (([], "OdriveAxis"), (mit, "MitAxis"), (sets("drives.protocol=moteus"), "MoteusAxis")):
                    done = bake(scene, "--scalar", scalar, *protocol)
                    self.assertEqual((done.returncode, done.stderr), (0, ""), (scene, scalar, axis))
                    self.assertIn(f"using Scalar = {scalar};", done.stdout)
                    self.assertIn(f"using Mechanism = {name}<Scalar>;", done.stdout)
                    self.assertIn(f"drive::{axis}", done.stdout)
                    self.assertRegex(done.stdout, f" data_bitrate = {5000000 if axis == 'MoteusAxis' else 0};")
                    floats = len(re.findall(r"0x[0-9a-f.]+p[+-]\d+F", done.stdout))
                    doubles = len(re.findall(r"0x[0-9a-f.]+p[+-]\d+(?!\d*F)\b", done.stdout))
                    self.assertGreater(floats if scalar == "float" else doubles, 100)
                    if scalar == "float":
                        self.assertEqual(doubles, 0, "a float image holds no double")

    def test_a_file_is_what_is_printed_and_the_same_every_time(self):
        out = self.tmp / "scene.hpp"
        self.assertEqual(bake(CIRCLE, "--out", out).returncode, 0)
        self.assertEqual(out.read_text(encoding="utf-8"), bake(CIRCLE).stdout)
        self.assertEqual(list(self.tmp.iterdir()), [out])

    def test_what_check_refuses_is_not_baked(self):
        self.bad(CIRCLE, *sets("control.torque_limit=0.2"), text="esmc check refuses it: .*torque")
        self.bad(CIRCLE, *sets('control.law="open_loop"'), text="law")

    def test_unconfirmed_drives_make_an_image_that_does_not_arm(self):
        """The default image; the two headers differ in the one value that refuses to arm."""
        board = DOCS.parent / "boards/five_bar.toml"
        lines = []
        for more in ([], sets("drives.confirmed=true")):
            run = bake(board, "--realtime", "--scalar", "float", *more)
            self.assertEqual(run.returncode, 0, run.stderr)
            self.assertEqual("drives_not_confirmed" in run.stderr, not more)
            lines.append([line for line in run.stdout.splitlines() if not line.strip().startswith("//")])
        differ = [(a, b) for a, b in zip(*lines, strict=True) if a != b]
        self.assertEqual(len(differ), 1, differ)
        self.assertEqual(differ[0][0].replace("U, false, true", "U, true, true"), differ[0][1])
        self.bad(board, text="command.arm")  # in lockstep no console arms it

    def test_what_does_not_fit_is_not_baked(self):
        corners = ",".join(f"[{0.05 * (-1) ** i},{0.15 + 0.0001 * i}]" for i in range(300))
        self.bad(CIRCLE, *sets(f'reference={{type="polyline",points=[{corners}],speed=0.2}}',
                                   'initial={at="reference"}'), text="allowed are 256")

    def test_what_exceeds_the_budget_of_a_board_is_not_baked(self):
        g4 = ("--board", "nucleo_g474re", "--scalar", "float")
        done = bake(CIRCLE, *g4)
        self.assertEqual((done.returncode, done.stderr, done.stdout), (0, "", bake(CIRCLE, "--scalar", "float").stdout))
        self.bad(CIRCLE, *g4, *sets("control.rate_hz=40000"), text=r"takes \d+ of the 4250 cycles of a tick of nucleo_g474re")
        # The largest rate that is offered is taken; one more is not. (What the bus carries ends far below it.)
        offered = re.search(r"control.rate_hz = (\d+) or less", bake(CIRCLE, *g4, *sets("control.rate_hz=40000")).stderr)[1]
        self.bad(CIRCLE, *g4, *sets(f"control.rate_hz={offered}"), text="esmc check refuses it")
        self.bad(CIRCLE, *g4, *sets(f"control.rate_hz={int(offered) + 1}"), text=f"control.rate_hz = {offered} or less")
        parts = ('control.reaching="super_twisting"', "control.predictor=true", "control.delay_ticks=2", "control.disturbance_observer=20.0")
        self.bad(CIRCLE, *g4, *sets(f"control.rate_hz={offered}", *parts), text="cycles of a tick of nucleo_g474re")
        self.bad(CIRCLE, "--board", "nucleo_g474re", text="nucleo_g474re needs --scalar float")
        self.bad(CIRCLE, "--board", "nucleo_h743zi2", "--scalar", "float", text="nucleo_h743zi2 needs --scalar double")
        self.bad(CIRCLE, "--board", "nucleo_g0", text="nucleo_g0")

    def test_bad_input(self):
        self.bad("no_such.toml", text="no_such.toml")
        self.refused(bake(CIRCLE, "--out", "/no/such/folder/scene.hpp"), "esmc: /no/such/folder/scene.hpp: cannot be written\n")


if __name__ == "__main__":
    main()
