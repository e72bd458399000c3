"""The panel's section on highlights, the specular reflection of the surface."""

from milkglass.viewer.window.panel.section import Section, Seen


class HighlightsSection(Section):
    """Draws the strength, the shininess and the model of the specular reflection."""

    title = "Highlights"

    def draw(self, seen: Seen) -> None:
        """Draw the rows in the current ImGui window."""
        scene = self._session.scene
        gloss = scene.specular.resolve(scene.transport.facts)
        self._controls.setting("specular.strength", "Strength", gloss.strength)
        self._controls.setting("specular.shininess", "Shininess", gloss.shininess)
        self._controls.setting("specular.model", "Model", gloss.model)
