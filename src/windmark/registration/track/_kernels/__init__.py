"""Numba kernels of pose tracking; private to the registration room."""
