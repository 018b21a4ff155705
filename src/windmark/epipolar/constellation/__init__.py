"""Matching of two pictures by the constellation of their spots alone."""
