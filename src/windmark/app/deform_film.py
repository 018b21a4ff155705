"""The film of a deformation test: the grid as it deforms, before the model without wind, with its scale."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from windmark import io
from windmark.deformation import Deformation, vertex_volumes
from windmark.errors import g1
from windmark.pipeline.deform import FrameRecord, Loaded, Sequence
from windmark.pipeline.surface import SurfaceView, surface_view
from windmark.scene import Mesh

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

FILM_FRAMES, FILM_SIZE, CAPTION_PX = 48, (720, 480), 40
BAR_PART = 0.15
"""Width of the colour bar, of the picture's."""
VISIBLE_PART = 0.12
"""The film magnifies so that the largest deformation is this part of the model."""
GHOST, OUTLINE = 0.91, 0.62
"""Grey of the model without wind, and of its outline: plainly behind all colours of the scale."""
TEXT = (28, 36, 48)


def film(loaded: Loaded, sequence: Sequence, path: Path) -> None:
    """The deforming grid as an animated GIF, deformation magnified; nothing without a grid."""
    images = film_frames(loaded, sequence)
    if not images:
        return
    import imageio.v3 as iio

    # Made in memory: on a full disk imageio's writer tries once more while Python takes it away, with a traceback.
    content = iio.imwrite("<bytes>", np.stack(images), extension=".gif", duration=100, loop=0)
    with io.atomic_write(path, "wb") as stream:
        stream.write(content)


def film_frames(loaded: Loaded, sequence: Sequence) -> list[Pixels]:
    """The pictures of the film; none without a grid."""
    mesh = loaded.mesh
    if mesh is None:
        return []
    step = -(-len(sequence.film) // FILM_FRAMES)
    kept = sequence.film[::step]
    sizes = [deformation_size(mesh, state, sequence.zero) for _, state in kept]
    largest = max(float(s.max()) for s in sizes)
    factor = _factor(loaded, mesh, largest)
    direction, up = view_of(loaded)
    used = used_nodes(mesh)
    # What is in view is decided by the model at rest and by the least and the most deformed frame.
    ends = [kept[int(np.argmin([s.max() for s in sizes]))][1], kept[int(np.argmax([s.max() for s in sizes]))][1]]
    focus = np.concatenate([mesh.vertices[used]] + [
        magnified(mesh, state, sequence.zero, factor).vertices[used] for state in ends
    ])  # fmt: skip

    def seen(shape: Mesh, size: Array) -> SurfaceView:
        return surface_view(shape, size, direction=direction, up=up, focus=focus, size_px=FILM_SIZE)

    ghost = ghost_of(seen(mesh, np.zeros(len(mesh.vertices))).shade)
    bar = colour_bar(largest, f"{since(sequence)}, {loaded.project.length_unit}", FILM_SIZE[1])
    images = []
    for (row, state), size in zip(kept, sizes, strict=True):
        shown = seen(magnified(mesh, state, sequence.zero, factor), size)
        images.append(_drawn(shown, ghost, bar, largest, caption(row, factor)))
    return images


def since(sequence: Sequence) -> str:
    """What a deformation is counted from, in words."""
    return "from the table" if sequence.zero is None else "since wind-off"


def caption(row: FrameRecord, factor: float) -> str:
    """What a picture shows. Colours are the true lengths: a factor has to be said only where there is one."""
    time = f", {row.time_s:.4g} s" if np.isfinite(row.time_s) else ""
    return f"frame {row.key}{time}: deformation" + (f", drawn {factor:g} times as large" if factor != 1 else "")


def ghost_of(shade: NDArray[np.float32]) -> Array:
    """(H, W) grey of the background: white, the model at rest pale, its outline a little darker."""
    inside = np.isfinite(shade)
    core = inside.copy()
    for axis in (0, 1):
        for by in (-1, 1):
            beside = np.roll(inside, by, axis)
            # What a roll brings round from the other side is no neighbour: at the border the outline is closed.
            edge: list[Any] = [slice(None)] * 2
            edge[axis] = 0 if by == 1 else -1
            beside[tuple(edge)] = False
            core &= beside
    return np.where(core, GHOST, np.where(inside, OUTLINE, 1.0))


def colour_bar(largest: float, label: str, height: int) -> Pixels:
    """The scale of all frames as a strip to be put beside them, from none to the largest deformation."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    width = max(round(BAR_PART * FILM_SIZE[0]), 1)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    bar = figure.add_axes((0.08, 0.08, 0.18, 0.84))
    scale = ScalarMappable(Normalize(0.0, max(largest, 1e-12)), "viridis")
    figure.colorbar(scale, cax=bar, label=label)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _drawn(shown: SurfaceView, ghost: Array, bar: Pixels, largest: float, text: str) -> Pixels:
    """One picture of the film: colour from none to the largest deformation, with scale and caption."""
    from PIL import Image, ImageDraw

    colours = colormaps["viridis"](np.nan_to_num(shown.value) / max(largest, 1e-12))[..., :3]
    light = np.nan_to_num(shown.shade, nan=1.0)[..., None]
    picture = np.where(np.isfinite(shown.shade)[..., None], colours * (0.5 + 0.5 * light), ghost[..., None])
    pixels = np.concatenate([(255 * np.clip(picture, 0, 1)).astype(np.uint8), bar], axis=1)
    pixels = np.concatenate([np.full((CAPTION_PX, *pixels.shape[1:]), 255, dtype=np.uint8), pixels])
    image = Image.fromarray(pixels)
    ImageDraw.Draw(image).text((12, 10), text, fill=TEXT, font_size=18)
    return np.asarray(image)


def view_of(loaded: Loaded) -> tuple[Array, Array]:
    """Between the cameras, a little from the front."""
    poses = [s.cam_from_tunnel for s in loaded.test.stations]
    ahead = np.mean([p.rotation[2] for p in poses], axis=0)
    up = -poses[0].rotation[1]
    direction = ahead / np.linalg.norm(ahead) + 0.9 * up
    return direction / np.linalg.norm(direction), up


def used_nodes(mesh: Mesh) -> NDArray[np.int64]:
    """Nodes of the wanted volumes, some of them: enough to frame a picture."""
    return np.asarray(mesh.used[::5])


def _extent(mesh: Mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices[used_nodes(mesh)], axis=0)))


def magnified(mesh: Mesh, state: Deformation, zero: Any, factor: float) -> Mesh:
    """The grid with its deformation since the zero, rigid motion removed, magnified."""
    return mesh.moved(mesh.vertices + factor * _change(mesh, state, zero))


def deformation_size(mesh: Mesh, state: Deformation, zero: Any) -> Array:
    """(V,) length of the deformation since the zero."""
    return np.asarray(np.linalg.norm(_change(mesh, state, zero), axis=1))


def _change(mesh: Mesh, state: Deformation, zero: Any) -> Array:
    bound = state.volumes.bind(mesh.vertices, vertex_volumes(mesh))
    rest = mesh.vertices if zero is None else bound.place(zero.q)
    return np.asarray(bound.place(state.q) - rest)


def magnification(loaded: Loaded, sequence: Sequence) -> float:
    """By how much the deformation is drawn larger at first."""
    assert loaded.mesh is not None
    sizes = [float(deformation_size(loaded.mesh, state, sequence.zero)[loaded.mesh.used].max())
             for _, state in sequence.film]  # fmt: skip
    return _factor(loaded, loaded.mesh, max(sizes))


def _factor(loaded: Loaded, mesh: Mesh, largest: float) -> float:
    """A round factor by which the largest deformation is plainly seen; the project's own where it has one."""
    seen = float(f"{g1(max(VISIBLE_PART * _extent(mesh) / max(largest, 1e-12), 1.0))}")
    return min(loaded.project.output.magnify or seen, 1e3)
