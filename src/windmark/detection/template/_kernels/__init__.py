"""Numba kernels of the template fit: arrays in, arrays out; readable twins are in tests/detection."""
