"""The window, its contents, and recordings of it."""
