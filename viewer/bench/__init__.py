"""The benchmark: speed against error, as tables and plots."""
