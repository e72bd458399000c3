"""`milkglass view` that notes the id of every command it runs, a line each: test_window.py presses its keys."""

import sys
from pathlib import Path

from milkglass.viewer.gui.command import Command
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.window import window


def main(scene: Path, noted: Path, record: Path) -> None:
    run = Command.run

    def note(command: Command, *given: object) -> None:
        run(command, *given)
        with noted.open("a") as file:
            file.write(f"{command.id}\n")

    Command.run = note
    window.run(Scene.load(scene), path=scene, record=record)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[sys.argv.index("--record") + 1]))
