"""Where the sources of this checkout lie, for tests that read files or start programs."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
SHADERS = ROOT / "shaders"
PACKAGES = ROOT / ".package"  # what a program started by a test finds `milkglass` in
