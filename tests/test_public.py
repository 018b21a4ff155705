"""The public face: what users type is there, and importing it costs next to nothing."""

import subprocess
import sys

import windmark as wm


def test_every_public_name_is_there_once():
    assert len(set(wm.__all__)) == len(wm.__all__)
    for name in wm.__all__:
        assert getattr(wm, name) is not None
    assert set(wm.__all__) <= set(dir(wm))


def test_importing_windmark_and_help_load_nothing_heavy():
    code = (
        "import sys; import windmark; import windmark.app.cli; "
        "print(*[m for m in ('numpy', 'numba', 'scipy', 'matplotlib', 'pyvista', 'vtk') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
