#!/usr/bin/python3
"""Compiler launcher of one board's build: takes an object of the control archive from another board's build folder, where both are
compiled by the same command and no source is newer; two boards have one processor. The call graph beside the object is taken, too.

usage: shared_objects.py OTHER_BUILD_FOLDER COMPILER ARGUMENTS...   (in the build folder)"""
import json
import shutil
import subprocess
import sys
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


if __name__ == "__main__":
    other_folder, *compilation = sys.argv[1:]
    target = Path(compilation[compilation.index("-o") + 1] if "-o" in compilation else "")
    if target.parts[:1] == ("firmware",) and taken(Path(other_folder), target, compilation):
        sys.exit(0)
    sys.exit(subprocess.run(compilation, check=False).returncode)
