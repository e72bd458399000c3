"""GLSL sources of one room, read as package data."""
