#!/usr/bin/env python3
"""Builds the examples for build systems as they stand in examples/, in a copy, and compares their assets with a bake by hand.

    tests/recipes/examples.py RELIGHT

Systems that are not installed are skipped, which is said; exit code 1 where one fails or the bytes differ.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# Name, tools, folder of the example, commands, asset (below the folder), the file made from it.
EXAMPLES = [
    ("Ninja", ["ninja"], "ninja", ["ninja"], "out/icon.ktx2", None),
    ("Make", ["make"], "make", ["make"], "out/icon.ktx2", "out/icon.txt"),
    ("CMake", ["cmake", "make"], "cmake", ["sh", "-c", "cmake -B b . && cmake --build b"], "b/icon.ktx2", "b/icon.txt"),
    ("Meson", ["meson", "ninja"], "meson", ["sh", "-c", "meson setup b && ninja -C b"], "b/icon.ktx2", "b/icon.txt"),
    ("Bazel", ["bazel"], "bazel", ["bazel", "--output_user_root={work}/bazel", "--batch", "build", "//:icon"], "bazel-bin/icon.ktx2", None),
]


def reads_workspace() -> bool:
    """Whether this Bazel reads WORKSPACE, which the example has: before 8. Debian's calls itself no_version, and is 4.2."""
    said = subprocess.run(["bazel", "--version"], stdout=subprocess.PIPE, text=True, timeout=60).stdout
    version = re.search(r"bazel (\d+)\.", said)
    return version is None or int(version[1]) < 8


def run(command: list[str], folder: Path, environment: dict[str, str]) -> str:
    """What went wrong, or nothing."""
    done = subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300)
    return "" if done.returncode == 0 else f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout[-3000:]}"


def main() -> int:
    relight = Path(shutil.which(sys.argv[1]) or sys.argv[1]).resolve()
    failed = False
    with tempfile.TemporaryDirectory(prefix="relight-examples-") as name:
        work = Path(name)
        shutil.copytree(ROOT / "examples", work / "examples")
        shutil.copytree(ROOT / "testdata" / "icon72", work / "testdata" / "icon72")
        (work / "bin").mkdir()
        (work / "bin" / "relight").symlink_to(relight)
        environment = {**os.environ, "PATH": f"{work / 'bin'}:{os.environ['PATH']}"}
        alone = work / "alone.ktx2"
        wrong = run(["relight", "bake", str(work / "examples" / "icon.toml"), "-o", str(alone), "--mips"], work, environment)
        if wrong:
            print(f"recipes: {wrong}")
            return 1
        for system, tools, folder, command, asset, made in EXAMPLES:
            missing = [tool for tool in tools if not shutil.which(tool)]
            if missing:
                print(f"recipes: the example for {system} is skipped: no {', '.join(missing)}")
                continue
            if system == "Bazel" and not reads_workspace():
                print("recipes: the example for Bazel is skipped: this one reads no WORKSPACE")
                continue
            place = work / "examples" / folder
            wrong = run([word.format(work=work) for word in command], place, environment)
            if not wrong and (place / asset).read_bytes() != alone.read_bytes():
                wrong = f"{asset} differs from a bake by hand"
            if not wrong and made and not (place / made).read_text():
                wrong = f"{made} is empty"
            print(f"recipes: the example for {system}: {wrong or 'the bytes of a bake by hand'}", flush=True)
            failed |= bool(wrong)
        # Bazel's folders are read-only.
        run(["chmod", "-R", "u+w", str(work)], work, environment)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
