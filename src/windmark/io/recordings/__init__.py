"""Recordings: every camera's files as a lazy sequence of frames."""
