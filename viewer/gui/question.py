"""A question in the middle of the window that waits for one of a few answers."""

from collections.abc import Callable
from dataclasses import dataclass

from milkglass.viewer.gui.toolkit import imgui

TITLE = "question"


def _nothing() -> None:
    """Leave everything as it is."""


@dataclass(frozen=True)
class Answer:
    """A button of a question, and what it does."""

    label: str
    run: Callable[[], object] = _nothing


@dataclass(frozen=True)
class Question:
    """A sentence and its answers: Enter gives the first, Escape the last, an initial letter the one that it begins."""

    text: str
    answers: tuple[Answer, ...]


class Questions:
    """Shows questions in a modal dialog, one after another."""

    def __init__(self) -> None:
        self.boxes: dict[str, tuple[float, float, float, float]] = {}  # of the buttons of the last frame, by label
        self._waiting: list[Question] = []

    @property
    def current(self) -> Question | None:
        """The question that shows."""
        return self._waiting[0] if self._waiting else None

    def ask(self, question: Question) -> None:
        """Show a question, after those that wait already; one that waits is not asked twice."""
        if all(question.text != waiting.text for waiting in self._waiting):
            self._waiting.append(question)

    def draw(self) -> None:
        """Draw the question while there is one, and run the answer given."""
        self.boxes.clear()
        question = self.current
        if question is None:
            return
        appears = not imgui.is_popup_open(TITLE)
        if appears:
            imgui.open_popup(TITLE)
        size, em = imgui.get_io().display_size, imgui.get_font_size()
        imgui.set_next_window_pos((0.5 * size.x, 0.5 * size.y), imgui.Cond_.always.value, (0.5, 0.5))
        imgui.set_next_window_size((min(30.0 * em, 0.95 * size.x), 0.0))
        flags = imgui.WindowFlags_.no_resize.value | imgui.WindowFlags_.no_title_bar.value
        if not imgui.begin_popup_modal(TITLE, None, flags)[0]:
            return
        imgui.push_text_wrap_pos(0.0)
        imgui.text_unformatted(question.text)
        imgui.pop_text_wrap_pos()
        imgui.spacing()
        given = self._buttons(question)
        if given is None and not appears:  # keys that opened it are no answer
            given = _pressed(question)
        if given is not None:
            self._waiting.pop(0)
            imgui.close_current_popup()
        imgui.end_popup()
        if given is not None:
            given.run()

    def _buttons(self, question: Question) -> Answer | None:
        given = None
        for i, answer in enumerate(question.answers):
            if i:
                imgui.same_line()
            colour = imgui.Col_.button_active if i == 0 else imgui.Col_.button
            imgui.push_style_color(imgui.Col_.button.value, imgui.get_style().color_(colour))
            if imgui.button(answer.label, (7.0 * imgui.get_font_size(), 0.0)):
                given = answer
            imgui.pop_style_color()
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            self.boxes[answer.label] = (low.x, low.y, high.x, high.y)
        return given


def _pressed(question: Question) -> Answer | None:
    """Return the answer that a key of this frame gives."""
    if imgui.is_key_pressed(imgui.Key.escape, False):
        return question.answers[-1]
    if imgui.is_key_pressed(imgui.Key.enter, False) or imgui.is_key_pressed(imgui.Key.keypad_enter, False):
        return question.answers[0]
    if imgui.get_io().key_ctrl:
        return None
    keys = {answer.label[0].lower(): answer for answer in reversed(question.answers)}
    return next((keys[key] for key in keys if imgui.is_key_pressed(getattr(imgui.Key, key), False)), None)
