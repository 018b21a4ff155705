"""The command line: ``windmark VERB``. Heavy imports wait until a verb needs them."""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from windmark import compiling
from windmark.app import console
from windmark.app.command_line import command_line, expanded
from windmark.app.commands import align, camera, deform, epipolar, image, infrared, plan, pov, psp, start, track, view
from windmark.app.commands.grouped import MATCH, TEST, App, ranged, written
from windmark.app.commands.matching_options import Binding, MaxTime, NoOcclusion, Roles
from windmark.app.commands.options import Json, Seed

COMPILING = "compiling kernels for their first use, which takes a minute or two; later runs start at once"

app = App(
    name="windmark",
    help="Wind-tunnel camera images into measurements on the model's surface.",
    no_args_is_help=True,
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def version_asked(value: bool) -> None:
    """Print the version and stop."""
    if value:
        from windmark import __version__

        console.answer({}, False, [f"windmark {__version__}"])
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", "-V", callback=version_asked, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Wind-tunnel camera images into measurements on the model's surface."""


@app.command(epilog="Example: windmark demo windmark-demo")
def demo(
    folder: Annotated[Path, typer.Argument(help="Where the synthetic test and its results go.")] = Path(
        "windmark-demo"
    ),
    seed: Seed = 1,
    as_json: Json = False,
) -> None:
    """Make a synthetic wind-tunnel test, run the main job on it and compare with its truth."""
    from windmark.app import verbs

    with console.errors(as_json):
        verbs.demo(folder, seed, as_json)


@app.command(
    epilog="Example: windmark simulate my-test --seed 7, or windmark simulate my-wing --deforming 12, or"
    " windmark simulate my-rig --cameras 3, or windmark simulate my-board --board 8"
)
def simulate(
    folder: Annotated[Path, typer.Argument(help="Where the test is written.")],
    seed: Seed = 1,
    deforming: Annotated[
        int | None,
        ranged("A deformation test instead: so many frames of a bending wing by two cameras.", least=3, panel=TEST),
    ] = None,
    infrared: Annotated[
        int | None,
        ranged(
            "An infrared run instead: so many frames of a wing that moves and heats up, by two cameras.",
            least=8,
            panel=TEST,
        ),
    ] = None,
    cameras: Annotated[
        int | None,
        ranged(
            "Several cameras instead (2-5), one picture each at one moment, to be merged.", least=2, most=5, panel=TEST
        ),
    ] = None,
    photos: Annotated[
        int | None,
        ranged("Hand-held pictures of the model instead: so many, with a few known markers.", least=2, panel=TEST),
    ] = None,
    psp: Annotated[
        int | None,
        ranged("A paint test instead: a polar of so many incidences by two cameras, with taps.", least=1, panel=TEST),
    ] = None,
    board: Annotated[
        int | None,
        ranged("Pictures of a printed dot board instead: so many by each of two cameras.", least=3, panel=TEST),
    ] = None,
    sequence: Annotated[
        int | None,
        ranged("A film of the model instead: so many pictures while it swings.", least=2, panel=TEST),
    ] = None,
    clocks: Annotated[
        bool,
        typer.Option(
            "--clocks", help="With --deforming: cameras of different rates, a swinging wing.", rich_help_panel=TEST
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a synthetic test: images, markers, cameras, grid, project file and the truth."""
    with console.errors(as_json):
        from windmark.app import simulate_verb

        wishes = simulate_verb.Wishes(deforming, infrared, cameras, photos, clocks, psp, board, sequence)
        simulate_verb.simulate(folder, seed, wishes, as_json)


@app.command(epilog="Example: windmark run project.toml")
def run(
    project: Annotated[Path, typer.Argument(help="Project file (TOML).")],
    output: Annotated[Path | None, written("Folder instead of the project's own.")] = None,
    max_time: MaxTime = None,
    roles: Roles = None,
    no_occlusion: NoOcclusion = False,
    binding: Binding = False,
    method: Annotated[
        str | None,
        typer.Option(
            "--method", help="hash, or ransac: the paper's search. [default: the project's]", rich_help_panel=MATCH
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """The main job: from images to values on the grid, with pictures and one HTML report."""
    from windmark.app import verbs

    with console.errors(as_json):
        verbs.run(
            project, output, as_json, max_time_s=max_time, roles=tuple(roles or ()), no_occlusion=no_occlusion,
            binding=binding, method=method,
        )  # fmt: skip


image.add(app)
track.add(app)
align.add(app)
camera.add(app)
epipolar.add(app)
deform.add(app)
plan.add(app)
pov.add(app)
psp.add(app)
infrared.add(app)
start.add(app)
view.add(app)


def main() -> None:
    """Entry point of the ``windmark`` command."""
    # Our matrices are small and images run in threads of their own: threads of BLAS would only get in their
    # way (on two busy cores milliseconds become seconds). Must be said before numpy is imported.
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    _open_closed_streams()
    console.print_any_name()
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):  # Ctrl-C, a queue, a terminal that closes, Ctrl-Break
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # nohup has it ignored
            signal.signal(number, _ended)
    sys.unraisablehook = _unraisable
    compiling.announce(lambda: console.complain(COMPILING))
    code: int | str | None = 0
    sys.argv[1:] = expanded(sys.argv[1:])
    try:
        code = command_line(app, "--json" in sys.argv[1:])
    except SystemExit as end:
        code = end.code
    except KeyboardInterrupt as error:  # before a verb was at work, or after it
        console.complain(console.interrupted(error))
        code = console.INTERRUPTED
    except OSError as error:  # of the standard streams: what verbs meet, they have said themselves
        code = _not_printed(error)
    try:
        sys.stdout.flush()  # here, where it can still be said; Python itself would end with a traceback
    except OSError as error:
        code = code or _not_printed(error)
    sys.exit(code)


def _open_closed_streams() -> None:
    """Streams that were closed before the start (``>&-``, a service of Windows) lead to nowhere.

    Otherwise the next file that is opened takes the number of one of them, and whatever a library prints goes into it.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (open as long as the program runs)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def _ended(number: int, frame: FrameType | None) -> None:
    """A user, a queue, a closing machine or terminal asks us to stop: as Ctrl-C does, with everything tidied up."""
    if _hands_over(frame):
        threading.Timer(0.01, _again, (signal.Signals(number),)).start()
        return
    if number == getattr(signal, "SIGHUP", None):
        # Shell and kernel may both send it: the second one would break off the tidying up.
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _again(number: signal.Signals) -> None:
    """The signal once more, to the main thread: where it waits (for a lock, a picture, a while) it wakes up."""
    if hasattr(signal, "pthread_kill"):
        main_thread = threading.main_thread().ident
        assert main_thread is not None
        signal.pthread_kill(main_thread, number)
    else:  # Windows: seen when the wait is over
        _thread.interrupt_main(number)


def _hands_over(frame: FrameType | None) -> bool:
    """Whether a compiled kernel is just being called or hands over what it has made.

    numba does not look at errors there and goes on with one set, which Python makes a `SystemError` of.
    """
    numbas = False
    while frame is not None and _is_numbas(str(frame.f_globals.get("__name__"))):
        if frame.f_code.co_name == "_compile_for_args":
            return False
        numbas, frame = True, frame.f_back
    return numbas


def _is_numbas(module: str) -> bool:
    return module.partition(".")[0] == "numba" or module == "windmark.geometry._link"


def _unraisable(unraisable: sys.UnraisableHookArgs, /) -> None:
    """Ctrl-C that comes while an object is taken away is dropped there: it is sent again, once that is over."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        threading.Timer(0.01, _again, (signal.SIGINT,)).start()
    else:
        sys.__unraisablehook__(unraisable)


def _not_printed(error: OSError) -> int:
    from windmark.io.errors import reason

    # What could not be printed is not tried again when Python ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):  # who reads our output has had enough of it
        return console.DONE
    console.complain(f"standard output: cannot be written: {reason(error)}")
    return console.WRONG_USAGE


if __name__ == "__main__":
    main()
