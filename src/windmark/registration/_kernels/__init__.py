"""Numba kernels of the matcher: arrays in, arrays out; readable twins are in tests/registration."""
