"""What the pages say is what there is."""

import re
from collections import Counter

import pytest

from milkglass.core.provenance import constants_markdown
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.viewer.commands.cli import app
from milkglass.viewer.scene.settings_docs import settings_markdown
from tests.support.paths import ROOT

PAGES = ("README.md", "core/README.md", "viewer/README.md", "viewer/sweep/README.md", "shaders/README.md")
TEXTS = {page: (ROOT / page).read_text(encoding="utf-8") for page in PAGES}
PATH = r"`((?:core|viewer|shaders|tests)/[\w./]+)`"


def anchors(page: str) -> set[str]:
    """Return the anchors of a page's headings, as they are made of their words."""
    headings = re.findall(r"^#+ (.+)$", TEXTS[page], re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_readme_is_read_in_five_minutes() -> None:
    assert TEXTS["README.md"].count("\n") <= 250


def test_there_are_two_commands_of_one_line_each() -> None:
    blocks = re.findall(r"```sh\n(.*?)```", TEXTS["README.md"], re.DOTALL)
    assert len(blocks) == 2
    assert all(block.count("\n") == 1 for block in blocks)
    assert blocks[0].strip().endswith("milkglass")
    assert " -m pytest" in blocks[1]


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere(page: str) -> None:
    folder = (ROOT / page).parent
    links = re.findall(r"\]\((?!https?:)([^)]+)\)", TEXTS[page])
    for link in links:
        target, _, anchor = link.partition("#")
        path = (folder / target).resolve() if target else ROOT / page
        assert path.exists(), link
        if anchor:
            assert anchor in anchors(str(path.relative_to(ROOT))), link


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_it_names_exists(page: str) -> None:
    named = re.findall(PATH, TEXTS[page])
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_the_table_of_keys_is_the_table_of_settings() -> None:
    assert settings_markdown().strip() in TEXTS["viewer/README.md"]


def test_the_table_of_constants_is_the_record() -> None:
    assert constants_markdown(CONSTANTS).strip() in TEXTS["core/README.md"]


def test_every_command_is_named() -> None:
    commands = {command.callback.__name__ for command in app.registered_commands}  # type: ignore[union-attr]
    assert all(f"milkglass {name}" in TEXTS["viewer/README.md"] for name in commands)


def test_no_row_of_figures_stands_twice() -> None:
    rows = Counter(
        line for text in TEXTS.values() for line in text.splitlines() if line.startswith("|") and re.search(r"\d", line)
    )
    assert [row for row, count in rows.items() if count > 1] == []


@pytest.mark.parametrize("page", ["core/README.md", "viewer/README.md"])
def test_headings_answer_a_question(page: str) -> None:
    headings = re.findall(r"^##+ (.+)$", TEXTS[page], re.MULTILINE)
    assert headings
    assert [heading for heading in headings if not heading.endswith("?")] == []
