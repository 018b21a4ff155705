"""Writes docs/options.md from the table of options: ``python docs/make_options.py``."""

from pathlib import Path

from windmark.options import calibration, detection, registration

ROOMS = (("How markers are found", detection), ("Which spot is which marker", registration),
         ("How cameras are calibrated", calibration))  # fmt: skip
HEAD = """\
# Options

Made by `docs/make_options.py` from `windmark.options`, where each option is said once; signatures, project files and
the command line take it from there. An option has one name: the keyword in Python and the key in a project file; on the
command line it is the flag. A verb that has another default has a row of its own.
"""


def page() -> str:
    """The page as text."""
    parts = [HEAD]
    for title, room in ROOMS:
        parts.append(f"\n## {title}\n\n| name | command line | default | unit | range | what it is |\n")
        parts.append("|---|---|---|---|---|---|\n")
        for o in room.OPTIONS:
            flags = f"`{o.flags}`" if o.flags else ""
            cells = (f"`{o.name}`", flags, o.otherwise or str(o.default), o.unit, o.range, o.help)
            parts.append(f"| {' | '.join(cells)} |\n")
    return "".join(parts)


if __name__ == "__main__":
    Path(__file__).with_name("options.md").write_text(page(), encoding="utf-8")
