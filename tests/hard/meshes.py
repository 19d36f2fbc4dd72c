"""Meshes that break fitters, alone and combined: bases, kinds of damage, and places far from home.

A mesh is (vertices (n, 3) float64, triangles (m, 3) int64).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from fit.scene import Camera, Instance, Material, Mesh, Node, Scene

Vertices = NDArray[np.float64]
Triangles = NDArray[np.int64]
HardMesh = tuple[Vertices, Triangles]
Damage = Callable[[Vertices, Triangles, np.random.Generator], HardMesh]

GREY = Material(base_color=(0.5, 0.5, 0.5, 1.0))


def scene_of(
    mesh: HardMesh, matrix: NDArray[np.float64] | None = None, cameras: Sequence[Sequence[float]] = ()
) -> Scene:
    """One node that draws the mesh through its matrix (4, 4); cameras: positions in the mesh's own space."""
    vertices, triangles = mesh
    matrix = np.eye(4) if matrix is None else matrix
    places = [
        Camera(f"camera {i}", matrix @ moved_by(position), yfov=1.0) for i, position in enumerate(cameras)
    ]
    drawn = Mesh("mesh", vertices.copy(), np.zeros_like(vertices), triangles.astype(np.uint32), 0)
    node = Node("node", -1, matrix, matrix)
    return Scene(
        Path("made.glb"), (drawn,), (GREY,), nodes=(node,), instances=(Instance(0, 0, matrix),),
        cameras=tuple(places),
    )  # fmt: skip


def join(*meshes: HardMesh) -> HardMesh:
    """All of them as one mesh, no vertex shared."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    joined = [triangles + start for (_, triangles), start in zip(meshes, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(joined)


def of_trimesh(mesh: trimesh.Trimesh) -> HardMesh:
    return np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)


def box(size: Sequence[float], center: Sequence[float] = (0, 0, 0)) -> HardMesh:
    return of_trimesh(trimesh.creation.box(size, moved_by(center)))


def inside_out(mesh: HardMesh) -> HardMesh:
    return mesh[0], mesh[1][:, ::-1]


def sheet(corners: Sequence[Sequence[float]]) -> HardMesh:
    return np.array(corners, np.float64), np.array([[0, 1, 2], [0, 2, 3]])


# ------------------------------------------------------------------------------------------------- bases


def table() -> HardMesh:
    """Five boxes, cut into some hundreds of triangles so that damage has something to hit."""
    legs = [box((0.12, 1.0, 0.12), (x, 0.5, z)) for x in (-0.9, 0.9) for z in (-0.5, 0.5)]
    return finer(join(box((2.0, 0.12, 1.2), (0, 1.06, 0)), *legs), 0.3)


def lumpy_ball(subdivisions: int = 3) -> HardMesh:
    """A closed body without any flat or exactly round part, and without any symmetry."""
    vertices, triangles = of_trimesh(trimesh.creation.icosphere(subdivisions))
    x, y, z = vertices.T
    swell = 1 + 0.25 * np.sin(2.2 * x + 1) * np.cos(1.7 * y) + 0.15 * np.sin(3.1 * z)
    return vertices * swell[:, None] * [1.4, 1.0, 0.8], triangles


def furnished_room() -> HardMesh:
    """Six walls seen from inside and, in no symmetric order, a block, a column and a lump."""
    column = of_trimesh(trimesh.creation.cylinder(0.25, 2.4, sections=24))
    column = (column[0][:, [0, 2, 1]] * [1, 1, -1] + [1.2, 0, 0.9], column[1])
    lump, faces = lumpy_ball(2)
    return join(
        inside_out(box((5.0, 2.5, 4.0))),
        box((1.6, 0.5, 0.7), (-1.3, -1.0, -1.2)),
        column,
        (lump * 0.35 + [-0.6, -0.7, 1.0], faces),
    )


def finer(mesh: HardMesh, longest: float) -> HardMesh:
    """The mesh with its edges halved until none is longer than `longest`."""
    vertices, triangles = trimesh.remesh.subdivide_to_size(*mesh, max_edge=longest)
    return np.asarray(vertices, np.float64), np.asarray(triangles, np.int64)


def wavy_globe(triangles: int) -> HardMesh:
    """At least so many triangles: a globe of rings and sectors with waves on it, closed."""
    rings = int(np.ceil(np.sqrt(triangles / 4))) + 1
    sectors = 2 * rings
    polar = np.pi * (np.arange(rings) + 0.5) / rings
    turn = 2 * np.pi * np.arange(sectors) / sectors
    polar, turn = (grid.ravel() for grid in np.meshgrid(polar, turn, indexing="ij"))
    radius = 1 + 0.1 * np.sin(5 * polar) * np.cos(4 * turn)
    around = np.stack([np.sin(polar) * np.cos(turn), np.cos(polar), np.sin(polar) * np.sin(turn)], axis=1)
    row, column = np.divmod(np.arange((rings - 1) * sectors), sectors)
    a, b = row * sectors + column, row * sectors + (column + 1) % sectors
    quads = np.concatenate(
        [np.column_stack([a, b, a + sectors]), np.column_stack([b, b + sectors, a + sectors])]
    )
    rim = np.arange(1, sectors - 1)
    caps = np.column_stack([np.zeros_like(rim), rim + 1, rim])
    bottom = np.column_stack([np.zeros_like(rim), rim, rim + 1]) + (rings - 1) * sectors
    return radius[:, None] * around, np.concatenate([quads, caps, bottom])


# ------------------------------------------------------------------------------- meshes hard by themselves


def one_triangle() -> HardMesh:
    return np.array([[0.0, 0, 0], [1, 0, 0], [0.2, 0.7, 0]]), np.array([[0, 1, 2]])


def isolated_triangles() -> HardMesh:
    """Two hundred triangles in a cube, none of which touches another on purpose."""
    rng = np.random.default_rng(11)
    corners = rng.uniform(-1, 1, (200, 1, 3)) + rng.normal(0, 0.06, (200, 3, 3))
    return corners.reshape(-1, 3), np.arange(600).reshape(-1, 3)


def flat() -> HardMesh:
    """An oval ring in a plane that no axis lies in."""
    vertices, triangles = of_trimesh(trimesh.creation.annulus(0.5, 1.0, 1.0, sections=48))
    on_top = np.all(vertices[triangles][:, :, 2] > 0.4, axis=1)
    return turned((1, 2, 3), 0.7, vertices * [1, 0.8, 0]), triangles[on_top]


def needle_rod() -> HardMesh:
    """A box of aspect 1:10,000."""
    return box((10.0, 1e-3, 1e-3))


def thin_wall() -> HardMesh:
    """Two rooms of 4 m whose wall is 1 mm thick."""
    half = 0.0005
    rooms = [inside_out(box((4.0, 2.5, 3.0), (side * (2.0 + half), 0, 0))) for side in (-1, 1)]
    return join(*rooms)


def nested_shells() -> HardMesh:
    """Four closed spheres, each in the next."""
    return join(*(of_trimesh(trimesh.creation.icosphere(2, radius)) for radius in (1.0, 0.8, 0.55, 0.3)))


def nested_room() -> HardMesh:
    """A block in a room in a box with thick walls."""
    return join(box((2.0, 2.0, 2.0)), inside_out(box((1.6, 1.6, 1.6))), box((0.5, 0.5, 0.5), (0.1, -0.55, 0)))


def coplanar_sheets() -> HardMesh:
    """Sheets that overlap in one plane, some of them the other way up."""
    squares = [
        sheet([(x, 0, z), (x, 0, z + 2), (x + 2, 0, z + 2), (x + 2, 0, z)])
        for x, z in ((0, 0), (1, 0.5), (0, 1))
    ]
    return join(squares[0], inside_out(squares[1]), squares[2])


def crossing_boxes() -> HardMesh:
    """Three long boxes through one another: surfaces that intersect themselves."""
    return join(box((4, 0.5, 0.5)), box((0.5, 4, 0.5)), box((0.5, 0.5, 4)))


def slivers() -> HardMesh:
    """A square as a fan of two hundred needle triangles from one corner."""
    along = np.linspace(0, 1, 201)
    far = np.column_stack([np.ones(201), along, np.zeros(201)])
    rim = np.concatenate([[[0.0, 0, 0]], far, [[0.0, 1, 0]]])
    return rim, np.column_stack([np.zeros(201, int), np.arange(1, 202), np.arange(2, 203)])


MESHES: dict[str, Callable[[], HardMesh]] = {
    "one triangle": one_triangle,
    "isolated triangles": isolated_triangles,
    "flat": flat,
    "needle rod": needle_rod,
    "thin wall": thin_wall,
    "nested shells": nested_shells,
    "nested room": nested_room,
    "coplanar sheets": coplanar_sheets,
    "crossing boxes": crossing_boxes,
    "slivers": slivers,
}


# ------------------------------------------------------------------------------------------------ damage


def duplicate_vertices(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """Every triangle has corners of its own."""
    return vertices[triangles].reshape(-1, 3), np.arange(triangles.size).reshape(-1, 3)


def near_duplicate_vertices(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """Corners of their own, up to 1e-7 of the diagonal apart."""
    vertices, triangles = duplicate_vertices(vertices, triangles, rng)
    return vertices + rng.uniform(-1e-7, 1e-7, vertices.shape) * diagonal(vertices), triangles


def zero_area_triangles(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """Triangles that are a point, a doubled edge, or three points in a row."""
    a, b = triangles[::3, 0], triangles[::3, 1]
    middle = (vertices[a] + vertices[b]) / 2
    between = len(vertices) + np.arange(len(a))
    added = [np.column_stack([a, a, a]), np.column_stack([a, b, b]), np.column_stack([a, between, b])]
    return np.concatenate([vertices, middle]), np.concatenate([triangles, *added])


def needle_triangles(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """Slivers along edges, a millionth of their length high."""
    chosen = triangles[::4]
    a, b, c = (vertices[chosen[:, k]] for k in range(3))
    tip = (a + b) / 2 + 1e-6 * (c - a)
    tips = len(vertices) + np.arange(len(chosen))
    added = np.column_stack([chosen[:, 0], chosen[:, 1], tips])
    return np.concatenate([vertices, tip]), np.concatenate([triangles, added])


def t_junctions(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """A third of the triangles is halved, their neighbours across the halved edge are not."""
    halved = rng.random(len(triangles)) < 1 / 3
    a, b, c = triangles[halved].T
    middle = (vertices[a] + vertices[b]) / 2
    m = len(vertices) + np.arange(len(a))
    pieces = [triangles[~halved], np.column_stack([a, m, c]), np.column_stack([m, b, c])]
    return np.concatenate([vertices, middle]), np.concatenate(pieces)


def self_intersections(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """A second copy, a little turned and moved, through the first."""
    copy = turned((0.3, 1, 0.2), 0.02, vertices) + 0.003 * diagonal(vertices)
    return join((vertices, triangles), (copy, triangles))


def inverted_winding(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    return vertices, triangles[:, ::-1]


def mixed_winding(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    flipped = rng.random(len(triangles)) < 0.5
    return vertices, np.where(flipped[:, None], triangles[:, ::-1], triangles)


def doubled_faces(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """Each face twice, half of the copies the other way round."""
    return vertices, np.concatenate([triangles, mixed_winding(vertices, triangles, rng)[1]])


def coplanar_overlaps(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """Smaller copies of faces within the same faces."""
    chosen = triangles[::2]
    middles = vertices[chosen].mean(axis=1, keepdims=True)
    smaller = middles + 0.7 * (vertices[chosen] - middles)
    return join((vertices, triangles), (smaller.reshape(-1, 3), np.arange(chosen.size).reshape(-1, 3)))


def dust(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
    """Twenty tiny triangles near the surface, part of nothing."""
    size = diagonal(vertices)
    middles = vertices[rng.integers(len(vertices), size=20)] + rng.normal(0, 0.01 * size, (20, 3))
    corners = middles[:, None] + rng.normal(0, 0.002 * size, (20, 3, 3))
    return join((vertices, triangles), (corners.reshape(-1, 3), np.arange(60).reshape(-1, 3)))


def noise(share: float) -> Damage:
    """Gaussian, on every vertex; `share` of the diagonal is its standard deviation."""

    def shaken(vertices: Vertices, triangles: Triangles, rng: np.random.Generator) -> HardMesh:
        return vertices + rng.normal(0, share * diagonal(vertices), vertices.shape), triangles

    return shaken


DAMAGES: dict[str, Damage] = {
    "duplicate vertices": duplicate_vertices,
    "near-duplicate vertices": near_duplicate_vertices,
    "zero-area triangles": zero_area_triangles,
    "needle triangles": needle_triangles,
    "T-junctions": t_junctions,
    "self-intersections": self_intersections,
    "inverted winding": inverted_winding,
    "mixed winding": mixed_winding,
    "doubled faces": doubled_faces,
    "coplanar overlaps": coplanar_overlaps,
    "dust": dust,
    "noise of 0.1 %": noise(0.001),
    "noise of 1 %": noise(0.01),
}

NOISE = {"noise of 0.1 %": 0.001, "noise of 1 %": 0.01, "self-intersections": 0.01}
"""How far damage moves the surface itself, as a share of the diagonal; the others leave it where it is."""


def diagonal(vertices: Vertices) -> float:
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


# ------------------------------------------------------------------------------------------------ places


def moved_by(offset: Sequence[float]) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def scaled_by(factor: float) -> NDArray[np.float64]:
    return np.diag([factor, factor, factor, 1.0])


def turned_by(axis: Sequence[float], angle: float) -> NDArray[np.float64]:
    return trimesh.transformations.rotation_matrix(angle, axis)


def turned(axis: Sequence[float], angle: float, points: Vertices) -> Vertices:
    return points @ turned_by(axis, angle)[:3, :3].T


def any_rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    """Uniform over all rotations (Shoemake 1992)."""
    matrix = np.eye(4)
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    matrix[:3, :3] = q * np.linalg.det(q)
    return matrix


MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])

PLACES: dict[str, NDArray[np.float64]] = {
    "at home": np.eye(4),
    "scale 1e-4": scaled_by(1e-4),
    "scale 1e5": scaled_by(1e5),
    "offset 1e6 m": moved_by((1e6, -1e6, 1e6)),
    "turned": turned_by((1, 2, 3), 0.7),
    "mirrored": MIRROR,
    "scale 1e-4, offset 1e6 m": moved_by((1e6, 0, 1e6)) @ scaled_by(1e-4),
    "all at once": moved_by((-1e6, 1e6, 0)) @ turned_by((3, -1, 2), 2.1) @ MIRROR @ scaled_by(1e5),
}


def combined(seed: int) -> tuple[str, HardMesh, NDArray[np.float64]]:
    """One to four kinds of damage on a base, at a random place: a telling name, the mesh, its matrix."""
    rng = np.random.default_rng(seed)
    bases = {"table": table, "ball": lumpy_ball, **MESHES}
    base = rng.choice(list(bases))
    damages = rng.choice(list(DAMAGES), size=rng.integers(1, 5), replace=False)
    mesh = bases[base]()
    for damage in damages:
        mesh = DAMAGES[damage](*mesh, rng)
    scale = 10 ** rng.uniform(-4, 5)
    offset = rng.choice([0.0, 1e3 * scale, 1e6]) * rng.uniform(-1, 1, 3)
    mirror = MIRROR if rng.random() < 0.5 else np.eye(4)
    place = moved_by(offset) @ any_rotation(rng) @ mirror @ scaled_by(scale)
    return f"{base}: {', '.join(damages)}; scale {scale:.0e}, offset {np.abs(offset).max():.0e}", mesh, place
