"""Our G-buffer, albedo and direct light against Mitsuba's at pixel centres, before any GI is compared.

relMSE at most 1e-3 away from edges: more than 2 pixels from one of depth, normal, albedo or shadow in the
reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

from fit import export, gltf
from fit.primitives import PrimitiveSet
from fit.scene import AlphaMode, Camera, Image, Instance, Material, Mesh, Scene, Texture, TextureUse, Wrap
from pipelines.difference import relative_error, twice
from runtime.camera import look_at
from runtime.lights import Illumination, Point, Spot, Sun, choose_illumination
from runtime.path_tracer import PathTracer
from runtime.renderer import Renderer
from runtime.settings import RenderSettings
from runtime.sky import Sky

mi = pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install 'sdfprim[reference]'")

from pipelines.reference import mesh_reference  # noqa: E402
from pipelines.reference.centres import make_camera  # noqa: E402
from pipelines.reference.mitsuba import is_vectorized, load_mitsuba  # noqa: E402
from pipelines.reference.truth import Reference, _sensor  # noqa: E402

LIMIT = 1e-3
EDGE = 2
"""Pixels."""

MOST_EXCLUDED = 0.2

HOLES = 8
"""Cut-outs that a ray goes through at most."""


@dataclass(frozen=True)
class View:
    """A scene under a light from a camera, and what of it is compared."""

    scene: Scene
    light: Illumination
    camera: Camera
    primitives: PrimitiveSet = field(default_factory=PrimitiveSet.empty)
    size: tuple[int, int] = (720, 480)


def ours(gpu: Any, view: View) -> dict[str, np.ndarray]:
    settings = RenderSettings(size=view.size, gi="none", max_texture_size=4096)
    layers = ("position", "normal", "albedo", "direct")
    renderer = Renderer(gpu, view.scene, view.primitives, settings, view.light)
    images = dict(renderer.render(view.camera, only=layers).images)
    shown = (images["normal"] != 0).any(axis=-1)
    tracer = PathTracer(gpu, view.scene, view.light)
    traced = np.zeros_like(images["direct"])
    traced[shown] = (
        images["albedo"][shown] / np.pi * tracer.direct(images["position"][shown], images["normal"][shown])
    )
    return images | {"traced": traced}


def theirs(reference: Reference, view: View) -> dict[str, np.ndarray]:
    """The same layers, and `shown` (h, w)."""
    direct = reference.direct(view.camera, view.size)
    return surfaces(reference, view) | {"direct": direct, "traced": direct}


def surfaces(reference: Reference, view: View) -> dict[str, np.ndarray]:
    """First surfaces that are no hole, at pixel centres."""
    mi = load_mitsuba()
    if not is_vectorized(mi):
        pytest.skip("rays are followed all at once: this needs llvm_ad_rgb")
    import drjit as dr

    width, height = view.size
    y, x = np.divmod(np.arange(width * height), width)
    place = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
    sensor = make_camera(mi, _sensor(mi, view.camera, view.size, reference.origin))
    ray, _ = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    found = reference._scene.ray_intersect(ray)
    for _ in range(HOLES):
        hole = found.is_valid() & (dr.mean(found.bsdf().eval_null_transmission(found)) > 0.5)
        onwards = reference._scene.ray_intersect(found.spawn_ray(ray.d), hole)
        found = dr.select(hole, onwards, found)
    shown = np.array(found.is_valid())
    towards = -np.array(ray.d).T
    normal = np.array(found.sh_frame.n).T
    normal *= np.where(np.sum(normal * towards, axis=1, keepdims=True) < 0, -1, 1)
    albedo = np.array(found.bsdf().eval_diffuse_reflectance(found)).T
    rows = {"position": np.array(found.p).T + reference.origin, "normal": normal, "albedo": albedo}
    layers = {name: np.where(shown[:, None], value, 0) for name, value in rows.items()}
    return {name: value.reshape(height, width, 3) for name, value in layers.items()} | {
        "shown": shown.reshape(height, width)
    }


def away_from_edges(layers: dict[str, np.ndarray], camera: Camera) -> np.ndarray:
    """Pixels (h, w) of geometry that are more than `EDGE` pixels from every edge."""
    shown, position, normal = layers["shown"], layers["position"], layers["normal"]
    depth = np.linalg.norm(position - camera.world_from_local[:3, 3], axis=-1)
    edge = maximum_filter(shown, 3) != minimum_filter(shown, 3)
    for axis in (0, 1):
        step = np.roll(position, -1, axis) - position
        off_plane = np.abs(np.sum(step * normal, axis=-1)) > 0.02 * depth
        turned = np.sum(normal * np.roll(normal, -1, axis), axis=-1) < 0.95
        broken = off_plane | turned
        for name, least, share in (("albedo", 0.1, 0.0), ("direct", 0.02 * layers["direct"].mean(), 0.2)):
            here, there = layers[name], np.roll(layers[name], -1, axis)
            broken |= (np.abs(here - there) > least + share * np.maximum(here, there)).any(axis=-1)
        inner = np.ones_like(broken)
        inner[(slice(None),) * axis + (-1,)] = False
        broken &= inner
        edge |= broken | np.roll(broken, 1, axis)
    return shown & ~binary_dilation(edge, np.ones((3, 3)), iterations=EDGE)


def compare(gpu: Any, view: View, layers: tuple[str, ...]) -> dict[str, float]:
    """relMSE of layers, and the share of geometry that was left out."""
    truth = theirs(mesh_reference(view.scene, view.light), view)
    found = ours(gpu, view)
    kept = away_from_edges(truth, view.camera)
    errors = {}
    for name in layers:
        x, a = found[name][kept].astype(np.float64), truth[name][kept]
        if name == "position":  # relative to the distance from the camera, not from the origin
            x, a = x - view.camera.world_from_local[:3, 3], a - view.camera.world_from_local[:3, 3]
            errors[name] = float((np.sum((x - a) ** 2, axis=1) / np.sum(a**2, axis=1)).mean())
        elif name == "normal":
            errors[name] = float(np.sum((x - a) ** 2, axis=1).mean())
        else:
            errors[name] = relative_error(twice(x), twice(a)).rel_mse
    return errors | {"excluded": float(1 - kept.sum() / truth["shown"].sum())}


def textured_stage() -> Scene:
    """Three squares: checks that mirror, holes that repeat, vertex colours; turned, scaled and mirrored."""
    rng = np.random.default_rng(5)
    checks, holes = (rng.integers(30, 226, (4, 4, 4)).astype(np.uint8) for _ in range(2))

    def square(material: int, colors: np.ndarray | None = None) -> Mesh:
        positions = np.array([(-1.0, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)])
        uv = np.array([(-0.25, 0.1), (-0.25, 1.3), (1.2, 1.3), (1.2, 0.1)])
        triangles = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
        return Mesh("square", positions, np.tile([0.0, 1, 0], (4, 1)), triangles, material, (uv,), colors)

    def place(x: float, y: float, scale: tuple[float, float, float], tilt: float) -> np.ndarray:
        c, s = np.cos(tilt), np.sin(tilt)
        matrix = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        matrix[:3, :3] = matrix[:3, :3] * scale
        return matrix

    turn = np.array([[0.8, -0.6, 0.1], [0.6, 0.8, 0.2], [0, 0, 1]])
    colors = np.array([(1, 0.2, 0.2, 1), (0.2, 1, 0.2, 1), (0.2, 0.2, 1, 1), (0.9, 0.9, 0.9, 1)])
    return Scene(
        source=Path("stage.glb"),
        meshes=(square(0), square(1), square(2, colors)),
        materials=(
            Material(base_color=(0.9, 0.8, 0.7, 1), base_color_texture=TextureUse(0, transform=turn)),
            Material(base_color_texture=TextureUse(1), alpha_mode=AlphaMode.MASK, alpha_cutoff=0.4),
            Material(base_color=(0.8, 0.9, 0.7, 1)),
        ),
        textures=(Texture(0, Wrap.MIRROR, Wrap.MIRROR), Texture(1, linear=False)),
        images=(Image("checks", checks), Image("holes", holes)),
        instances=(
            Instance(0, -1, place(0, 0, (2, 1, 2), 0)),
            Instance(1, -1, place(-0.6, 0.6, (0.6, 0.6, -0.6), 0.3)),
            Instance(2, -1, place(0.9, 0.5, (0.5, 0.5, 0.5), -0.5)),
        ),
    )


LAMPS = (
    Sun((0.3, 1.0, 0.4), 2.0),
    Spot((-0.7, 1.8, 0.9), (0.3, -1, -0.4), 4.0, 0.2, 0.5),
)


def bundled(folder: Path, name: str, camera: str | None = None, *lights: Any) -> View:
    scene = gltf.load(folder / f"{name}.glb")
    light = choose_illumination(scene)
    chosen = next(c for c in scene.cameras if camera in (None, c.name))
    own_set = folder / f"{name}.npz"  # points have no shadow map: the primitives cast their shadows
    primitives = export.read(own_set) if own_set.is_file() else PrimitiveSet.empty()
    return View(scene, replace(light, lights=(*light.lights, *lights)), chosen, primitives)


VIEWS: dict[str, Callable[[Path], View]] = {
    "stage": lambda _: View(
        textured_stage(),
        Illumination(LAMPS, Sky.gradient((0.3, 0.4, 0.5), (0.2, 0.2, 0.2), (0, 1, 0))),
        look_at(np.array([0.3, 2.6, 2.4]), np.array([0.0, 0.1, 0.0]), 55),
    ),
    "cornell": lambda folder: bundled(folder, "cornell", None, Point((0.2, 1.5, 0.3), 1.0)),
    "courtyard": lambda folder: bundled(folder, "courtyard"),
    "six_solids": lambda folder: bundled(folder, "six_solids", None, Sun((0.4, 1, 0.6), 3.0)),
    "two_rooms": lambda folder: bundled(
        folder, "two_rooms", "west", Spot((-2, 2, 0), (-0.2, -1, 0.1), 5.0, 0.3, 0.9)
    ),
    "wall": lambda folder: bundled(folder, "two_colour_wall", "west"),
}


@pytest.mark.parametrize("name", VIEWS)
def test_what_is_seen_and_its_direct_light_agree(gpu: Any, bundled_assets: Path, name: str) -> None:
    found = compare(gpu, VIEWS[name](bundled_assets), ("position", "normal", "albedo", "direct", "traced"))
    excluded = found.pop("excluded")
    print(f"{name}: {found}, {excluded:.1%} excluded")
    assert max(found.values()) <= LIMIT, found
    assert excluded <= MOST_EXCLUDED
