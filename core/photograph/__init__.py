"""The object of a photograph: its height, a surface of that, and the light around it."""
