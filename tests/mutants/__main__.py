"""Plants the faults of `tests.mutants.faults` one at a time, and tells which of them the tests notice.

python -m tests.mutants                 all of them
python -m tests.mutants NAME [NAME ...] those
python -m tests.mutants --tenth N       a tenth of them, N from 0 to 9
python -m tests.mutants --list          names, files and tests, without a run

The tracked files are copied once; faults are planted in the copy, whose own modules its tests and their processes
import. A fault is killed where a test fails, and survives where all pass. The tests must pass without a fault first.
The exit code is 1 where a fault survives, where a run ends otherwise, or where a row no longer applies.
"""

# ruff: noqa: T201  (what it prints is what it is for)

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from tests.mutants.faults import FAULTS, Fault
from tests.support.paths import DATA, ROOT

PASSED, FAILED = 0, 1  # exit codes of pytest
LONGEST = 900.0  # seconds of one run: beyond, a fault hangs


class Copy:
    """The tracked files of a repository in another folder, to plant faults in."""

    def __init__(self, folder: Path, root: Path = ROOT) -> None:
        self.folder, self._loops = folder, folder / ".numba"
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, check=True, capture_output=True, text=True).stdout
        for name in filter(None, listed.split("\0")):
            if not os.path.lexists(root / name):  # deleted, and not committed yet
                continue
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(root / name, folder / name, follow_symlinks=False)

    def test(self, tests: Iterable[str]) -> tuple[int, str]:
        """Return the exit code of pytest, and the first test that failed or else the end of what was printed."""
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
        command += [f"tests/{name}" for name in tests]
        settings = {
            "PYTHONPATH": str(self.folder / ".package"),
            "MILKGLASS_DATA": str(DATA),
            "NUMBA_CACHE_DIR": str(self._loops),
        }
        try:
            ran = subprocess.run(
                command, cwd=self.folder, env=os.environ | settings, capture_output=True, text=True, timeout=LONGEST
            )
        except subprocess.TimeoutExpired:
            return -1, f"no end after {LONGEST:g} s"
        lines = (ran.stdout + ran.stderr).splitlines()
        failed = [line.removeprefix("FAILED ").split(" - ")[0] for line in lines if line.startswith("FAILED ")]
        return ran.returncode, failed[0] if failed else " ".join(lines[-3:])

    def judge(self, fault: Fault) -> tuple[str, str]:
        """Return what becomes of a fault, "killed", "survived" or what went wrong, and by which test."""
        path = self.folder / fault.file
        text = path.read_text(encoding="utf-8")
        if (count := text.count(fault.old)) != 1:
            return "does not apply", f"{fault.file} has its text {count} times"
        try:
            self._write(path, text.replace(fault.old, fault.new))
            code, detail = self.test(fault.tests.split())
        finally:
            self._write(path, text)
        return {PASSED: "survived", FAILED: "killed"}.get(code, f"ended with {code}"), detail

    def _write(self, path: Path, text: str) -> None:
        path.write_text(text, encoding="utf-8")
        if path.suffix == ".py":  # of one second and one size the compiled file would be taken for that of the text
            Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)
        if "compiled" in text:  # Numba does not see that a loop of another file has changed
            shutil.rmtree(self._loops, ignore_errors=True)


def chosen(names: Sequence[str], tenth: int | None) -> list[Fault]:
    """Return the faults that a command line asks for, in the order of the list."""
    if unknown := set(names) - {fault.name for fault in FAULTS}:
        raise SystemExit(f"unknown: {', '.join(sorted(unknown))}")
    faults = list(FAULTS) if tenth is None else list(FAULTS[tenth::10])
    return [fault for fault in faults if not names or fault.name in names]


def judged(faults: Sequence[Fault], copy: Copy) -> bool:
    """Plant faults one after another, print a line on each, and return whether all were killed."""
    code, detail = copy.test(sorted({name for fault in faults for name in fault.tests.split()}))
    if code != PASSED:
        print(f"without a fault the tests end with {code}: {detail}")
        return False
    outcomes = []
    for fault in faults:
        start = time.monotonic()
        outcome, detail = copy.judge(fault)
        outcomes.append(outcome)
        print(f"{outcome:9} {fault.name:44} {time.monotonic() - start:6.1f} s  {detail}", flush=True)
    print(f"{outcomes.count('killed')} of {len(outcomes)} killed")
    return outcomes.count("killed") == len(outcomes)


def main() -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description="Plant faults and run their tests.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="of faults; all of them without")
    parser.add_argument("--tenth", type=int, choices=range(10), metavar="N", help="a tenth of the list, 0 to 9")
    parser.add_argument("--list", action="store_true", help="print the list alone")
    options = parser.parse_args()
    faults = chosen(options.names, options.tenth)
    if options.list:
        for fault in faults:
            print(f"{fault.name:44} {fault.file:44} {fault.tests}")
        return 0
    with tempfile.TemporaryDirectory(prefix="milkglass-mutants-") as folder:
        return 0 if judged(faults, Copy(Path(folder))) else 1


if __name__ == "__main__":
    sys.exit(main())
