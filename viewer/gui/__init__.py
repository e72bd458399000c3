"""Dear ImGui's one door: toolkit, controls, sliders, events and keys."""
