"""Layers of nodes: deposit and gather, kernels between them and their spectra, and convolution by FFT."""
