"""A photograph in the window: view, mouse, zoom and actions."""
