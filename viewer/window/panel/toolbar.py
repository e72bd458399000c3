"""The row of buttons at the top of the panel: the commands that have one."""

from typing import Any

from milkglass.viewer.gui.command import Command, Commands
from milkglass.viewer.gui.controls import Controls
from milkglass.viewer.gui.toolkit import imgui


class Toolbar:
    """Draws the buttons of commands; one that needs an argument opens a menu of its choices."""

    def __init__(self, controls: Controls, commands: Commands[Any]) -> None:
        self._controls, self._commands = controls, commands

    def draw(self) -> None:
        """Draw the row in the current ImGui window."""
        commands = self._commands
        menus = []
        for command, button in commands.buttons():
            imgui.begin_disabled(not commands.can_press(command))
            if self._controls.icon(command.id, button.icon, commands.tip(command, button), on=commands.is_on(button)):
                if command.argument is None:
                    commands.request(command.id)
                else:
                    imgui.open_popup(command.id)
            imgui.end_disabled()
            imgui.same_line()
            if command.argument is not None:
                menus.append(command)
        imgui.new_line()
        for command in menus:
            self._menu(command)

    def _menu(self, command: Command[Any]) -> None:
        """Draw the choices of a command's argument while its menu is open."""
        if not imgui.begin_popup(command.id):
            return
        for argument, label in self._commands.choices(command).items():
            clicked, _ = imgui.selectable(f"{label}##{argument}", False)
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip.value):
                self._controls.tooltip("", argument)
            if clicked:
                self._commands.request(command.id, argument)
        imgui.end_popup()
