"""How commands end that fail otherwise than by bad input: exit codes, one sentence, no traceback, nothing left."""

import os
import signal
import subprocess
import sys

import platformdirs
import pytest

from milkglass.viewer.commands import cli, materials

RUN = "import sys; from milkglass.viewer.commands.cli import main; sys.exit(main())"


def run_materials(stdout):
    command = [sys.executable, "-c", RUN, "materials"]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, check=False)


def fail(*_):
    raise IndexError("of ours")


@pytest.fixture
def logs(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_log_dir", lambda *_, **__: str(tmp_path / "logs"))
    return tmp_path / "logs"


def test_an_error_of_the_program_is_a_sentence_a_log_and_a_code_of_its_own(monkeypatch, capsys, logs):
    monkeypatch.setattr(materials, "run", fail)
    assert cli.main(["materials"]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "IndexError: of ours" in said
    (log,) = logs.iterdir()
    assert str(log) in said
    assert "Traceback" in log.read_text()
    assert "in fail" in log.read_text()


def test_with_debug_anywhere_it_is_raised(monkeypatch, logs):
    monkeypatch.setattr(materials, "run", fail)
    for words in (["--debug", "materials"], ["materials", "--debug"]):
        with pytest.raises(IndexError):
            cli.main(words)
    assert not logs.exists()


def test_a_log_that_cannot_be_written_goes_elsewhere(monkeypatch, capsys, logs, tmp_path):
    logs.write_text("no folder")
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path / "temporary"))
    monkeypatch.setattr(materials, "run", fail)
    assert cli.main(["materials"]) == 3
    (log,) = (tmp_path / "temporary").iterdir()
    assert str(log) in capsys.readouterr().err


def test_what_the_system_refuses_of_a_file_names_it(monkeypatch, capsys):
    def refuse(*_):
        raise PermissionError(13, "Permission denied", "/some/file")

    monkeypatch.setattr(materials, "run", refuse)
    assert cli.main(["materials"]) == 2
    assert capsys.readouterr().err.startswith("milkglass: /some/file: Permission denied")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_full_disk_while_printing_is_one_sentence():
    with open("/dev/full", "wb") as full:
        done = run_materials(full)
    assert done.returncode == 2
    assert done.stderr.decode().startswith("milkglass: the output could not be written (No space left on device)")
    assert done.stderr.count(b"\n") == 1


def test_a_closed_pipe_is_quiet():
    reader, writer = os.pipe()
    os.close(reader)
    done = run_materials(writer)
    os.close(writer)
    assert done.stderr == b""
    assert done.returncode == 128 + signal.SIGPIPE


def test_termination_takes_half_written_files_away(tmp_path):
    code = f"""
import time
from milkglass.viewer.commands import materials
from milkglass.viewer.scene.whole_file import replacement
def run(*_):
    with replacement({str(tmp_path / "a.exr")!r}) as temporary:
        temporary.write_text("half")
        print("writing", flush=True)
        time.sleep(60)
materials.run = run
{RUN}"""
    with subprocess.Popen([sys.executable, "-c", code, "materials"], stdout=subprocess.PIPE) as writing:
        assert writing.stdout is not None
        assert writing.stdout.readline() == b"writing\n"
        assert len(list(tmp_path.iterdir())) == 1
        writing.terminate()
        assert writing.wait() == 128 + signal.SIGTERM
    assert not list(tmp_path.iterdir())
