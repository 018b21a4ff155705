"""What is below the surface, as a project file has it; numbers in other units than their keys say are refused."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from windmark.errors import UsageError, g3
from windmark.paint import Layer, Wall
from windmark.pipeline.project_entries import Positive
from windmark.pipeline.settings import Strict

DIFFUSIVITY = (1e-8, 2e-3)
"""m2/s of all solids, from foamed resin to diamond."""
EFFUSIVITY = (20.0, 6e4)
"""W s^0.5 / (m2 K) of all solids."""


class LayerEntry(Strict):
    """One layer. ``thickness_mm`` may be left out of the last one of a semi-infinite wall.

    ``thickness_mm``: of the layer. ``conductivity_W_mK``: of heat. ``density_kg_m3``: of the material. ``heat_J_kgK``:
    specific heat.
    """

    thickness_mm: Positive | None = None
    conductivity_W_mK: Positive
    density_kg_m3: Positive
    heat_J_kgK: Positive

    @model_validator(mode="after")
    def _possible(self) -> LayerEntry:
        layer = self.layer
        for what, value, (low, high) in (("diffusivity", layer.diffusivity, DIFFUSIVITY),
                                         ("effusivity", layer.effusivity, EFFUSIVITY)):  # fmt: skip
            if not low <= value <= high:
                raise UsageError(
                    f"its {what} is {g3(value)} in SI units, of solids it is {low:g} to {high:g}: conductivity, "
                    "density or heat is in another unit than its key says"
                )
        return self

    @property
    def layer(self) -> Layer:
        """In SI units."""
        thickness = np.inf if self.thickness_mm is None else 1e-3 * self.thickness_mm
        return Layer(thickness, self.conductivity_W_mK, self.density_kg_m3 * self.heat_J_kgK)


class WallEntry(Strict):
    """The wall of some volumes (none given: of all), layers from the surface inwards.

    ``back``: "semi-infinite", "adiabatic" (no heat leaves it) or "isothermal". ``relative_sigma``: of the effusivity.

    ``volumes``: that have it. ``layer``: tables of its layers, the outer one first.
    """

    volumes: tuple[str, ...] = ()
    back: Literal["semi-infinite", "adiabatic", "isothermal"] = "semi-infinite"
    relative_sigma: Annotated[float, Field(ge=0, lt=1)]
    layer: Annotated[tuple[LayerEntry, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _ends(self) -> WallEntry:
        finite = self.layer[:-1] if self.back == "semi-infinite" else self.layer
        if any(entry.thickness_mm is None for entry in finite):
            raise UsageError("thickness_mm is missing in a layer that is not the last one of a semi-infinite wall")
        return self

    @property
    def wall(self) -> Wall:
        """In SI units."""
        return Wall(tuple(entry.layer for entry in self.layer), self.back, self.relative_sigma)
