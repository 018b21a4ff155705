"""The options of the verbs, each said once: name, default, range, unit, help.

Signatures, project files, the command line and docs/options.md take them from here. Nothing heavy is imported, for the
command line needs them before any verb runs.
"""

from windmark.options.option import Option

__all__ = ["Option"]
