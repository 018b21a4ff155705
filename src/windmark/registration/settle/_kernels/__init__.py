"""Numba kernels of `registration.settle`: arrays in, arrays changed in place; private."""
