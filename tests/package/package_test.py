#!/usr/bin/python3
"""The Debian package, made of what is built, unpacked into a scratch root and used from there. Python's standard library only.

usage: package_test.py BUILD_DIR
       package_test.py --self-test     seeds an error of each kind into an unpacked package and expects it to be found

Checked: name, version and dependencies; owners and modes; that no path of the build is in any file; that every header finds
what it includes; the manual page; that the installed command and the Python module run a scene; that find_package(esmc) of the README finds the
library in it with the version of the command, and refuses another one. The README's program is compiled against
`cmake --install` by docs_test.py; here it is shown that the package holds the same files."""
import gzip
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEBIAN_ONLY = {"share/doc/esmc/copyright", "share/doc/esmc/changelog.gz", "share/man/man1/esmc.1.gz"}
INSTALLED_ONLY = {"share/man/man1/esmc.1"}


def run(*command, **more):
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300, **more)


def must(*command, **more):
    done = run(*command, **more)
    if done.returncode != 0:
        raise SystemExit(f"package_test.py: {' '.join(map(str, command))}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def version_of_project():
    return re.search(r"project\(esmc VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"))[1]


def files(usr):
    return {str(p.relative_to(usr)) for p in usr.rglob("*") if p.is_file()}


def control_fields(package, version):
    field = lambda name: must("dpkg-deb", "-f", package, name).strip()
    if not re.fullmatch(rf"esmc_{re.escape(version)}_\w+\.deb", package.name):
        yield f"the package is called {package.name}"
    if field("Version") != version:
        yield f"its version is {field('Version')}, of the project {version}"
    for needed in ("libc6", "libstdc++6", "libfmt9", "libeigen3-dev"):
        if not re.search(rf"(^|, ){re.escape(needed)}( |,|$)", field("Depends")):
            yield f"it does not depend on {needed}: {field('Depends')}"
    if field("Section") != "science" or len(field("Description").splitlines()) < 4 or "@" not in field("Maintainer"):
        yield "section, description or maintainer are missing"


def owners(package):
    for line in must("dpkg-deb", "-c", package).splitlines():
        mode, owner = line.split()[:2]
        name = line.split("./", 1)[1]
        want = "drwxr-xr-x" if name.endswith("/") or not name else ("-rwxr-xr-x" if name.startswith("usr/bin/") else "-rw-r--r--")
        if (mode, owner) != (want, "root/root"):
            yield f"{name}: {mode} {owner}, not {want} root/root"


def build_paths(usr, *paths):
    for file in sorted(usr.rglob("*")):
        if file.is_file():
            data = file.read_bytes()
            data = gzip.decompress(data) if file.suffix == ".gz" else data
            for path in paths:
                if str(path).encode() in data:
                    yield f"{file.relative_to(usr)}: holds the path of the build, {path}"


def includes(usr):
    top = usr / "include/esmc"
    headers = sorted(top.rglob("*.hpp"))
    if len(headers) < 40:
        yield f"there are {len(headers)} headers"
    for header in headers:
        for name in re.findall(r'^#include "([^"]+)"', header.read_text(encoding="utf-8"), re.M):
            if not (top / name).is_file():
                yield f"{header.relative_to(top)}: includes {name}, which is not installed"


def manual(usr, esmc):
    page = gzip.decompress((usr / "share/man/man1/esmc.1.gz").read_bytes()).decode()
    for name in re.findall(r"^  (\w+) ", must(esmc, "--help").split("Subcommands:")[1], re.M):
        if f".SH ESMC {name.upper()}\n" not in page:
            yield f"the manual page says nothing of esmc {name}"
    plain = re.sub(r"^\\&", "", page.replace("\\-", "-").replace("\\e", "\\"), flags=re.M)
    if must(esmc, "bake", "--help").strip() not in plain:
        yield "the manual page does not quote esmc bake --help"
    if (usr / "share/bash-completion/completions/esmc").read_text(encoding="utf-8") != must(esmc, "completion", "bash"):
        yield "the completion is not what esmc completion bash prints"


def command(usr, place, version):
    esmc = usr / "bin/esmc"
    home = {"PATH": "/usr/bin:/bin", "LC_ALL": "C"}
    said = run(esmc, "--version", env=home, cwd=place).stdout.strip()
    if said != version:
        yield f"esmc --version prints {said}, the project's version is {version}"
    (place / "arm.toml").write_text(run(esmc, "init", "rr", env=home).stdout, encoding="utf-8")
    for step in (["check", "arm.toml"], ["hil", "arm.toml", "--set", "simulation.duration=0.1", "--out", "out"]):
        done = run(esmc, *step, env=home, cwd=place)
        if done.returncode != 0:
            yield f"esmc {' '.join(step)}: exit {done.returncode}: {done.stderr}"
    if not (place / "out/report.html").is_file():
        yield "the installed command wrote no report"


def module(usr, place):
    folder = usr / "lib/python3/dist-packages"
    if not (folder / "esmc-stubs/__init__.pyi").is_file():
        yield "the types of the Python module are missing"
    done = run("/usr/bin/python3", "-c", "import esmc; print(esmc.run(esmc.Scene.load('arm.toml').set('simulation.duration', 0.1)).digest)",
               env={"PYTHONPATH": str(folder)}, cwd=place)
    if not re.fullmatch(r"[0-9a-f]{16}\n", done.stdout):
        yield f"the Python module does not run a scene: {done.stderr[-300:]}"


def library(usr, place, version):
    major, minor, patch = version.split(".")
    for wanted, found in ((f"{major}.{minor}", True), (f"{major}.{int(minor) + 1}", False)):
        (place / "CMakeLists.txt").write_text(
            f"cmake_minimum_required(VERSION 3.25)\nproject(hold CXX)\nfind_package(esmc {wanted} CONFIG REQUIRED)\n"
            f'if(NOT esmc_VERSION STREQUAL "{version}" OR NOT TARGET esmc::control OR NOT TARGET esmc::firmware)\n'
            "  message(FATAL_ERROR wrong)\nendif()\n", encoding="utf-8")
        done = run("cmake", "-G", "Ninja", "-S", place, "-B", place / f"b{found}", f"-DCMAKE_PREFIX_PATH={usr}")
        if (done.returncode == 0) != found:
            yield f"find_package(esmc {wanted}) {'fails' if found else 'is content with ' + version}: {done.stderr[-500:]}"


def judge(build):
    version = version_of_project()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        must("cpack", "--config", build / "CPackConfig.cmake", "-B", place / "made", cwd=place)
        made = list((place / "made").glob("*.deb"))
        if len(made) != 1:
            yield f"cpack made {len(made)} packages"
            return
        package = made[0]
        must("dpkg-deb", "-x", package, place / "root")
        usr = place / "root/usr"
        yield from control_fields(package, version)
        yield from owners(package)
        yield from build_paths(usr, ROOT, build, place)
        yield from includes(usr)
        yield from manual(usr, usr / "bin/esmc")
        yield from command(usr, place, version)
        yield from module(usr, place)  # of the scene that the command has left
        yield from library(usr, place, version)
        must("cmake", "--install", build, "--prefix", place / "prefix")
        installed, packed = files(place / "prefix"), files(usr)
        if packed - installed != DEBIAN_ONLY or installed - packed != INSTALLED_ONLY:
            yield f"installed and packed differ by {sorted(installed ^ packed)}"


def self_test():
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        usr = Path(folder)
        (usr / "include/esmc/hal").mkdir(parents=True)
        for i in range(40):
            (usr / f"include/esmc/hal/h{i}.hpp").write_text("#include <array>\n", encoding="utf-8")
        (usr / "include/esmc/hal/h0.hpp").write_text('#include "hal/h1.hpp"\n', encoding="utf-8")
        if list(includes(usr)) or list(build_paths(usr, "/nowhere")):
            failed += 1
            print("package_test.py: finds errors where there are none")
        (usr / "include/esmc/hal/h2.hpp").write_text('#include "hal/gone.hpp"\n', encoding="utf-8")
        (usr / "zipped.gz").write_bytes(gzip.compress(b"see /nowhere/x"))
        for found, want in ((list(includes(usr)), "gone"), (list(build_paths(usr, "/nowhere")), "zipped.gz")):
            if len(found) != 1 or want not in found[0]:
                failed += 1
                print(f"package_test.py: should find {want}, found {found}")
        tree = usr / "deb"
        (tree / "DEBIAN").mkdir(parents=True)
        (tree / "DEBIAN/control").write_text("Package: esmc\nVersion: 1.0\nArchitecture: all\nMaintainer: a <a@example.org>\n"
                                             "Depends: libc6, libstdc++6, libfmt9\nDescription: none\n", encoding="utf-8")
        (tree / "usr/bin").mkdir(parents=True)
        (tree / "usr/bin/esmc").write_text("", encoding="utf-8")
        os.chmod(tree / "usr/bin/esmc", 0o644)
        must("dpkg-deb", "--root-owner-group", "-b", tree, usr / "esmc_1.0_all.deb")
        found = [*control_fields(usr / "esmc_1.0_all.deb", "1.1"), *owners(usr / "esmc_1.0_all.deb")]
        for want in ("is called", "version is 1.0", "libeigen3-dev", "section", "usr/bin/esmc: -rw-r--r--"):
            if not any(want in f for f in found):
                failed += 1
                print(f"package_test.py: should find {want}, found {found}")
    print(f"{failed} seeded cases misjudged")
    return failed


def main():
    if sys.argv[1:] == ["--self-test"]:
        return 1 if self_test() else 0
    if len(sys.argv) != 2 or not Path(sys.argv[1], "CPackConfig.cmake").is_file():
        print(__doc__, file=sys.stderr)
        return 2
    found = list(judge(Path(sys.argv[1]).resolve()))
    for problem in found:
        print(problem.rstrip())
    print(f"{len(found)} problems")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
