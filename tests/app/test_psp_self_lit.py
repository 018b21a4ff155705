"""`[self_illumination]` of a paint project on a simulated point whose body and wing light each other: truth known."""

from dataclasses import replace

import numpy as np
import pytest

from windmark import io
from windmark.paint import add_self_illumination, form_factors
from windmark.pipeline.simulate_taps import tap_table
from windmark.pipeline.walls import without
from windmark.synth import PspTest, psp_test
from windmark.synth.pressure_paint import Glow
from windmark.synth.psp_truth import placed

REFLECTIVITY = 0.5
MATTERS = 0.005
"""Change of the ratio from which on a node counts here."""


class SelfLit(PspTest):
    """A paint test whose model lights itself."""

    def world(self, state, air, lit_s, lamp_factor=1.0):
        made = super().world(state, air, lit_s, lamp_factor)
        return replace(made, paint=replace(made.paint, glow=self.glow(air)))

    def glow(self, air):
        (point,) = self.points
        if not hasattr(self, "_glows"):
            kinds = (point.still, point.off, point.lit_s[0]), (point.wind, point.on[0], point.lit_s[1])
            mesh = without(self.mesh, tuple(set(self.mesh.volume.tolist()) - set(self.paint.sensitive)))
            factors = form_factors(mesh)
            object.__setattr__(self, "_glows", [self._thrown(mesh, factors, *kind) for kind in kinds])
        return self._glows[0 if air is point.still else 1]

    def _thrown(self, mesh, factors, air, state, lit_s):
        now, paint = placed(self, state), replace(self.paint, air=air, lit_s=lit_s)
        own, rest, moved = np.full(len(mesh.vertices), np.nan), mesh.vertex_normals(), now.vertex_normals()
        for name in self.paint.sensitive:
            k = np.unique(mesh.triangles[mesh.volume == name])
            own[k] = paint.intensity(now.vertices[k], moved[k], name, rest_xyz=mesh.vertices[k], rest_normal=rest[k])
        total, _ = add_self_illumination(own, factors, REFLECTIVITY)
        return Glow(mesh.vertices[mesh.used], rest[mesh.used], (total - own)[mesh.used])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_light_that_the_model_throws_on_itself_is_taken_off_and_said(windmark, tmp_path, one_camera):
    plain = psp_test(41, incidences=2, size_px=(640, 400), taps=tap_table(), nodes=5000, on_frames=2, off_frames=2)
    test = SelfLit(**{name: getattr(plain, name) for name in plain.__dataclass_fields__} | {"points": plain.points[1:]})
    one_camera(tmp_path, test)
    text = (tmp_path / "psp.toml").read_text().replace("radius = 0.4", 'radius = 0.4\nin_situ = "compare"')
    fields, records = {}, {}
    for name, more in (("left", ""), ("off", f"[self_illumination]\nreflectivity = {REFLECTIVITY}\n\n")):
        (tmp_path / "psp.toml").write_text(text.replace("[loads]", f"{more}[loads]"))
        done = windmark("psp", tmp_path / "psp.toml", "-o", tmp_path / name, "--json")
        assert done.code == 0, done.err
        fields[name] = io.read_nodes_netcdf(tmp_path / name / "p02" / "fields.nc")[1]
        records[name] = done.json["results"][0]
        assert any("no [self_illumination] is given" in r for r in done.json["remarks"]) == (name == "left")
    true = io.read_nodes_netcdf(tmp_path / "truth" / "p02.nc")[1]
    change = fields["off"]["self_illumination"]
    corner = (np.abs(change - 1) > MATTERS) & np.isfinite(fields["left"]["cp"]) & np.isfinite(fields["off"]["cp"])
    assert corner.sum() > 80
    ratio = {name: np.sqrt(np.mean((f["ratio"] / true["ratio"] - 1)[corner] ** 2)) for name, f in fields.items()}
    held = {name: np.mean((np.abs(f["cp"] - true["cp"]) < 1.96 * f["sigma_cp"])[corner]) for name, f in fields.items()}
    assert ratio["off"] < 0.6 * ratio["left"]
    assert held["left"] < 0.85
    assert held["off"] > 0.9
    said = [remark for remark in records["off"]["remarks"] if "self-illumination taken off" in remark]
    assert len(said) == 1
    assert "no camera sees" in said[0]
    assert "self_illumination" not in fields["left"]
