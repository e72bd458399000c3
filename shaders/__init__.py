"""GLSL sources, read as package data."""
