"""Running the command line as a user does, in one process."""

import json
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from windmark.app.cli import app


@pytest.fixture(scope="session")
def windmark():
    """``windmark("detect", ...)`` -> code, out (stdout), err (stderr), json."""

    def call(*arguments):
        done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
        record = json.loads(done.stdout) if "--json" in arguments and done.stdout else None
        return SimpleNamespace(code=done.exit_code, out=done.stdout, err=done.stderr, json=record)

    return call
