"""All benchmarks in one run: each prints its table; the figures go into one JSON file.

    python benchmarks/run.py [--quick] [--json FILE] [NAME ...]

Times are this machine's, now: read the ratios to the peers that ran beside them, not the seconds.
"""

from __future__ import annotations

import argparse
import importlib
import platform
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent


def main() -> int:
    """Run the named benchmarks, or all."""
    names = sorted(p.stem for p in HERE.glob("*.py") if p.stem != "run" and not p.stem.startswith("_"))
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(names)}; all by default")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--json", type=Path, default=Path("benchmarks.json"), help="where the figures go")
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(names))
    if unknown:
        parser.error(f"unknown benchmark {unknown[0]!r}; expected one of {', '.join(names)}")
    sys.path.insert(0, str(HERE))
    figures: dict[str, object] = {
        "machine": {"python": platform.python_version(), "system": platform.platform(), "when": time.strftime("%F %T")}
    }
    for name in options.names or names:
        print(f"\n=== {name} " + "=" * (90 - len(name)), flush=True)
        start = time.perf_counter()
        figures[name] = importlib.import_module(name).main(options.quick)
        print(f"({name}: {time.perf_counter() - start:.1f} s)", flush=True)
    from windmark.io import write_json

    write_json(options.json, figures)
    print(f"\nfigures: {options.json}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
