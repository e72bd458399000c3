"""What tooltips of settings say, to who has never seen a scene file."""

import re

from milkglass.viewer.gui.controls import default_of, explained
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.lights import LIGHT_KINDS
from milkglass.viewer.scene.settings import TABLES

SHOWN = [
    *((f"{table}.{key}", declared, default_of(table, key)) for table, keys in TABLES.items()
      for key, declared in settings_of(keys).items()),
    *((f"{kind}.{key}", declared, None) for kind, light in LIGHT_KINDS.items()
      for key, declared in settings_of(light).items()),
]  # fmt: skip
KEYS = r"\b[a-z0-9]+_\w+|True|False|-1e|instead of (name|path|builtin|mix)"
NO_ROW = re.compile(
    "material.(name|mix_(sigma|eta|g)|diffuse_mean)|display.(image_size|transform)|model.(path|builtin)|environment.path"
)


def test_tooltips_speak_of_no_scene_file():
    texts = {name: explained(declared, default) for name, declared, default in SHOWN if not NO_ROW.match(name)}
    assert {name: text for name, text in texts.items() if re.search(KEYS, text)} == {}
