"""Prints the lowest version of each package that pyproject.toml allows, as constraints for pip.

python -m tests.support.lowest > constraints.txt; pip install -e '.[dev,bench,photo]' -c constraints.txt
"""

import re
import tomllib
from itertools import chain

from tests.support.paths import ROOT

LOWEST = re.compile(r"([A-Za-z0-9._-]+)>=([0-9.]+)")


def lowest() -> list[str]:
    """Return a constraint for each package that is declared with a lower bound, `name==version`."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = chain(project["dependencies"], *project["optional-dependencies"].values())
    return [f"{found[1]}=={found[2]}" for words in declared if (found := LOWEST.match(words))]


if __name__ == "__main__":
    print(*lowest(), sep="\n")  # noqa: T201
