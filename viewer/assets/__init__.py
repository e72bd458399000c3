"""What is computed of files, kept; and the choice of quality."""
