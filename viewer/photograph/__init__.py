"""The object of a photograph in another material."""
