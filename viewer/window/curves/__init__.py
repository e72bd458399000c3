"""Diffusion profiles, plotted."""
