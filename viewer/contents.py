"""What fills the window: view, panel and actions for a model, or for a photograph."""

from collections.abc import Callable

import moderngl

from viewer.actions import Actions, Clipboard
from viewer.gui import Gui
from viewer.imgui_renderer import ImguiRenderer
from viewer.panel import Panel
from viewer.photo_actions import PhotoActions
from viewer.photo_view import PhotoView
from viewer.photo_work import PhotoWork
from viewer.preferences import Preferences
from viewer.session import Session
from viewer.view import ViewArea


def make_contents(
    graphics: tuple[moderngl.Context, Gui, ImguiRenderer],
    session: Session,
    preferences: Preferences,
    clipboard: Clipboard,
    wake: Callable[[], object],
    photo: PhotoWork | None,
) -> tuple[ViewArea, Panel, Actions]:
    """Make the parts of the window that show and change a session; parameters as of `viewer.app.App`."""
    panel = Panel(session, graphics[1], photo)
    if photo is None:
        view = ViewArea(*graphics, session, wake)
        return view, panel, Actions(session, view, preferences, clipboard)
    session.view.photograph = photo.photo.path.name
    photo_view = PhotoView(*graphics, session, wake, photo)
    return photo_view, panel, PhotoActions(session, photo_view, preferences, clipboard, photo)
