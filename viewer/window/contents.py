"""What fills the window: view, panel and actions for a model, or for a photograph."""

from collections.abc import Callable

import moderngl

from milkglass.viewer.gui.renderer import ImguiRenderer
from milkglass.viewer.gui.toolkit import Gui
from milkglass.viewer.live.photograph_work import PhotoWork
from milkglass.viewer.session.preferences import Preferences
from milkglass.viewer.session.session import Session
from milkglass.viewer.window.panel.panel import Panel
from milkglass.viewer.window.photograph.actions import PhotoActions
from milkglass.viewer.window.photograph.view import PhotoView
from milkglass.viewer.window.view.actions import Actions, Clipboard
from milkglass.viewer.window.view.area import ViewArea


def make_contents(
    graphics: tuple[moderngl.Context, Gui, ImguiRenderer],
    session: Session,
    preferences: Preferences,
    clipboard: Clipboard,
    wake: Callable[[], object],
    photo: PhotoWork | None,
) -> tuple[ViewArea, Panel, Actions]:
    """Make the parts of the window that show and change a session; parameters as of `viewer.window.app.App`."""
    panel = Panel(session, graphics[1], photo)
    if photo is None:
        view = ViewArea(*graphics, session, wake)
        return view, panel, Actions(session, view, preferences, clipboard)
    session.view.photograph = photo.photo.path.name
    photo_view = PhotoView(*graphics, session, wake, photo)
    return photo_view, panel, PhotoActions(session, photo_view, preferences, clipboard, photo)
