"""The viewer: scene files, OpenGL passes, the picture, the window and the command line."""
