#!/usr/bin/python3
"""The bench image in an emulator: the frames of the host's run, its table in docs/boards.md, and what bench.py refuses.

usage: bench_test.py ELF MACHINE ESMC SCENE LOG DOCS [--update]    LOG: of the host's run in the scalar type of the image"""
import contextlib
import io
import os
import pty
import re
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import bench
import board_test
import page_table
import stack_bound


def console(elf, machine):
    board = board_test.qemu(elf, machine, "stdio")
    lines = []
    for line in board.stdout:
        lines.append(line.strip())
        if line.startswith("done"):
            break
    board.kill()
    board.wait()
    return lines


def verdict(lines, log):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        return bench.judge(lines, log), out.getvalue()


def refused(lines, log):
    """What passes although it must not."""
    def changed(what, by):
        return [re.sub(what, by, line) for line in lines]
    mutants = {
        "another digest": changed(r"digest (\d)", lambda m: f"digest {(int(m[1]) % 9) + 1}"),
        "no digest": [line for line in lines if not line.startswith("digest")],
        "a torque frame that was withdrawn": changed(r"returned (\d+)", lambda m: f"returned {int(m[1]) - 1}"),
        "a frame of a drive that was lost": changed(r"taken (\d+)", lambda m: f"taken {int(m[1]) - 1}"),
        "a fault": changed("state running, fault none", "state fault, fault tick_late"),
        "no end": lines[:-1],
        "a start that failed": ["start: pll"],
        "nothing": [],
    }
    return [name for name, mutant in mutants.items() if mutant == lines or verdict(mutant, log)[0] != 1]


def flashed(lines, log, digest_of):
    """Result of `bench.py flash` with a terminal for the board and a script for openocd."""
    with tempfile.TemporaryDirectory() as folder:
        said = Path(folder, "said")
        Path(folder, "openocd").write_text(f'#!/bin/sh\necho "$@" > {said}\n', encoding="ascii")
        Path(folder, "openocd").chmod(0o755)
        board, port = pty.openpty()
        script = subprocess.Popen([sys.executable, bench.__file__, "flash", "bench.elf", "board/x.cfg", log], stdout=subprocess.PIPE, text=True,
                                  env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "ESMC_PORT": os.ttyname(port)})

        def feed():  # a board that was running first says something else
            while not said.exists() and script.poll() is None:
                threading.Event().wait(0.02)
            for line in ["half of a line", *map(digest_of, lines)]:
                os.write(board, f"{line}\r\n".encode())
        feeder = threading.Thread(target=feed)
        feeder.start()
        out = script.communicate(timeout=100)[0]
        feeder.join()
        os.close(board)
        os.close(port)
        if "-f board/x.cfg -c program bench.elf verify reset exit" not in said.read_text(encoding="ascii"):
            return "openocd was not asked to write the image"
        return script.returncode, out


def main(elf, machine, esmc, scene, log, docs, update):
    lines = console(elf, machine)
    result = bench.judge(lines, log)
    if result != 0:
        return result
    scalar = re.search(r"(float|double), in instructions", "".join(lines))[1]
    with tempfile.TemporaryDirectory() as folder:
        other = "double" if scalar == "float" else "float"
        board_test.run(esmc, "hil", scene, "--scalar", other, "--set", "simulation.duration=1.0", "--out", folder)
        if bench.expected(f"{folder}/frames.log")[1] == bench.expected(log)[1]:
            print("the digest does not tell float from double")
            return 1
    wrong = refused(lines, log)
    used, most = int(re.search(r"stack (\d+) bytes", "".join(lines))[1]), stack_bound.of_image(elf, Path(elf).parent)[0]
    print(f"stack: at most {most} bytes by the call graph")
    if not 500 < used <= most:
        wrong.append("the stack")
    if flashed(lines, log, lambda line: line)[0] != 0 or flashed(lines, log, lambda line: line.replace("digest", "digest 1"))[0] != 1:
        wrong.append("flash")
    if wrong:
        print("wrong:", ", ".join(wrong))
        return 1
    rows = "".join(f"| {m[1]} | {m[2]} | {m[3]} |\n" for m in (re.fullmatch(r"(\w+) worst (\d+) mean (\d+)", line) for line in lines) if m)
    return page_table.check(docs, f"bench {machine}", "| stage | worst | mean |\n|---|---|---|\n" + rows, update, 2)


if __name__ == "__main__":
    words = [a for a in sys.argv[1:] if a != "--update"]
    sys.exit(main(*words, "--update" in sys.argv))
