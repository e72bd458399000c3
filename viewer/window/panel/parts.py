"""The panel's rows on parts of the model that have a material of their own."""

from milkglass.core.material.library import MAX_ETA, MIN_ETA, library
from milkglass.viewer.assets.sources import whole_source
from milkglass.viewer.files.model import MOST_NAMED
from milkglass.viewer.gui.controls import CHANNELS, TYPE_HINT, Controls, Reach, Reset, explained
from milkglass.viewer.gui.sliders import significant
from milkglass.viewer.live.live import Live
from milkglass.viewer.scene.declaration import settings_of
from milkglass.viewer.scene.keys import MATERIALS
from milkglass.viewer.scene.scene import Change
from milkglass.viewer.scene.settings import MaterialSettings
from milkglass.viewer.session.session import Session

SCATTERS, CLEAR, OWN = "the material", "clear", "its own"
LARGEST_SIGMA = 10.0  # 1/mm, end of the sliders
TIP = (
    "What this part of the model is of: the material above, or one of its own. A clear one absorbs and refracts light; "
    "a measured one scatters it too, in this part alone."
)


class PartRows:
    """Draws what the parts of the model are of."""

    def __init__(self, session: Session, controls: Controls) -> None:
        self._session, self._controls = session, controls

    def draw(self, live: Live) -> None:
        """Draw the rows in the current ImGui window, where the model has several parts."""
        scene = self._session.scene
        source = whole_source(scene.model)
        if not live.assets.has(source):
            return
        file = live.assets.get(source)
        bodies = None if live.finished is None else live.finished.lit.bodies
        if len(file.names) < 2 and not scene.materials and (bodies is None or bodies.count < 2):
            return
        for names, _ in file.parts[:MOST_NAMED]:
            given = next((name for name, _ in scene.materials if name in names), None)
            self._part(given or names[0], dict(scene.materials).get(given or ""))

    def _part(self, part: str, given: MaterialSettings | None) -> None:
        session, controls, table = self._session, self._controls, f"{MATERIALS}.{part}"
        controls.begin_row(part)
        current, measured = SCATTERS, [material.name for material in library()]
        if given is not None:
            current = given.name or (OWN if any(given.resolve().sigma_s_prime) else CLEAR)
        chosen = controls.choice(table, current, (SCATTERS, CLEAR, *measured), shown=current)
        controls.end_row(table, part, TIP)
        if chosen == CLEAR:
            nothing = (0.0, 0.0, 0.0)
            session.edit(table, sigma_s_prime=nothing, sigma_a=nothing, eta=MaterialSettings.DEFAULT_ETA)
        elif chosen == SCATTERS:
            left = tuple(pair for pair in session.scene.materials if pair[0] != part)
            session.change([Change(MATERIALS, "", left, MATERIALS)])
        elif chosen is not None:
            session.edit(table, name=chosen)
        if given is None or given.name is not None or chosen is not None:
            return
        material = given.resolve()
        declared = settings_of(MaterialSettings)
        reset = Reset(MaterialSettings.DEFAULT_ETA, lambda: session.edit(table, eta=MaterialSettings.DEFAULT_ETA))
        reach = Reach(MIN_ETA, MAX_ETA)
        new = controls.value(f"{table}.eta", "η", declared["eta"], material.eta, reset, reach=reach)
        if new is not None:
            session.edit(table, eta=new)
        for channel, (letter, colour) in enumerate(CHANNELS):
            name, label, value = f"{table}.sigma_a.{letter}", f"σa {letter}", material.sigma_a[channel]
            controls.begin_row(label, resettable=True)
            text = f"{significant(value)} /mm"
            moved = controls.sliders.number(name, value, 0.0, LARGEST_SIGMA, text, logarithmic=True, colour=colour)

            def put(value: float, channel: int = channel) -> None:
                values = list(material.sigma_a)
                values[channel] = value
                session.edit(table, sigma_s_prime=material.sigma_s_prime, sigma_a=tuple(values), eta=material.eta)

            if moved is not None:
                put(moved)
            tip = f"{explained(declared['sigma_a'], None)}\n{TYPE_HINT}"
            controls.end_row(name, label, tip, lambda put=put: put(0.0), differs=value != 0.0)  # type: ignore[misc]
