"""The edited scene, its history, and how it is looked at."""
