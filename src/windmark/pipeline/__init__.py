"""Stages (load, verb, save, one line of report) and jobs; the only place that composes rooms."""
