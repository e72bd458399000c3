"""Who may import whom: the contracts of pyproject.toml hold, and each reports a breach that is planted in a copy."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.paths import ROOT

pytest.importorskip("importlinter")
LINT = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"

# Contract -> a module, by its path, and a line that it may not hold.
BREACHES = {
    "core knows no window, no OpenGL and no viewer": ("core/grid/layers.py", "import moderngl"),
    "core, from the top floor down": ("core/material/library.py", "import milkglass.core.grid.layers"),
    "diffusion needs no Ewald": ("core/transport/diffusion/solver.py", "import milkglass.core.transport.ewald"),
    "viewer, from the top floor down": ("viewer/scene/scene.py", "import milkglass.viewer.session.navigation"),
    "window, from the top floor down": ("viewer/window/panel/panel.py", "import milkglass.viewer.window.app"),
    "what a picture is of knows no OpenGL and no widget": ("viewer/session/session.py", "import moderngl"),
    "Dear ImGui has one door": ("viewer/live/live.py", "import imgui_bundle"),
    "only the window opens windows": ("viewer/render/picture.py", "import glfw"),
}


def contracts() -> list[str]:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    return [contract["name"] for contract in settings["tool"]["importlinter"]["contracts"]]


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str | None, str], dict[str, str]]:
    """Lint a copy of the tree with one more line at the end of a module: contract -> KEPT or BROKEN."""
    copy = tmp_path_factory.mktemp("tree")
    for name in (".package", "core", "viewer", "shaders"):
        shutil.copytree(ROOT / name, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", copy)
    environment = os.environ | {"PYTHONPATH": str(copy / ".package")}

    def lint(path: str | None, line: str) -> dict[str, str]:
        file = copy / (path or "pyproject.toml")
        before = file.read_text("utf-8")
        if path is not None:
            file.write_text(f"{before}\n{line}\n", "utf-8")
        command = [sys.executable, "-c", LINT, "--no-cache", "--no-logo"]
        try:
            done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
        finally:
            file.write_text(before, "utf-8")
        found = dict(re.findall(r"^(.+?) (KEPT|BROKEN)\b", done.stdout, re.MULTILINE))
        assert set(found) == set(contracts()), done.stdout + done.stderr
        return found

    return lint


def test_every_contract_is_kept(verdicts: Callable[[str | None, str], dict[str, str]]) -> None:
    assert set(verdicts(None, "").values()) == {"KEPT"}


def test_every_contract_has_a_breach() -> None:
    assert set(contracts()) == set(BREACHES)
    assert all(Path(ROOT / path).is_file() for path, _ in BREACHES.values())


@pytest.mark.parametrize("contract", BREACHES)
def test_a_planted_breach_is_reported(verdicts: Callable[[str | None, str], dict[str, str]], contract: str) -> None:
    assert verdicts(*BREACHES[contract])[contract] == "BROKEN"
