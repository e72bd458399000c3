"""What the README says is what there is."""

import re

from milkglass.viewer.commands.cli import app
from milkglass.viewer.scene.settings_docs import settings_markdown
from tests.support.paths import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_table_of_keys_is_the_table_of_settings() -> None:
    assert settings_markdown().strip() in README


def test_there_are_two_commands_of_one_line_each() -> None:
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    assert len(blocks) == 2
    assert all(block.count("\n") == 1 for block in blocks)
    assert blocks[0].strip().endswith("milkglass")
    assert " -m pytest" in blocks[1]


def test_every_file_that_it_names_exists() -> None:
    named = re.findall(r"\]\(([^)#:]+)\)", README) + re.findall(
        r"`((?:core|viewer|shaders|tests)/[\w./]+\.\w+)`", README
    )
    assert named
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_command_is_named() -> None:
    commands = {command.callback.__name__ for command in app.registered_commands}  # type: ignore[union-attr]
    assert all(f"milkglass {name}" in README for name in commands)
