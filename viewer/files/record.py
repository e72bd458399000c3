"""What a picture file says of its making: the scene, the samples and the version, as text that makes it again."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from milkglass.core.errors import InputError
from milkglass.viewer.scene.scene import Scene

SCENE, SAMPLES, SEED, SOFTWARE = "milkglass:scene", "milkglass:samples", "milkglass:seed", "Software"
RECORDED = (".png", ".exr")
VERSION = metadata.version("milkglass")


@dataclass(frozen=True)
class Record:
    """How a picture was made.

    Attributes
    ----------
    scene : str
        Text of the scene file, with absolute paths; empty where a mesh or a probe in memory is of no file.
    samples, seed : int
        Antialiasing samples of a pixel, and the seed of their pattern.
    version : str
    """

    scene: str
    samples: int
    seed: int
    version: str = VERSION

    @classmethod
    def of(cls, scene: Scene, samples: int, seed: int) -> "Record":
        """Return the record of a picture of a scene."""
        in_memory = scene.model.mesh is not None or scene.environment.probe is not None
        return cls("" if in_memory else scene.to_toml(), samples, seed)

    def texts(self) -> dict[str, str]:
        """Return the texts of a file, ASCII, by name."""
        of_scene = {} if not self.scene else {SCENE: _ascii(self.scene)}
        return of_scene | {
            SAMPLES: str(self.samples), SEED: str(self.seed), SOFTWARE: f"milkglass {self.version}"
        }  # fmt: skip


def is_picture(path: str | os.PathLike[str]) -> bool:
    """Tell whether a path is a picture's, of a kind that says how it was made."""
    return Path(path).suffix.lower() in RECORDED


def read_record(path: str | os.PathLike[str]) -> tuple[Scene, int, int]:
    """Return the scene, the samples and the seed that a picture was made of.

    Raises
    ------
    InputError
        If the file cannot be read, or says nothing of a scene.
    """
    from milkglass.viewer.files.images import read_texts

    path = Path(path)
    texts: Mapping[str, str] = read_texts(path)
    if SCENE not in texts:
        raise InputError(f"{path} says nothing of a scene; name a picture of milkglass's own, or a scene file")
    try:
        scene = Scene.from_toml(texts[SCENE])
        return scene, *(_number(texts.get(key, ""), least) for key, least in ((SAMPLES, 1), (SEED, 0)))  # type: ignore[return-value]
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _number(text: str, least: int) -> int:
    if not text.isdecimal() or len(text) > 10 or int(text) < least:
        raise InputError("the record of its samples is damaged; render it anew")
    return int(text)


def _ascii(text: str) -> str:
    """Return TOML in ASCII: text of PNG has no other letters that all programs agree on."""
    return "".join(
        letter if letter.isascii() else f"\\u{ord(letter):04x}" if ord(letter) < 1 << 16 else f"\\U{ord(letter):08x}"
        for letter in text
    )
