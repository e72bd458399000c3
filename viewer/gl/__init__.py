"""OpenGL contexts, programs and buffers."""
