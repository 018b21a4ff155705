"""All attacks by number, name and variant, and the trial of each seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import _attack_boards as boards
import _attack_cameras as cameras
import _attack_copies as copies
import _attack_layouts as layouts
import _attack_many as many
import _attack_mixed as mixed
import _attack_rigs as rigs
from _attack_pictures import RigTrial, SequenceTrial, Trial

AnyTrial = Trial | SequenceTrial | RigTrial


@dataclass(frozen=True)
class Attack:
    """One attack: its number, its name (key of `_attack_judge.REASONS`), and its variants, each seed -> trial."""

    number: int
    name: str
    variants: Mapping[str, Callable[[int], AnyTrial]]


ONE_PAIR = {
    "flat": layouts.one_row,
    "flat, false": partial(layouts.one_row, false=0.5),
    "flat, no normals": partial(layouts.one_row, normals=False),
    "relief 1 %": partial(layouts.one_row, relief=0.01),
    "relief 3 %, no normals": partial(layouts.one_row, relief=0.03, normals=False),
    "stray spot only": partial(layouts.one_row, left=0),
    "stray spot, relief": partial(layouts.one_row, left=0, relief=0.01),
    "a part, stray spot": layouts.part_and_stray,
    "a part, stray spot, false": partial(layouts.part_and_stray, false=0.3),
    "two left": partial(layouts.one_row, left=2),
    "two left, relief": partial(layouts.one_row, left=2, relief=0.01),
    "grazing": layouts.grazing,
    "oblique, one left": layouts.oblique,
    "oblique, two left": partial(layouts.oblique, left=2),
    "eight left": layouts.eight_left,
    "eight left, false": partial(layouts.eight_left, false=1.0),
}
TIES = {
    "normals": layouts.equal_pitch,
    "no normals": partial(layouts.equal_pitch, normals=False),
    "off by 0.5 %": partial(layouts.equal_pitch, jitter=0.005),
    "off by 2 %, no normals": partial(layouts.equal_pitch, jitter=0.02, normals=False),
    "prior": partial(layouts.equal_pitch, prior=True),
}
GRID = {
    "odd one hidden": layouts.odd_hidden,
    "odd one hidden, prior": partial(layouts.odd_hidden, prior=True),
    "half hidden at border": layouts.beyond_frame,
    "the same, off by 1 %": partial(layouts.beyond_frame, jitter=0.01),
    "the same, prior": partial(layouts.beyond_frame, prior=True),
}
MIRROR = {
    "aircraft": partial(layouts.aircraft, what="neither"),
    "aircraft, half": partial(layouts.aircraft, what="neither", half=True),
    "picture": layouts.aircraft,
    "picture, half": partial(layouts.aircraft, half=True),
    "picture, no normals": partial(layouts.aircraft, normals=False),
    "table": partial(layouts.aircraft, what="table"),
    "table, half": partial(layouts.aircraft, what="table", half=True),
    "relief reversed": layouts.relief_reversed,
    "relief reversed, no normals": partial(layouts.relief_reversed, normals=False),
    "flat, y reversed": partial(layouts.flat_mirrored, normals=True),
    "flat, y reversed, no normals": partial(layouts.flat_mirrored, normals=False),
    "1 %, y reversed, no normals": partial(layouts.flat_mirrored, normals=False, relief=0.01),
    "bent, no normals": layouts.behind,
    "bent, symmetric, no normals": partial(layouts.behind, irregular=0.0),
    "bent, nearly symmetric": partial(layouts.behind, irregular=0.01),
}
BOARD: dict[str, Callable[[int], Trial]] = {
    "larger": boards.board,
    "larger, prior": partial(boards.board, prior=True),
    "larger, cut, prior": partial(boards.board, prior=True, cut=True),
    "larger, prior, labels": partial(boards.board, prior=True, labels=3),
    "210 of 220": partial(boards.board, missing=10),
    "210 of 220, prior": partial(boards.board, missing=10, prior=True),
    **{
        f"window, {words}": partial(boards.window, **options)
        for words, options in (
            ("a label", {}), ("a label, a fifth hidden", {"hidden": 0.2}), ("a label, hexagonal", {"hexagonal": True}),
            ("two labels", {"labels": 2}), ("three labels, hexagonal", {"labels": 3, "hexagonal": True}),
        )
    },
}
REAL = {
    f"real {kind}{word}": partial(boards.real_board, kind=kind, **options)
    for kind in (boards.PICTURES if boards.real_cases.DATA.is_dir() else ())
    for word, options in ((", prior", {}), (", labels", {"prior": False, "labels": 3}), (", both", {"labels": 3}))
}
CAMERA = {
    f"{fault}, {kind}{', rigid' if rigid else ''}": partial(cameras.wrong_camera, fault=fault, kind=kind, rigid=rigid)
    for fault in cameras.NAMES
    for kind in cameras.KINDS
    for rigid in (False, True)
}
COPY = {
    f"{name}{', half hidden' if hidden else ''}": partial(make, hidden=hidden)
    for name, make in (
        ("reflection", copies.reflection), ("ghost", copies.ghost), ("second model", copies.second_model),
        ("second, partial", partial(copies.second_model, part=0.5)),
    )
    for hidden in (False, True)
}  # fmt: skip
COVARIANCE = {
    "uncertain camera": cameras.uncertain,
    "and table": partial(cameras.uncertain, table_sigma=0.001),
    "and 2 % bending": partial(cameras.uncertain, tip=0.02),
}
BENT = {
    f"{name} {tip:.0%}{', rigid' if rigid else ''}": partial(make, tip=tip, rigid=rigid)
    for name, make in (("root", cameras.bent_body), ("wing", cameras.bent_wing))
    for tip in (0.01, 0.02, 0.04)
    for rigid in (False, True)
}
TRACK = {
    f"sway {tip:.0%}{word}": partial(many.sway, tip=tip, **options)
    for tip in (0.01, 0.02, 0.03)
    for word, options in (("", {}), (", clutter", {"hidden": 0.2, "false": 0.5}), (", regular", {"jitter": 0.0}))
}
SPARSE = {
    "5 of 24": partial(copies.sparse, count=5, kind="A"),
    "8 of 60": partial(copies.sparse, count=8, kind="B"),
    "4 on a wall, prior": copies.wall,
}
RIG: dict[str, Callable[[int], RigTrial]] = {
    "70 % hidden, 100 % false": rigs.rig,
    "clean": partial(rigs.rig, hidden=0.0, false=0.0),
    "bent 2 %": partial(rigs.rig, tip=0.02),
    "one focal length free": partial(rigs.rig, free=True),
    "labels": partial(rigs.rig, labels=True),
    "occlusion": partial(rigs.rig, occlusion=True),
    "all of these": partial(rigs.rig, tip=0.02, free=True, labels=True, occlusion=True),
} | {
    f"one of {cameras} {how}{word}": partial(rigs.displaced, cameras=cameras, how=how, **options)
    for cameras in (2, 3, 4)
    for how in ("turned", "shifted")
    for word, options in (("", {}), (", hidden", {"hidden": 0.7, "false": 1.0}))
} | {f"two of {cameras} exchanged": partial(rigs.exchanged, cameras=cameras) for cameras in (2, 3, 4)}
MIXED = {"any two": mixed.two, "any two, prior": partial(mixed.two, prior=True)}

ATTACKS = (
    Attack(1, "one-pair", ONE_PAIR), Attack(2, "ties", TIES), Attack(3, "grid", GRID), Attack(4, "mirror", MIRROR),
    Attack(5, "board", BOARD | REAL), Attack(6, "camera", CAMERA), Attack(7, "copy", COPY),
    Attack(8, "covariance", COVARIANCE), Attack(9, "bent", BENT), Attack(10, "track", TRACK),
    Attack(11, "sparse", SPARSE), Attack(12, "rig", RIG), Attack(13, "mixed", MIXED),
)  # fmt: skip


def attack(word: str) -> Attack:
    """The attack with this number or name."""
    for one in ATTACKS:
        if word in (str(one.number), one.name):
            return one
    raise ValueError(f"no attack {word!r}; there are {', '.join(f'{a.number} {a.name}' for a in ATTACKS)}")


def trial(path: str) -> AnyTrial:
    """The trial ATTACK/VARIANT/SEED."""
    word, variant, seed = path.split("/")
    return attack(word).variants[variant](int(seed))
