"""Deformed models: a smooth displacement of the markers is solved for together with the pose."""
