"""Where the sources of this checkout lie, for tests that read files or start programs."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
SHADERS = ROOT / "shaders"
PACKAGES = ROOT / ".package"  # what a program started by a test finds `milkglass` in
DATA = Path(
    os.environ.get("MILKGLASS_DATA", ROOT.parent / "shared" / "data")
)  # third-party meshes, probes, a photograph
