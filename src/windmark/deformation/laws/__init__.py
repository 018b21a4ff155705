"""Built-in deformation laws. Every one follows the protocol of `windmark.deformation.law`."""

from windmark.deformation.laws.bases import Basis, CantileverModes, Powers, Splines, TorsionModes
from windmark.deformation.laws.beam import Beam
from windmark.deformation.laws.catalog import CATALOG, Entry, make_law
from windmark.deformation.laws.fields import Smooth, TabulatedModes
from windmark.deformation.laws.rigid import Hinge, Rigid, Sting

__all__ = [
    "CATALOG", "Basis", "Beam", "CantileverModes", "Entry", "Hinge", "Powers", "Rigid", "Smooth", "Splines", "Sting",
    "TabulatedModes", "TorsionModes", "make_law",
]  # fmt: skip
