#!/usr/bin/env python3
"""Bakes 20 assets with Ninja, CMake, Make and Meson by the recipes in examples/, and counts what runs again after which change.

    tests/recipes/build.py RELIGHT [SYSTEM ..]

Names of assets have spaces and `#`. A step after each asset copies it and counts as well: it may run only when bytes have changed.
Systems that are not installed are skipped, which is said; anything unexpected ends with exit code 1.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CAPTURE = ROOT / "testdata" / "icon72"
ASSETS = 20
PICTURES = 24
# Fits that cost more than blocks, as those of large captures do.
BASIS = 'basis = "ptm"\nrobust = true\n'
# The block format of the first build, and that of the last, in job files and on command lines.
FIRST = 'block = "bc4"\n'
OTHER = 'block = "bc1"\nquality = "fast"\n'
# How much less CPU bakes should take whose fits are there. Counters decide; time is said, as machines are noisy.
LESS_CPU = 5.0
# The one whose pictures are touched and changed.
CHOSEN = 7

# Counts runs of the program, keeps what bakes say, and goes on to it. The shell's `times` would drop what is below 10 ms of each.
COUNTING_PROGRAM = """#!/usr/bin/env bash
printf '%s\\n' "$*" >>"{log}/program"
[ "$1" = bake ] || exec "{relight}" "$@"
TIMEFORMAT='%3U %3S'
exec 3>&2
{{ time "{relight}" "$@" >>"{log}/said" 2>&3; }} 2>>"{log}/times"
"""
# The step after an asset.
STEP = """#!/bin/sh
printf '%s\\n' "$1" >>"{log}/steps"
cp "$1" "$2"
"""


class Failed(Exception):
    """What a build system did that it should not have done."""


class Sources:
    """Captures and job files of all assets, in `folder`: crops of testdata/icon72 under lights of their own."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.names = [f"asset {number:02} #{'abcd'[number % 4]}" for number in range(1, ASSETS + 1)]
        lights = (CAPTURE / "lights.lp").read_text().splitlines()[1:]
        for number, name in enumerate(self.names):
            capture = folder / name
            capture.mkdir(parents=True)
            # 5 and 72 have no common divisor: no picture comes twice.
            chosen = [lights[(number + 5 * index) % len(lights)] for index in range(PICTURES)]
            (capture / "lights.lp").write_text("\n".join([str(PICTURES), *chosen]) + "\n")
            for light in chosen:
                picture = light.split()[0]
                shutil.copyfile(CAPTURE / picture, capture / picture)
            self.write_job(name)

    def write_job(self, name: str, more: str = "") -> None:
        """Writes the job file of an asset; `more` are lines of its own."""
        number = self.names.index(name)
        text = f'input = "{name}"\n{BASIS}crop = "128x128+{number * 13}+{number * 12}"\n{more}'
        self.job(name).write_text(text)

    def job(self, name: str) -> Path:
        return self.folder / f"{name}.toml"

    def picture(self) -> Path:
        """The one that is touched and changed."""
        return sorted((self.folder / self.names[CHOSEN]).glob("*.jpg"))[3]

    def change(self) -> None:
        picture = self.picture()
        shutil.copyfile(sorted(picture.parent.glob("*.jpg"))[9], picture)


class System:
    """A build system in `folder`, which bakes `sources` by `program` and calls `step ASSET OUTPUT` for each."""

    name = ""
    tools: list[str] = []
    # Whether it sees that a command has changed; otherwise options belong into job files.
    sees_commands = True

    def __init__(self, folder: Path, sources: Sources, program: Path, step: Path):
        self.folder, self.sources, self.program, self.step = folder, sources, program, step
        folder.mkdir()

    @classmethod
    def lacks(cls) -> str:
        """Why the version that is installed can't do this; nothing where it can."""
        return ""

    def asset(self, name: str) -> Path:
        return self.folder / f"{name}.ktx2"

    def write(self, options: list[str]) -> None:
        """Writes the build files, with these options for every bake."""
        raise NotImplementedError

    def choose(self, block: str) -> None:
        """Writes the build files, with these keys of a job file for every bake."""
        if self.sees_commands:
            self.write([word for key, value in re.findall(r'(\w+) = "(.*)"', block) for word in (f"--{key}", value)])
            return
        for name in self.sources.names:
            self.sources.write_job(name, block)
        self.write([])

    def command(self) -> list[str]:
        raise NotImplementedError

    def build(self) -> str:
        """What it says."""
        return run(self.command(), self.folder)


class Ninja(System):
    name = "Ninja"
    tools = ["ninja"]

    def write(self, options: list[str]) -> None:
        def path(value: object) -> str:
            return re.sub(r"([$ :])", r"$\1", str(value))

        lines = [
            f"include {path(ROOT / 'examples/ninja/relight.ninja')}",
            f"relight = {self.program}",
            f"bake_options = --cache cache {' '.join(options)}",
            "rule step",
            f"  command = {self.step} $in $out",
        ]
        for name in self.sources.names:
            lines.append(f"build {path(name)}.ktx2: relight_bake {path(self.sources.job(name))}")
            lines.append(f"build {path(name)}.copy: step {path(name)}.ktx2")
        (self.folder / "build.ninja").write_text("\n".join(lines) + "\n")

    def command(self) -> list[str]:
        return ["ninja"]


class CMake(System):
    generator = ""

    @classmethod
    def lacks(cls) -> str:
        version = re.search(r"(\d+)\.(\d+)", run(["cmake", "--version"], ROOT))
        old = version is not None and (int(version[1]), int(version[2])) < (3, 30)
        return "CMake before 3.30 takes no # in names" if old else ""

    def write(self, options: list[str]) -> None:
        lines = [
            "cmake_minimum_required(VERSION 3.21)",
            "project(recipes LANGUAGES NONE)",
            f"include({ROOT}/examples/cmake/RelightBake.cmake)",
        ]
        for number, name in enumerate(self.sources.names):
            bake = f'NAME bake{number} INPUT "{self.sources.job(name)}" OUTPUT "{self.asset(name)}"'
            lines.append(f"relight_add_bake({bake} CACHE cache OPTIONS {' '.join(options)})")
            copy = f'OUTPUT "{name}.copy" COMMAND "{self.step}" "{self.asset(name)}" "{name}.copy"'
            lines.append(f'add_custom_command({copy} DEPENDS bake{number} "{self.asset(name)}" VERBATIM)')
            lines.append(f'add_custom_target(copy{number} ALL DEPENDS "{name}.copy")')
        (self.folder / "CMakeLists.txt").write_text("\n".join(lines) + "\n")
        program = f"-DRELIGHT_EXECUTABLE={self.program}"
        run(["cmake", "-G", self.generator, program, "-S", ".", "-B", "build"], self.folder)

    def command(self) -> list[str]:
        return ["cmake", "--build", "build", "--parallel", str(os.cpu_count())]


class CMakeNinja(CMake):
    name = "CMake (Ninja)"
    tools = ["cmake", "ninja"]
    generator = "Ninja"


class CMakeMakefiles(CMake):
    name = "CMake (Unix Makefiles)"
    tools = ["cmake", "make"]
    generator = "Unix Makefiles"


class Make(System):
    name = "Make"
    tools = ["make"]
    sees_commands = False

    def write(self, options: list[str]) -> None:
        def path(value: object) -> str:
            return str(value).replace(" ", "\\ ").replace("#", "$(hash)")

        lines = [
            f"relight = {self.program}",
            "relight_state = state",
            f"include {ROOT}/examples/make/relight.mk",
            "all:",
            "define step",
            "all: $(2)",
            f"$(2): $(1)\n\t{self.step} $(1) $(2)",
            "endef",
        ]
        for number, name in enumerate(self.sources.names):
            job, asset, copy = path(self.sources.job(name)), f"{path(name)}.ktx2", f"{path(name)}.copy"
            lines.append(f"$(eval $(call relight_bake,bake{number},{job},{asset},{' '.join(options)}))")
            lines.append(f"$(eval $(call step,{asset},{copy}))")
        (self.folder / "Makefile").write_text("\n".join(lines) + "\n")

    def command(self) -> list[str]:
        return ["make", f"-j{os.cpu_count()}"]


class Meson(System):
    name = "Meson"
    tools = ["meson", "ninja"]

    def asset(self, name: str) -> Path:
        return self.folder / "build" / f"{name}.ktx2"

    def write(self, options: list[str]) -> None:
        words = "".join(f", '{option}'" for option in options)
        lines = ["project('recipes', meson_version: '>= 1.1')"]
        for number, name in enumerate(self.sources.names):
            command = f"['{self.program}', 'bake', '@INPUT@', '-o', '@OUTPUT@', '--depfile', '@DEPFILE@', '--cache', 'cache'{words}]"
            lines.append(
                f"bake{number} = custom_target('bake{number}', input: '{self.sources.job(name)}', output: '{name}.ktx2', "
                f"depfile: '{name}.d', command: {command}, build_by_default: true)"
            )
            lines.append(
                f"custom_target('copy{number}', input: bake{number}, output: '{name}.copy', "
                f"command: ['{self.step}', '@INPUT@', '@OUTPUT@'], build_by_default: true)"
            )
        (self.folder / "meson.build").write_text("\n".join(lines) + "\n")
        if not (self.folder / "build").exists():
            run(["meson", "setup", "build"], self.folder)

    def command(self) -> list[str]:
        return ["ninja", "-C", "build"]


SYSTEMS = [Ninja, CMakeNinja, CMakeMakefiles, Make, Meson]


def run(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=600)
    if done.returncode != 0:
        raise Failed(f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout[-3000:]}")
    return done.stdout


class Counts:
    """Runs of the program and of the steps since the last look."""

    def __init__(self, folder: Path):
        self.folder = folder
        folder.mkdir()

    def take(self) -> tuple[int, list[str], str, float]:
        """How often the program ran, assets of the steps, what bakes said, and the CPU that they took in s."""
        texts = {}
        for name in ("program", "steps", "said", "times"):
            path = self.folder / name
            texts[name] = path.read_text() if path.exists() else ""
            path.unlink(missing_ok=True)
        seconds = sum(map(float, texts["times"].split()))
        return len(texts["program"].splitlines()), texts["steps"].splitlines(), texts["said"], seconds


def expect(what: str, found: object, expected: object) -> None:
    if found != expected:
        raise Failed(f"{what}: {found}, not {expected}")


def scripts(relight: Path, work: Path) -> tuple[Counts, Path, Path]:
    """What counts, the counting program and the step, in `work`."""
    counts = Counts(work / "log")
    for name, text in (("relight", COUNTING_PROGRAM), ("step", STEP)):
        (work / name).write_text(text.format(log=counts.folder, relight=relight))
        (work / name).chmod(0o755)
    return counts, work / "relight", work / "step"


def bakes_by_hand(relight: Path, work: Path) -> tuple[dict[str, bytes], float]:
    """All assets as they have to be in the end, made one after another without a cache, and the CPU that they took in s."""
    counts, program, _ = scripts(relight, work)
    sources = Sources(work / "src")
    sources.change()
    assets = {}
    for name in sources.names:
        sources.write_job(name, OTHER)
        asset = work / f"{name}.ktx2"
        run([str(program), "bake", str(sources.job(name)), "-o", str(asset)], work)
        assets[name] = asset.read_bytes()
    return assets, counts.take()[3]


def check(kind: type[System], relight: Path, work: Path, by_hand: tuple[dict[str, bytes], float]) -> str:
    """Holds one build system to the counts and to the bakes by hand; says what was measured."""
    counts, program, step = scripts(relight, work)
    sources = Sources(work / "src")
    system = kind(work / "build", sources, program, step)
    chosen = system.asset(sources.names[CHOSEN])

    def built(what: str, bakes: int, steps: int) -> tuple[str, float]:
        system.build()
        ran, copied, said, seconds = counts.take()
        expect(f"{what}: bakes and steps", (ran, len(copied)), (bakes, steps))
        if steps == 1:
            expect(f"{what}: the step's asset", Path(copied[0]).name, chosen.name)
        again = system.build()
        ran, copied, *_ = counts.take()
        expect(f"{what}, once more: bakes and steps", (ran, len(copied)), (0, 0))
        if kind in (Ninja, Meson) and "no work to do" not in again:
            raise Failed(f"{what}, once more: ninja says {again}")
        return said, seconds

    system.choose(FIRST)
    built("first", ASSETS, ASSETS)
    before = chosen.read_bytes()
    sources.picture().touch()
    built("a picture touched", 1, 0)
    expect("a picture touched: the same bytes", chosen.read_bytes() == before, True)
    sources.change()
    built("a picture changed", 1, 1)
    expect("a picture changed: the same bytes", chosen.read_bytes() == before, False)

    system.choose(OTHER)
    said, reused = built("another block", ASSETS, ASSETS)
    taken = len(re.findall(r"^cache: the fit is taken up", said, re.MULTILINE))
    expect("another block: fits taken up from the cache", taken, ASSETS)
    assets, fitted = by_hand
    for name in sources.names:
        expect(f"{name}: the bytes of a bake by hand", system.asset(name).read_bytes() == assets[name], True)
    figures = f"{taken} fits taken up, {reused:.2f} s CPU of bakes where all anew take {fitted:.2f} s, {fitted / reused:.1f} times less"
    return f"another block: {figures}" + (f", not {LESS_CPU}" if fitted < LESS_CPU * reused else "")


def main() -> int:
    relight = Path(shutil.which(sys.argv[1]) or sys.argv[1]).resolve()
    chosen = sys.argv[2:]
    failed = False
    with tempfile.TemporaryDirectory(prefix="relight-recipes-") as work:
        by_hand = bakes_by_hand(relight, Path(work))
    for kind in SYSTEMS:
        if chosen and kind.name not in chosen:
            continue
        missing = [tool for tool in kind.tools if not shutil.which(tool)]
        lacks = f"no {', '.join(missing)}" if missing else kind.lacks()
        if lacks:
            print(f"recipes: {kind.name} is skipped: {lacks}")
            continue
        # Make can write no name with spaces of what is included: the checkout may have them, this folder has none.
        with tempfile.TemporaryDirectory(prefix="relight-recipes-") as work:
            try:
                figures = check(kind, relight, Path(work), by_hand)
                print(f"recipes: {kind.name}: {ASSETS} assets, made when they should be; {figures}", flush=True)
            except Failed as failure:
                print(f"recipes: {kind.name}: {failure}", flush=True)
                failed = True
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
