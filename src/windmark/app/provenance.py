"""Where a report comes from: inputs with hashes, versions, options; no path tells whose machine it was made on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from windmark.pipeline.private_paths import bare, path_told

if TYPE_CHECKING:
    from windmark.io import ResultFolder

LONGEST_NAME = 24
"""Letters of a file's name that stay in one line."""


@dataclass(frozen=True)
class Provenance:
    """What a result was made of and with.

    Parameters
    ----------
    sources : ``versions`` and ``inputs`` (``file``, ``bytes``, ``sha256``), as the manifest has them
    options : (key, value) rows
    """

    sources: Mapping[str, Any] = field(default_factory=dict)
    options: Sequence[tuple[str, str]] = ()

    @staticmethod
    def of_project(project: Any, sources: Mapping[str, Any]) -> Provenance:
        """Of a job from a project file, whose settings have its ``path``."""
        settings = project.model_dump(exclude={"path"}, by_alias=True)
        return Provenance(sources, options_of(settings, Path(project.path).resolve().parent))

    @staticmethod
    def of_verb(out: ResultFolder) -> Provenance:
        """Of a job from the command line, whose options its manifest will have."""
        options = out.about.get("options", {})
        return Provenance(out.sources(), [(f"--{key.replace('_', '-')}", _given(v)) for key, v in options.items()])

    def html(self) -> str:
        """Three tables; the long ones are closed at first."""
        inputs = self.sources.get("inputs", ())
        out = []
        if inputs:
            rows = "".join(
                f"<tr><td{_of(bare(one['file']))}>{escape(bare(one['file']))}</td><td>{one['bytes']:,}</td>"
                f'<td class="hash">{one["sha256"]}</td></tr>'
                for one in inputs
            )
            out.append(_closed(f"{len(inputs)} input file{'s' if len(inputs) > 1 else ''} with SHA-256",
                               '<tr><th>file</th><th>bytes</th><th class="text">SHA-256</th></tr>', rows))  # fmt: skip
        if self.options:
            rows = "".join(
                f'<tr><td>{escape(k)}</td><td class="text long">{escape(v)}</td></tr>' for k, v in self.options
            )
            out.append(_closed("Options", '<tr><th>key</th><th class="text">value</th></tr>', rows))
        if versions := self.sources.get("versions"):
            said = ", ".join(f"{name} {version}" for name, version in versions.items())
            out.append(f'<p class="soft">Versions: {escape(said)}.</p>')
        return "".join(out)


def _of(name: str) -> str:
    """The class of the cell of a name: a long one may be broken into lines."""
    return ' class="long"' if len(name) > LONGEST_NAME else ""


def _closed(title: str, head: str, rows: str) -> str:
    return (f'<details class="columns"><summary>{escape(title)}</summary><table><thead>{head}</thead>'
            f"<tbody>{rows}</tbody></table></details>")  # fmt: skip


def options_of(value: Any, folder: Path, key: str = "") -> list[tuple[str, str]]:
    """Nested options as rows: ``camera[0].file`` and so on; what is not set is left out.

    Paths are those from ``folder``, the project's; of one that is elsewhere only the name is told.
    """
    if isinstance(value, Mapping):
        return [row for k, v in value.items() for row in options_of(v, folder, f"{key}.{k}" if key else str(k))]
    if isinstance(value, list | tuple) and any(isinstance(v, Mapping) for v in value):
        return [row for k, v in enumerate(value) for row in options_of(v, folder, f"{key}[{k}]")]
    if isinstance(value, list | tuple):
        text = ", ".join(_text(v, folder) for v in value)
    else:
        text = _text(value, folder)
    return [] if value is None or not text else [(key, text)]


def _given(value: Any) -> str:
    """An option of the command line; of paths that lead out of the result only the name."""
    if isinstance(value, list):
        return ", ".join(map(_given, value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return bare(value) if isinstance(value, str) and "/" in value else str(value)


def _text(value: Any, folder: Path) -> str:
    if isinstance(value, bool):
        return str(value).lower()  # as it stands in the project
    if not isinstance(value, PurePath):
        return str(value)
    return path_told(value, folder)
