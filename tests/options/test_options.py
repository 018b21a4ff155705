"""What an option is, and that signatures, project keys, command line and documentation have what the table says."""

import dataclasses
import inspect
import re
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest
import typer.main

import windmark as wm
from windmark.app.cli import app
from windmark.calibration import self_calibrate
from windmark.detection import detect, detect_at, estimate_radius, find_markers, merit_map
from windmark.detection.options import Options as DetectOptions
from windmark.errors import UsageError
from windmark.options import Option, calibration, detection, registration
from windmark.pipeline import project
from windmark.pipeline.calibrate import CalibrateSettings, MatchOptions
from windmark.pipeline.deform.entries import LookEntry
from windmark.pipeline.track_files import FollowOptions
from windmark.registration import register, track
from windmark.tasks.align2d import align_images
from windmark.tasks.calibrate import MatchSettings
from windmark.tasks.deform import LookOptions

ALL = {"detection": detection.OPTIONS, "registration": registration.OPTIONS, "calibration": calibration.OPTIONS}
D, R, C = detection, registration, calibration

# Who takes which options of the table; every other default of that name is found by `test_no_default_is_said_again`.
SIGNATURES = [
    (detect, (D.RADIUS_PX, D.POLARITY, D.MERIT_MAX, D.REFINE, D.PHOTOMETRY, D.MIN_QUALITY)),
    (detect_at, (D.RADIUS_PX, D.POLARITY, D.PHOTOMETRY, D.SEARCH_PX)),
    (find_markers, (D.POLARITY_OR_AUTO,)),
    (merit_map, (D.POLARITY,)),
    (estimate_radius, (D.POLARITY,)),
    (register, (R.METHOD, R.PRIOR_MAX_ANGLE_DEG, R.PRIOR_MAX_SCALE, R.TOLERANCE_PX, R.FREE_FOCAL, R.MAX_TIME_S,
                R.MAX_TABLE_ERROR, R.MAX_DEFORMATION, R.BINDING, R.SEED)),
    (track, (R.TOLERANCE_PX, R.MAX_TIME_S, R.MAX_TABLE_ERROR, R.SEED)),
    (align_images, (D.RADIUS_PX, D.POLARITY, D.MERIT_MAX)),
    (self_calibrate, (C.RIG, C.ECCENTRICITY, C.REJECT, C.MAX_SIGMA0, C.SOLVER, R.SEED)),
    (DetectOptions, (D.RADIUS_PX, D.POLARITY, D.MERIT_MAX, D.REFINE, D.PHOTOMETRY, D.MIN_QUALITY)),
    (FollowOptions, (D.RADIUS_PX, D.POLARITY, D.MERIT_MAX, D.PHOTOMETRY, D.CHANNEL, D.BAYER, R.TOLERANCE_PX,
                     R.MAX_TIME_S, R.MAX_TABLE_ERROR, R.SEED)),
    (LookOptions, (D.RADIUS_PX, D.POLARITY, D.MERIT_MAX, D.PHOTOMETRY, R.MAX_TIME_S, R.MAX_TABLE_ERROR,
                   R.MAX_DEFORMATION, R.SEED)),
    (MatchOptions, (D.POLARITY, D.MERIT_MAX, D.CHANNEL, D.BAYER, C.MATCH_TOLERANCE_PX, C.MATCH_TIME_S, R.SEED)),
    (MatchSettings, (C.MATCH_TOLERANCE_PX, C.MATCH_TIME_S, R.SEED)),
    (CalibrateSettings, (C.RIG, C.ECCENTRICITY, C.REJECT, C.MAX_SIGMA0, C.SOLVER, R.SEED)),
]  # fmt: skip
KEYS = [
    (project.DetectOptions, (D.RADIUS_PX, D.POLARITY_OR_AUTO, D.MERIT_MAX, D.REFINE, D.PHOTOMETRY)),
    (project.RegisterOptions, tuple(R.OPTIONS)),
    (project.ImageEntry, (D.CHANNEL, D.BAYER)),
    (LookEntry, (D.RADIUS_PX, D.POLARITY, D.MERIT_MAX, D.PHOTOMETRY, R.MAX_TIME_S, R.MAX_TABLE_ERROR,
                 R.MAX_DEFORMATION, R.SEED, R.OCCLUSION)),
]  # fmt: skip
FOUND = (D.RADIUS_PX, D.POLARITY_OR_AUTO, D.MERIT_MAX)
GROUP = typer.main.get_command(app)
ONE = (D.RADIUS_PX, D.POLARITY, D.MERIT_MAX, D.CHANNEL, D.BAYER, R.SEED)
COMMANDS = [
    ("detect", (*FOUND, D.REFINE, D.PHOTOMETRY, D.CHANNEL, D.BAYER, D.SEARCH_PX)),
    ("register", (*FOUND, R.TOLERANCE_PX, R.FREE_FOCAL, R.PRIOR_MAX_ANGLE_DEG, R.PRIOR_MAX_SCALE, R.BINDING, R.METHOD,
                  R.MAX_TIME_S, R.SEED)),
    ("track", (*FOUND, D.CHANNEL, R.MAX_TIME_S, R.SEED)),
    ("align", (*FOUND, R.PRIOR_MAX_ANGLE_DEG, R.PRIOR_MAX_SCALE, R.METHOD, R.MAX_TIME_S, R.SEED)),
    ("calibrate", (*ONE, *C.OPTIONS)),
    ("reconstruct", ONE),
    ("epipolar", ONE),
]  # fmt: skip


def each(pairs):
    rows = [(thing, option) for thing, taken in pairs for option in taken]
    return [pytest.param(thing, o, id=f"{getattr(thing, '__name__', thing)}-{o.name}") for thing, o in rows]


def defaults_of(thing):
    if dataclasses.is_dataclass(thing):
        return {f.name: f.default for f in dataclasses.fields(thing)}
    return {name: p.default for name, p in inspect.signature(thing).parameters.items()}


@pytest.mark.parametrize(("thing", "option"), each(SIGNATURES))
def test_signatures_have_the_defaults_of_the_table(thing, option):
    assert defaults_of(thing)[option.name] == option.default


def literals(annotation):
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    return next((found for part in get_args(annotation) if (found := literals(part))), ())


@pytest.mark.parametrize(("model", "option"), each(KEYS))
def test_keys_of_a_project_have_default_choices_and_range_of_the_table(model, option):
    field = model.model_fields[option.name]
    assert field.default == option.default
    assert literals(field.annotation) == option.choices
    given = {} if model is not project.ImageEntry else {"file": "a.tif"}
    for value in outside(option):
        with pytest.raises(ValueError, match=option.name):
            model(**given, **{option.name: value})
    for value in inside(option):
        assert getattr(model(**given, **{option.name: value}), option.name) == value


def outside(option):
    if option.choices:
        return ["none of them"]
    ends = [option.above, *([] if option.least is None or option.name == "radius_px" else [option.least - 1])]
    return [e for e in ends if e is not None] + ([] if option.most is None else [option.most + 1])


def inside(option):
    if option.choices:
        return list(option.choices)
    return [e for e in (option.least, option.most) if e is not None]


@pytest.mark.parametrize(("verb", "option"), each(COMMANDS))
def test_the_command_line_has_flag_default_and_help_of_the_table(verb, option):
    command = GROUP.commands[verb]
    flag = option.flags.split("/")[0]
    (param,) = [p for p in command.params if flag in getattr(p, "opts", ())]
    assert param.default == option.default
    assert param.help == option.sentence
    if "/" in option.flags:
        assert option.flags.split("/")[1] in param.secondary_opts


def test_options_are_grouped_and_a_group_has_one_heading(windmark_help):
    text = windmark_help("calibrate")
    headings = re.findall(r"^(\S.*):$", text, re.MULTILINE)
    assert len(headings) == len(set(headings))
    assert headings[0] == "Arguments"
    assert {"Input", "Datum and scale", "Lens", "Adjustment", "Board of dots", "Markers in pictures", "Output"} <= {
        *headings
    }
    assert re.search(r"Markers in pictures:\n  -r, --radius", text)
    flags = [f for p in GROUP.commands["calibrate"].params for f in p.opts if f.startswith("--")]
    assert len(flags) > 35
    for flag in flags:
        assert len(re.findall(rf"^  (-\w, )?{flag}\b(?!-)", text, re.MULTILINE)) == 1, flag


@pytest.fixture
def windmark_help():
    from typer.testing import CliRunner

    return lambda verb: CliRunner().invoke(app, [verb, "--help"]).stdout


def test_no_default_is_said_again():
    """Nowhere in the sources is a default of the table typed a second time as a number or a text."""
    names = {o.name: o for options in ALL.values() for o in options if o.default not in (None, False, True, 0)}
    pattern = re.compile(rf"^\s*({'|'.join(names)}): [^=\n#]*= \(?([\d.]+|\"\w+\")\)?,?$", re.MULTILINE)
    root = Path(wm.__file__).parent
    again = []
    for path in sorted(root.rglob("*.py")):
        where = path.relative_to(root).as_posix()
        if where.startswith(("options/", "synth/")):
            continue
        for name, value in pattern.findall(path.read_text("utf-8")):
            said = value.strip('"')
            same = said == str(names[name].default) or (said[0].isdigit() and float(said) == names[name].default)
            if same:
                again.append(f"{where}: {name} = {value}")
    assert not [a for a in again if a not in ELSEWHERE]


ELSEWHERE = {"scene/detections.py: sigma_px = 0.1"}
"""Of spots that are made from places alone: no option of a verb."""


def test_flags_are_those_of_some_command():
    typed = {
        flag for command in GROUP.commands.values() for p in command.params
        for flag in (*p.opts, *p.secondary_opts)
    }  # fmt: skip
    for option in (o for options in ALL.values() for o in options):
        if option.flags:
            assert set(option.flags.split("/")) <= typed, option.name
        else:
            assert "--" + option.name.replace("_", "-") not in typed


@pytest.mark.parametrize("options", ALL.values(), ids=ALL)
def test_defaults_are_in_their_range_and_helps_are_sentences(options):
    for option in options:
        assert option.allows(option.default)
        option.check(option.default)
        assert option.help.endswith((".", "> 1."))
        assert option.name.isidentifier()


def test_ranges():
    ratio = Option("ratio", 1.3, "A ratio.", above=1.0, most=2.0)
    assert ratio.range == "> 1 and <= 2"
    assert [ratio.allows(v) for v in (1.0, 1.0001, 2.0, 2.1, float("nan"), float("inf"), None)] == [
        False, True, True, False, False, False, False,
    ]  # fmt: skip
    with pytest.raises(UsageError, match=r"^verb: ratio must be > 1 and <= 2, got 1.0$"):
        ratio.check(1.0, "verb")
    kind = Option("kind", None, "A kind.", choices=("a", "b", "c"), otherwise="a")
    assert kind.range == "a, b or c"
    assert kind.sentence == "A kind. [default: a]"
    kind.check(None)
    with pytest.raises(UsageError, match=r"kind must be None or one of a, b, c, got 'd'"):
        kind.check("d")
    assert ratio.but(1.5).default == 1.5
    assert ratio.but(1.5).name == "ratio"
    for one in ({"above": 0.0}, {"least": 0.0}, {"most": 0.0}):
        assert [Option("x", 1.0, "A number.", **one).allows(v) for v in (-1.0, 0.0, 1.0)] == [
            "most" in one, "above" not in one, "most" not in one,
        ]  # fmt: skip
    assert Option("label", "", "Any text.").allows("any text")


def test_the_table_in_the_documentation_is_that_of_the_program():
    """docs/options.md is what `python docs/make_options.py` writes."""
    import runpy

    root = Path(__file__).parents[2]
    made = runpy.run_path(str(root / "docs" / "make_options.py"))["page"]()
    assert (root / "docs" / "options.md").read_text("utf-8") == made
