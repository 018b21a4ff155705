"""Numba kernels of SPOT: arrays in, arrays out; readable twins are in tests/detection."""
