"""The pipeline: lighting, transport, shading, picture."""
