"""The verb `windmark view`: serve the viewer until Ctrl-C."""

from __future__ import annotations

import webbrowser
from functools import partial
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import console
from windmark.app.project_place import project_in
from windmark.app.viewer.page import page, rejected, waiting_page
from windmark.app.viewer.pov import read_pov, seen_at, virtual_view
from windmark.app.viewer.server import Answer, Routes, Server
from windmark.app.viewer.session import Session
from windmark.app.viewer.sight_lines import lines_of_sight
from windmark.errors import UsageError
from windmark.pipeline.project import read_project
from windmark.pipeline.results import ImageResult, RunResult

HTML = "text/html; charset=utf-8"
KINDS = {"png": "image/png", "tiff": "image/tiff"}


def view(path: Path, port: int, browser: bool) -> None:
    """Open the viewer on a project and serve it until Ctrl-C."""
    path = project_in(path, "run")
    project = read_project(path)
    session = Session(project.path, page)
    server = opened(session, project.title, port)
    session.start(write=False)
    lines = [f"the viewer is at {server.address}", "only this computer can reach it; Ctrl-C ends it"]
    try:
        console.answer({}, False, lines)
        if browser:
            webbrowser.open(server.address)
        server.serve_forever()
    except KeyboardInterrupt:
        console.complain("the viewer ends")
    finally:
        server.server_close()
        session.end()


def opened(session: Session, title: str, port: int = 0) -> Server:
    """A server for a session; it listens and is to be served.

    Raises
    ------
    UsageError
        Where the port is taken or may not be used.
    """
    try:
        return Server(routes(session, title), port)
    except (OSError, OverflowError) as error:
        why = io.reason(error) if isinstance(error, OSError) else "expected 0 to 65535"
        raise UsageError(f"--port {port}: {why}; without it a free one is taken") from None


def routes(session: Session, title: str) -> Routes:
    """What the page can ask for."""

    def whole(_: dict[str, Any]) -> Answer:
        shown = session.shown
        return Answer((waiting_page(title) if shown is None else shown.page).encode(), HTML)

    def state(_: dict[str, Any]) -> Answer:
        return Answer.of(session.state())

    def edit(what: str, said: dict[str, Any]) -> Answer:
        session.edit(what, said)
        return Answer.of(session.state())

    def run(_: dict[str, Any]) -> Answer:
        session.start(write=True)
        return Answer.of(session.state())

    def explain(said: dict[str, Any]) -> Answer:
        item, result = _item(session, said)
        return Answer.of({"rejected": rejected(item, result)})

    def grid(said: dict[str, Any]) -> Answer:
        item, result = _item(session, said)
        return Answer.of(seen_at(item, result, read_pov(said)))

    def export(said: dict[str, Any]) -> Answer:
        item, result = _item(session, said)
        kind = str(said.get("kind"))
        content, _ = virtual_view(item, result, read_pov(said), kind)
        return Answer(content, KINDS[kind])

    def sight(said: dict[str, Any]) -> Answer:
        item, result = _item(session, said)
        return Answer.of({"lines": lines_of_sight(item, result, said.get("spot"))})

    return {
        ("GET", "/"): whole, ("GET", "/state"): state, ("POST", "/run"): run, ("POST", "/explain"): explain,
        ("POST", "/grid"): grid, ("POST", "/export"): export, ("POST", "/sight"): sight,
        **{("POST", f"/{what}"): partial(edit, what) for what in ("name", "exclude", "free")},
    }  # fmt: skip


def _item(session: Session, said: dict[str, Any]) -> tuple[ImageResult, RunResult]:
    """The image that a request is about."""
    result = session.of_run(said.get("run"))
    for item in result.images:
        if item.name == said.get("image"):
            return item, result
    raise UsageError(f"there is no image {str(said.get('image'))[:60]!r} in this run")
