"""The keys, in one table: what they do, the cheat sheet and the README's list."""

from dataclasses import dataclass

from milkglass.viewer.gui.toolkit import imgui


@dataclass(frozen=True)
class Shortcut:
    """Keys (as people read them) and the action of `viewer.window.view.actions` that they call."""

    keys: str
    action: str
    what: str


SHORTCUTS: dict[str, tuple[Shortcut, ...]] = {
    "View": (
        Shortcut("1", "view_front", "view from the front"),
        Shortcut("Ctrl+1", "view_back", "view from the back"),
        Shortcut("3", "view_right", "view from the right"),
        Shortcut("Ctrl+3", "view_left", "view from the left"),
        Shortcut("7", "view_top", "view from above"),
        Shortcut("Ctrl+7", "view_bottom", "view from below"),
        Shortcut("5", "toggle_orthographic", "perspective or orthographic"),
        Shortcut("Enter", "reset_view", "reset the view"),
        Shortcut("Ctrl+C", "copy_view", "copy the view as text"),
        Shortcut("Ctrl+V", "paste_view", "paste a view"),
    ),
    "Files": (
        Shortcut("Ctrl+O", "open_file", "open a model, probe or scene"),
        Shortcut("Ctrl+S", "save", "save the scene"),
        Shortcut("Ctrl+Shift+S", "save_as", "save the scene under a new name"),
        Shortcut("F12", "screenshot", "picture of the window"),
        Shortcut("Ctrl+F12", "screenshot_object", "picture of the object alone, transparent"),
        Shortcut("Ctrl+Q", "quit", "quit"),
    ),
    "Edit": (
        Shortcut("Ctrl+Z", "undo", "undo"),
        Shortcut("Ctrl+Shift+Z", "redo", "redo"),
        Shortcut("K", "keep", "keep this state as B"),
        Shortcut("B", "flip", "flip between A and B"),
        Shortcut("V", "toggle_split", "split the view between A and B"),
        Shortcut("L", "toggle_exposure_lock", "lock the exposure"),
        Shortcut("E", "toggle_measure", "measure the error of what is on screen"),
    ),
    "Window": (
        Shortcut("H", "toggle_help", "this cheat sheet"),
        Shortcut("Tab", "toggle_panel", "show or hide the panel"),
        Shortcut("P", "toggle_profiles", "show or hide the curves of the profile"),
        Shortcut("Escape", "dismiss", "close what is open, dismiss messages"),
    ),
}
MOUSE = (
    ("Left drag", "orbit"),
    ("Shift + left drag, middle drag", "pan"),
    ("Wheel", "zoom"),
    ("Right drag", "turn the lights and the probe"),
    ("Double click", "set the point that the camera orbits"),
    ("Drop a file", "mesh: load it; .hdr, .exr: light with it; .csv: scatter by it; .toml: open the scene"),
    ("Ctrl + click on a slider", "type a number"),
    ("Right click on a control", "reset it"),
)

_KEYS = {"Enter": "enter", "Escape": "escape", "Tab": "tab"} | {f"{i}": f"_{i}" for i in range(10)}


def pressed_actions() -> list[str]:
    """Return the actions whose keys went down in this frame."""
    return [
        shortcut.action
        for group in SHORTCUTS.values()
        for shortcut in group
        if any(imgui.is_key_chord_pressed(chord) for chord in _chords(shortcut.keys))
    ]


def shortcuts_markdown() -> str:
    """Return the mouse and the keys as a Markdown table."""
    rows = ["| mouse, keys | what they do |", "|---|---|"]
    rows += [f"| {keys} | {what} |" for keys, what in MOUSE]
    rows += [f"| {shortcut.keys} | {shortcut.what} |" for group in SHORTCUTS.values() for shortcut in group]
    return "\n".join(rows) + "\n"


def _chords(keys: str) -> list[int]:
    """Return ImGui's numbers of a combination, the keypad's too."""
    *modifiers, key = keys.split("+")
    held = sum(getattr(imgui.Key, f"mod_{name.lower()}").value for name in modifiers)
    names = [_KEYS.get(key, key.lower())]
    if key.isdigit():
        names.append(f"keypad{key}")
    if key == "Enter":
        names.append("keypad_enter")
    return [held | getattr(imgui.Key, name).value for name in names]
