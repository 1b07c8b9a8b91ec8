#!/usr/bin/python3
"""Compiler launcher of one board's build: takes an object of the control archive from another board's build folder, where both are
compiled by the same command and no source is newer; two boards have one processor. The call graph beside the object is taken, too.

usage: shared_objects.py OTHER_BUILD_FOLDER COMPILER ARGUMENTS...   (in the build folder)
       shared_objects.py --self-test"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path


def command_for(folder, output):
    """What CMake wrote for the object `output`, but for the name of the build folder; None: nothing."""
    commands = folder / "compile_commands.json"
    for entry in json.loads(commands.read_text(encoding="utf-8")) if commands.is_file() else []:
        if f" -o {output} " in entry["command"]:
            return entry["command"].replace(f"{folder}=", "BUILD=")
    return None


def sources_of(command):
    """Sources and headers of a compilation, for which the file that ninja reads them from is written."""
    listed = ["-M" if word == "-MD" else word for word in command]
    del listed[listed.index("-o"):listed.index("-o") + 2]
    if subprocess.run(listed, check=False).returncode:
        return None
    text = Path(command[command.index("-MF") + 1]).read_text(encoding="utf-8")
    return text.split(":", 1)[1].replace("\\\n", " ").split()


def taken(other, output, command):
    files = [output, output.with_suffix(".ci")]
    ours = command_for(Path.cwd(), output)
    if ours is None or ours != command_for(other, output) or not all((other / file).is_file() for file in files):
        return False
    sources = sources_of(command)
    if not sources or max(Path(s).stat().st_mtime for s in sources) >= (other / output).stat().st_mtime:
        return False
    for file in files:
        shutil.copyfile(other / file, file)
    return True


def main(other, *command):
    output = Path(command[command.index("-o") + 1] if "-o" in command else "")
    if output.parts[:1] == ("firmware",) and taken(Path(other), output, command):
        return 0
    return subprocess.run(command, check=False).returncode


def compiled(root, output="firmware/a.obj", flag="-O3", source_age=100, call_graph=True):
    """What stands in an object of `here` after the launcher, where `other` has one of -O3 that is 50 s old."""
    here, other, source = Path(root, "here"), Path(root, "other"), Path(root, "a.cpp")
    source.write_text("int a;", encoding="utf-8")
    os.utime(source, (source.stat().st_mtime - source_age,) * 2)
    for folder, flags in ((here, flag), (other, "-O3")):
        shutil.rmtree(folder, ignore_errors=True)
        (folder / output).parent.mkdir(parents=True)
        written = f"c++ {flags} -ffile-prefix-map={folder}=. -o {output} -c {source}"
        (folder / "compile_commands.json").write_text(json.dumps([{"command": written}]), encoding="utf-8")
    (other / output).write_text("of the other", encoding="utf-8")
    os.utime(other / output, ((other / output).stat().st_mtime - 50,) * 2)
    if call_graph:
        (other / output).with_suffix(".ci").write_text("", encoding="utf-8")
    subprocess.run([sys.executable, Path(__file__).resolve(), other, "c++", flag, "-MD", "-MT", output, "-MF", f"{output}.d", "-o", output, "-c", source],
                   cwd=here, check=True)
    assert source.name in (here / f"{output}.d").read_text(encoding="utf-8")
    return "other" if (here / output).read_bytes() == b"of the other" else "own"


def self_test():
    with tempfile.TemporaryDirectory() as root:
        found = [compiled(root), compiled(root, flag="-O2"), compiled(root, source_age=0), compiled(root, output="boards/a.obj"),
                 compiled(root, call_graph=False)]
    print(found)
    return 0 if found == ["other", "own", "own", "own", "own"] else 1


if __name__ == "__main__":
    sys.exit(self_test() if sys.argv[1:] == ["--self-test"] else main(*sys.argv[1:]))
