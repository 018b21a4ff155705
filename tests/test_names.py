"""Names of the sources that would hide each other: looked up, as no checker of types or style asks."""

import ast
from collections import Counter
from pathlib import Path

import windmark


def test_no_constant_is_bound_twice_in_a_module():
    """A second `CONTRADICTED` in the table of rules hid another one, and cameras contradicted nothing any more."""
    twice = {}
    for path in Path(windmark.__file__).parent.rglob("*.py"):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        targets = [target for line in body if isinstance(line, ast.Assign) for target in line.targets]
        targets += [line.target for line in body if isinstance(line, ast.AnnAssign)]
        names = [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        if again := [name for name, count in Counter(names).items() if count > 1 and name.isupper() and name[0] != "_"]:
            twice[path.name] = again
    assert not twice
