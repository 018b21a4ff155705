"""Verbs that compose rooms: arrays in, results out, no files. `pipeline` loads, calls and saves."""
