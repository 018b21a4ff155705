"""Numba kernels of the room: arrays in, arrays out; readable twins are in tests/epipolar."""
