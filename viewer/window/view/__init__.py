"""The picture in the window: drawing, mouse, overlays and actions."""
