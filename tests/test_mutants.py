"""The list of planted faults applies, and its runner tells faults that tests notice from those that they do not."""

import subprocess
from pathlib import Path

import pytest

from tests.mutants.__main__ import Copy, chosen, judged
from tests.mutants.faults import FAULTS, Fault
from tests.support.paths import ROOT


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_of_the_list_applies(fault):
    """Its text stands in its file once, and its tests are there."""
    assert (ROOT / fault.file).read_text(encoding="utf-8").count(fault.old) == 1
    assert fault.new != fault.old
    for test in fault.tests.split():
        file, _, name = test.partition("::")
        text = (ROOT / "tests" / file).read_text(encoding="utf-8")
        assert not name or f"\ndef {name}(" in text


def test_names_of_faults_are_theirs_alone_and_tenths_are_all_of_them():
    names = [fault.name for fault in FAULTS]
    assert len(set(names)) == len(names)
    assert sorted(names) == sorted(fault.name for tenth in range(10) for fault in chosen([], tenth))
    assert chosen(names[3:5], None) == list(FAULTS[3:5])


def repository(folder: Path) -> Path:
    """Make a small one: a module, linked as the package is, and tests that call it, here and in a process."""
    files = {
        "core/one.py": "VALUE = 1\n",
        ".package/one_package/__init__.py": "",
        "pyproject.toml": '[tool.pytest.ini_options]\npythonpath = [".package", "."]\n',
        "tests/test_here.py": "from one_package.core.one import VALUE\n\ndef test_value():\n    assert VALUE == 1\n",
        "tests/test_process.py": "import subprocess, sys\n\ndef test_value():\n"
        "    code = 'from one_package.core.one import VALUE; assert VALUE == 1'\n"
        "    subprocess.run([sys.executable, '-c', code], check=True)\n",
        "tests/test_nothing.py": "def test_nothing():\n    pass\n",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    (folder / ".package" / "one_package" / "core").symlink_to("../../core")
    (folder / "untracked.py").write_text("")
    subprocess.run(["git", "init", "-q"], cwd=folder, check=True)
    subprocess.run(["git", "add", *files, ".package"], cwd=folder, check=True)
    return folder


@pytest.mark.slow
def test_what_is_noticed_is_killed_and_all_else_is_not(tmp_path, capsys):
    copy = Copy(tmp_path / "copy", repository(tmp_path / "original"))
    assert not (copy.folder / "untracked.py").exists()
    assert (copy.folder / ".package" / "one_package" / "core").is_symlink()
    here, process, nothing = (
        Fault(name, "core/one.py", "VALUE = 1", "VALUE = 2", f"test_{name}.py")
        for name in ("here", "process", "nothing")
    )
    gone = here._replace(name="gone", old="VALUE = 3")
    assert judged([here, process], copy)
    assert not judged([nothing], copy)
    assert not judged([gone], copy)
    words = [line.split()[0] for line in capsys.readouterr().out.splitlines() if " s  " in line]
    assert words == ["killed", "killed", "survived", "does"]
    assert (copy.folder / "core" / "one.py").read_text() == "VALUE = 1\n"
    assert (tmp_path / "original" / "core" / "one.py").read_text() == "VALUE = 1\n"


@pytest.mark.slow
def test_tests_that_fail_without_a_fault_judge_none(tmp_path, capsys):
    original = repository(tmp_path / "original")
    (original / "core" / "one.py").write_text("VALUE = 7\n")
    fault = Fault("here", "core/one.py", "VALUE = 7", "VALUE = 2", "test_here.py")
    assert not judged([fault], Copy(tmp_path / "copy", original))
    assert "without a fault the tests end with 1" in capsys.readouterr().out


@pytest.mark.slow
def test_the_copy_is_what_its_tests_and_their_processes_import(tmp_path):
    """Not what is installed: a fault in what a process says, and one in a number."""
    copy = Copy(tmp_path)
    for file, old, new, tests in (
        ("core/grid/atlas.py", "self.origins + 0.5,", "self.origins + 1.5,", "core/grid/test_atlas.py"),
        ("viewer/scene/settings.py", "high=128", "high=127", "viewer/commands/test_cli.py::test_as_a_program"),
    ):
        assert copy.judge(Fault("none", file, old, new, tests))[0] == "killed"
