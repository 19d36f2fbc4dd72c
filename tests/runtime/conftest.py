"""A temporary shader folder, scenes built by hand, and a brute-force ray caster to hold pictures against."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from fit.primitives import PrimitiveSet
from fit.scene import Image, Instance, Material, Mesh, Scene, Texture, TextureUse, transform_points


@pytest.fixture
def shaders(tmp_path: Path) -> Callable[[Mapping[str, str]], Path]:
    """Writes {"lib/sdf": text, ...} to a folder and returns it, for `root=`."""

    def write(texts: Mapping[str, str]) -> Path:
        for name, text in texts.items():
            path = (tmp_path / name).with_suffix(".wgsl")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return tmp_path

    return write


class SceneBuilder:
    """Collects meshes, materials and textures into a `Scene`; positions are (n, 3), triangles (m, 3)."""

    def __init__(self) -> None:
        self.parts: dict[str, list] = {
            name: []
            for name in ("meshes", "materials", "textures", "images", "instances", "lights", "cameras")
        }

    def add(
        self,
        positions,
        triangles,
        *,
        world_from_local=None,
        normals=None,
        texcoords=(),
        colors=None,
        **material,
    ):
        """A mesh with a material of its own, drawn once; returns the instance's index."""
        positions, triangles = np.array(positions, np.float64), np.array(triangles, np.uint32)
        if normals is None:
            normals = _vertex_normals(positions, triangles)
        material.setdefault("metallic", 0.0)
        self.parts["materials"].append(Material(**material))
        index = len(self.parts["materials"]) - 1
        self.parts["meshes"].append(
            Mesh("mesh", positions, np.array(normals, np.float64), triangles, index, tuple(texcoords), colors)
        )
        return self.place(len(self.parts["meshes"]) - 1, world_from_local)

    def place(self, mesh, world_from_local=None):
        """One more instance of a mesh; returns its index."""
        matrix = np.eye(4) if world_from_local is None else np.array(world_from_local, np.float64)
        self.parts["instances"].append(Instance(mesh, -1, matrix))
        return len(self.parts["instances"]) - 1

    def quad(self, corner, across, up, **options):
        """A rectangle with texture coordinates: (0, 1) at `corner`, v upside down along `up`."""
        corner, across, up = (np.array(v, np.float64) for v in (corner, across, up))
        positions = [corner, corner + across, corner + across + up, corner + up]
        uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float64)
        return self.add(positions, [[0, 1, 2], [0, 2, 3]], texcoords=(uv,), **options)

    def box(self, center=(0, 0, 0), size=(1, 1, 1), **options):
        """A box with flat faces, wound to be seen from outside."""
        corners, triangles = [], []
        for axis in range(3):
            for side in (-1, 1):
                u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
                ring = [(-1, -1), (1, -1), (1, 1), (-1, 1)][::side]
                triangles += [[len(corners), len(corners) + 1, len(corners) + 2]]
                triangles += [[len(corners), len(corners) + 2, len(corners) + 3]]
                corners += [side * np.eye(3)[axis] + a * u + b * v for a, b in ring]
        return self.add(np.array(corners) * np.array(size) / 2 + center, triangles, **options)

    def image(self, pixels, **sampler):
        """A texture of (h, w, 3 or 4) bytes; returns its use."""
        pixels = np.asarray(pixels, np.uint8)
        if pixels.shape[2] == 3:
            pixels = np.concatenate([pixels, np.full((*pixels.shape[:2], 1), 255, np.uint8)], axis=2)
        self.parts["images"].append(Image("image", pixels))
        self.parts["textures"].append(Texture(len(self.parts["images"]) - 1, **sampler))
        return TextureUse(len(self.parts["textures"]) - 1)

    def scene(self) -> Scene:
        return Scene(Path("built.gltf"), **{name: tuple(values) for name, values in self.parts.items()})


def _vertex_normals(positions, triangles):
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    normals = np.zeros_like(positions)
    for k in range(3):
        np.add.at(normals, triangles[:, k], faces)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


class RayCaster:
    """First hits on a scene's triangles in float64, by brute force: what the rasteriser is held against."""

    def __init__(self, scene: Scene) -> None:
        parts = []
        for instance in scene.instances:
            mesh = scene.meshes[instance.mesh]
            parts.append(transform_points(instance.world_from_local, mesh.positions)[mesh.triangles])
        self.corners = np.concatenate(parts)

    def cast(self, origins, directions):
        """Distances (n,), inf for a miss, and hit triangles' unit normals (n, 3) turned against the ray."""
        a = self.corners[:, 0]
        e, f = self.corners[:, 1] - a, self.corners[:, 2] - a
        p = np.cross(directions[:, None], f[None])
        determinant = (e * p).sum(-1)
        safe = np.where(np.abs(determinant) > 1e-12, determinant, 1.0)
        s = origins[:, None] - a
        u = (s * p).sum(-1) / safe
        q = np.cross(s, e[None])
        v = (directions[:, None] * q).sum(-1) / safe
        t = (q * f).sum(-1) / safe
        hits = (np.abs(determinant) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9)
        t = np.where(hits, t, np.inf)
        nearest = t.argmin(axis=1)
        normals = np.cross(e, f)[nearest]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        facing = (normals * directions).sum(-1, keepdims=True) > 0
        return t[np.arange(len(t)), nearest], np.where(facing, -normals, normals)

    def picture(self, camera, size):
        """View distances (h, w), positions and normals (h, w, 3) seen through the pixels' centres."""
        width, height = size
        x, y = np.meshgrid(
            (np.arange(width) + 0.5) / width * 2 - 1, 1 - (np.arange(height) + 0.5) / height * 2
        )
        view = camera.world_from_local
        if camera.yfov is not None:
            slope = np.tan(camera.yfov / 2)
            local = np.stack([x * slope * width / height, y * slope, -np.ones_like(x)], -1).reshape(-1, 3)
            origins = np.tile(view[:3, 3], (len(local), 1))
            directions = local @ view[:3, :3].T
        else:
            local = np.stack([x * camera.ymag * width / height, y * camera.ymag, np.zeros_like(x)], -1)
            origins = local.reshape(-1, 3) @ view[:3, :3].T + view[:3, 3]
            directions = np.tile(-view[:3, 2], (len(origins), 1))
        t, normals = self.cast(origins, directions)
        far = np.isfinite(t)
        positions = np.where(far[:, None], origins + directions * np.where(far, t, 0)[:, None], 0)
        normals = np.where(far[:, None], normals, 0)
        return (
            np.where(far, t, 0).reshape(height, width),
            *(a.reshape(height, width, 3) for a in (positions, normals)),
        )


@pytest.fixture
def builder() -> SceneBuilder:
    return SceneBuilder()


@pytest.fixture(scope="session")
def ray_caster() -> type[RayCaster]:
    return RayCaster


@pytest.fixture(scope="session")
def render_scene(gpu):
    """Renders a built scene: render_scene(scene, camera, size=..., lights=..., sky=..., only=...)."""
    from runtime.lights import Illumination
    from runtime.renderer import Renderer
    from runtime.settings import RenderSettings, ShadowSettings
    from runtime.sky import Sky

    def render(
        scene, camera, *, size=(64, 48), lights=(), sky=None, only=(), primitives=None, map_size=256, **more
    ):
        settings = RenderSettings(size=size, gi="none", shadows=ShadowSettings(map_size=map_size), **more)
        illumination = Illumination(tuple(lights), sky or Sky())
        shapes = PrimitiveSet.empty() if primitives is None else primitives
        return Renderer(gpu, scene, shapes, settings, illumination).render(camera, only=only)

    return render
