"""Checks the validation tools themselves, in about ten seconds.

    target/validation/venv/bin/python validation/self_test.py

Two samplers of one scene must agree, the same scene one percent brighter must not, and
EXR files must come back bit by bit. Exit 0 if so.
"""

import tempfile
from pathlib import Path

import numpy as np

from exr_files import read_exr, write_exr
from mitsuba_env import load_scene, mi, render, render_seeds
from seed_moments import moments
from welch import compare

SCENE = """<scene version="3.0.0">
  <default name="angle_deg" value="0"/>
  <default name="spp" value="16"/>
  <default name="max_depth" value="4"/>
  <default name="sampler" value="multijitter"/>
  <default name="rho_d" value="0.4"/>
  <integrator type="path">
    <integer name="max_depth" value="$max_depth"/>
    <integer name="rr_depth" value="100"/>
    <boolean name="hide_emitters" value="true"/>
  </integrator>
  <sensor type="perspective">
    <float name="fov" value="32"/>
    <transform name="to_world">
      <lookat origin="0, 1.37, 3.76" target="0, 0, 0" up="0, 1, 0"/>
    </transform>
    <sampler type="$sampler"><integer name="sample_count" value="$spp"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="64"/>
      <integer name="height" value="48"/>
      <string name="pixel_format" value="rgb"/>
      <string name="component_format" value="float32"/>
      <rfilter type="box"/>
    </film>
  </sensor>
  <emitter type="envmap"><string name="filename" value="probe.exr"/></emitter>
  <shape type="cube">
    <transform name="to_world"><rotate y="1" angle="$angle_deg"/></transform>
    <bsdf type="blendbsdf">
      <float name="weight" value="0.5"/>
      <bsdf type="diffuse">
        <spectrum name="reflectance" value="$rho_d"/>
      </bsdf>
      <bsdf type="roughconductor">
        <string name="distribution" value="ggx"/>
        <float name="alpha" value="0.2"/>
        <float name="eta" value="1.3"/>
        <float name="k" value="0"/>
        <float name="specular_reflectance" value="4.7"/>
      </bsdf>
    </bsdf>
  </shape>
</scene>
"""
SEEDS = 48
TILE = 8


def lit_probe(rng):
    """A dim, coloured, noisy surrounding with one small bright light."""
    probe = rng.uniform(0.2, 1.0, size=(33, 64, 3)).astype(np.float32)
    probe[8:10, 20:22] = (300.0, 280.0, 250.0)
    return probe


def check(name, passed, figures):
    print(f"{'ok  ' if passed else 'FAIL'} {name}: {figures}")
    return passed


def main():
    rng = np.random.default_rng(1)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        probe = lit_probe(rng)
        write_exr(Path(folder) / "probe.exr", probe)
        back = read_exr(Path(folder) / "probe.exr")
        results.append(check("exr round trip", np.array_equal(back, probe), back.shape))

        xml = Path(folder) / "scene.xml"
        xml.write_text(SCENE)
        stratified = load_scene(xml, angle_deg=30, spp=16)
        again = np.array_equal(render(stratified, seed=5), render(stratified, seed=5))
        results.append(check("same seed, same image", again, ""))

        reference = moments(render_seeds(stratified, range(SEEDS)), TILE)
        independent = load_scene(xml, angle_deg=30, spp=64, sampler="independent")
        other = moments(render_seeds(independent, range(1000, 1000 + SEEDS)), TILE)
        agreement = compare(reference, other)
        passed = agreement.accepted and agreement.uniform_p > 1e-3
        results.append(check("two samplers agree", passed, agreement))

        xml.write_text(SCENE.replace('"rho_d" value="0.4"', '"rho_d" value="0.404"'))
        brighter = moments(render_seeds(load_scene(xml, 30, 16), range(2000, 2000 + SEEDS)), TILE)
        agreement = compare(reference, brighter)
        results.append(check("1 % more albedo is seen", not agreement.accepted, agreement))
        agreement = compare(reference, brighter, tolerance=0.02)
        results.append(check("unless 2 % is tolerated", agreement.accepted, agreement))
    print(f"Mitsuba {mi.__version__}, {mi.variant()}")
    print(f"{sum(results)} passed, {len(results) - sum(results)} failed")
    return 0 if all(results) else 1


if __name__ == "__main__":
    raise SystemExit(main())
