"""Hypotheses: the prepared layout of the markers, and the two searches for candidates."""
