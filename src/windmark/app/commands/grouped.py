"""Help in groups: the options of a command under the heading of what they are about."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any

import typer
from typer.core import TyperCommand

from windmark.app.commands.usage import MissingParameter, all_that_lacks, refuse_again, usage_pieces, worded
from windmark.options import Option

INPUT = "Input"
LOOK = "Markers in pictures"
MATCH = "Which spot is which marker"
POSE = "Where the camera was"
VALUES = "Values"
GRID = "Grid"
GRIDS = "Grids"
DATUM = "Datum and scale"
LENS = "Lens"
ADJUSTMENT = "Adjustment"
BOARD = "Board of dots"
TEST = "Another test than one picture of a rigid model"
FLAT = "2D, by the markers alone"
LENGTHS = "Length unit"
CAMERAS = "Cameras"
PICTURES = "Pictures"
LIVE = "Live"
CAMPAIGN = "Virtual views"
OWN = "Check of a file with your own laws"
COMPARE = "Which law a test asks for"
NUMBERS = "The seven numbers"
DIRECTION = "By a direction"
LABELS = "By the spots of markers"
OUTPUT = "Output"


def told(option: Option[Any], *flags: str, panel: str | None = None) -> Any:
    """An option of the table for an argument's annotation: its flags, its help, and its range.

    Parameters
    ----------
    option : of `windmark.options`
    flags : in place of its own, such as those with a short form
    panel : heading in the help under which it stands
    """
    return _option(option, *(flags or (option.flags,)), panel=panel)


def ranged(
    help_text: str, *flags: str, above: float | None = None, least: float | None = None, most: float | None = None,
    panel: str | None = None,
) -> Any:  # fmt: skip
    """A number of one verb alone, with its range: > above, >= least, <= most."""
    return _option(Option("", None, help_text, above=above, least=least, most=most), *flags, panel=panel)


def _option(option: Option[Any], *flags: str, panel: str | None) -> Any:
    """An option whose numbers are held against its range; what a text may be is said by whoever reads it."""

    def checked(value: Any) -> Any:
        for one in value if isinstance(value, list | tuple) else [value]:
            if isinstance(one, int | float) and not (isfinite(one) and option.allows(one)):
                raise typer.BadParameter(f"expected {option.range}, not {one:g}")
        return value

    has_range = not option.choices and bool(option.range)
    return typer.Option(*flags, help=option.sentence, rich_help_panel=panel, callback=checked if has_range else None)


def written(help_text: str = "Folder of the results.") -> Any:
    """The option ``--output``."""
    return typer.Option("--output", "-o", help=help_text, rich_help_panel=OUTPUT)


class Grouped(TyperCommand):
    """A command whose help has a section for every panel of its options, in plain text, and whose usage says all that
    has to be given.
    """

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Typer's usage is silent about options without which a command does not run."""
        return usage_pieces(self.get_params(ctx), ctx, self.options_metavar)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As every command's; what lacks is said all at once, not one thing a call; what is given again is refused."""
        words = list(args)
        try:
            rest = super().parse_args(ctx, args)
        except MissingParameter as error:
            given, _, _ = self.make_parser(ctx).parse_args(args=words)
            raise all_that_lacks(error, self.get_params(ctx), ctx, given) from error
        refuse_again(self.make_parser(ctx).parse_args(args=words)[2], ctx)
        return rest

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, the panels in the order of their first options, output; what has no panel is in "Options"."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                argument = param.param_type_name == "argument"
                panel = "Arguments" if argument else getattr(param, "rich_help_panel", None) or "Options"
                sections.setdefault(panel, []).append(worded(record, param))
        rank = {"Arguments": 0, OUTPUT: 2, "Options": 1 if len(sections.get("Options", ())) > 1 else 3}
        for heading in sorted(sections, key=lambda panel: rank.get(panel, 1)):
            with formatter.section(heading):
                formatter.write_dl(sections[heading])


class App(typer.Typer):
    """Commands with grouped help."""

    def command(self, name: str | None = None, **options: Any) -> Callable[[Any], Any]:
        """As `typer.Typer.command`."""
        return super().command(name, **{"cls": Grouped, **options})
